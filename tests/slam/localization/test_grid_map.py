"""Localization in a plain map: what a laser would see from its free places stands in for keyframes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.errors import LogFileError, LogFormatError
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.map_server import write_map
from curvescan.mapping.occupancy import OccupancyGrid
from curvescan.slam.localization.grid_map import map_of_grid, opened
from tests.slam.map_example import FILE, lap, scans


def _box(n: int = 120, resolution: float = 0.05) -> OccupancyGrid:
    """Return a square room of known free cells with a wall one cell thick, and the unknown around it."""
    log_odds = np.zeros((n, n), dtype=np.float32)
    log_odds[10:-10, 10:-10] = -2.0
    for edge in (10, -11):
        log_odds[edge, 10:-10] = log_odds[10:-10, edge] = 3.0
    config = OccupancyConfig(resolution=resolution)
    return OccupancyGrid(log_odds=log_odds, origin=np.array([-1.0, 2.0]), config=config)


def test_beams_end_in_the_middle_of_the_wall() -> None:
    grid = _box()
    found = map_of_grid(grid)
    assert len(found) > 4
    low, high = grid.origin + 0.05 * 10.5, grid.origin + 0.05 * 109.5
    for scan, pose in zip(found.scans, found.poses, strict=True):
        assert scan.valid.all()
        ends = scan.points + pose[:2]
        off = np.minimum(np.abs(ends - low), np.abs(ends - high)).min(axis=1)
        assert off.max() < 0.03  # cells are 0.05 m wide
        assert off.mean() < 0.015


def test_a_beam_into_the_unknown_says_nothing() -> None:
    grid = _box()
    log_odds = grid.log_odds.copy()
    log_odds[:, -11] = 0.0  # the wall at the right is unknown
    found = map_of_grid(replace(grid, log_odds=log_odds))
    scan = found.scans[0]
    assert not scan.valid[np.abs(scan.angles) < 0.2].any()
    assert scan.valid[np.abs(scan.angles) > 3.0].all()


def test_a_large_map_is_looked_at_from_no_more_places(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("curvescan.slam.localization.grid_map._N_PLACES", 100)
    log_odds = np.full((400, 400), -2.0, dtype=np.float32)
    log_odds[::200] = 3.0
    grid = OccupancyGrid(log_odds=log_odds, origin=np.zeros(2), config=OccupancyConfig())
    assert 50 < len(map_of_grid(grid)) <= 100


def test_a_map_without_free_places_and_files_that_are_none_are_refused(tmp_path: Path) -> None:
    grid = _box()
    dark = replace(grid, log_odds=np.abs(grid.log_odds))
    with pytest.raises(LogFormatError, match=r"no free place 0\.3 m clear of walls: its free_thresh or negate"):
        map_of_grid(dark)
    (tmp_path / "floor.pgm").write_bytes(b"P5\n1 1\n255\n0")
    with pytest.raises(LogFileError, match=r"floor\.yaml beside it"):
        opened(tmp_path / "floor.pgm")
    with pytest.raises(LogFileError, match="does not exist"):
        opened(tmp_path / "none.pgm")


@pytest.mark.slow
@pytest.mark.parametrize("name", ["floor.yaml", "floor.pgm"])
def test_the_sensor_is_found_and_followed_in_a_plain_map(tmp_path: Path, name: str) -> None:
    grid = cs.load_map(FILE).grid
    assert grid is not None
    write_map(tmp_path, grid, name="floor")
    poses = lap(start=2.0)[:60]
    localizer = cs.Localizer(tmp_path / name)
    steps = [localizer.add(scan) for scan in scans(poses, seed=9)]
    true = se2.between(lap()[0], poses)
    errors = np.array([np.hypot(*(s.pose - p)[:2]) for s, p in zip(steps, true, strict=True)])
    assert np.isfinite(errors[15:]).all()
    assert np.nanmax(errors) < 0.1
    # 3 degrees of freedom: a plain map knows its walls to half a cell, and the covariance says so
    off = np.array([s.pose - p for s, p in zip(steps, true, strict=True)])[15:]
    nees = np.einsum("ni,nij,nj->n", off, np.linalg.inv([s.covariance for s in steps[15:]]), off)
    assert nees.mean() < 6.0
    elsewhere = cs.simulate("office", seed=11, n_scans=40, odometry_noise=None)
    localizer.reset()
    assert not any(localizer.add(scan).ok for scan in elsewhere)
