"""Map files: what is written comes back; what is damaged is refused in a sentence."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from curvescan.errors import LogFileError, LogFormatError
from curvescan.mapping.occupancy import OccupancyBuilder
from curvescan.scan import LaserScan
from curvescan.slam import Slam
from curvescan.slam.map import SlamMap, load_map


def _map() -> SlamMap:
    even = LaserScan(
        np.array([1.5, np.inf, 2.0, 0.0], dtype=np.float32),
        angle_min=-0.5, angle_increment=0.3, range_min=0.1, range_max=9.0, stamp=3.25, noise_doubled_at=0.5,
    )  # fmt: skip
    uneven = LaserScan(np.array([1.0, 2.0, 4.0]), angles=np.array([-0.4, 0.0, 0.9]), stamp=4.5)
    builder = OccupancyBuilder()
    builder.add(even, np.zeros(3))
    cov = np.stack((np.zeros((3, 3)), np.diag([0.01, 0.02, 0.003])))
    return SlamMap(
        scans=(even, uneven), poses=np.array([[0.0, 0.0, 0.0], [1.0, 0.5, 0.2]]), covariances=cov,
        indices=np.array([0, 7]), sessions=np.array([0, 0]), ends=np.array([[0, 1]]),
        measured=np.array([[1.0, 0.5, 0.2]]), edge_covariances=cov[1:], kinds=np.array([0]),
        weights=np.array([1.0]), grid=builder.grid(),
    )  # fmt: skip


def test_what_is_written_comes_back(tmp_path: Path) -> None:
    before = _map()
    before.save(tmp_path / "a.csmap")
    after = load_map(tmp_path / "a.csmap")
    for name in ("poses", "covariances", "indices", "sessions", "ends", "measured", "weights"):
        assert np.array_equal(getattr(after, name), getattr(before, name)), name
    for one, other in zip(after.scans, before.scans, strict=True):
        assert np.array_equal(one.ranges, other.ranges)
        assert np.array_equal(one.angles, other.angles)
        for name in ("stamp", "range_max", "noise_doubled_at"):
            assert getattr(one, name) == getattr(other, name), name
    assert after.grid is not None
    assert before.grid is not None
    assert np.array_equal(after.grid.log_odds, before.grid.log_odds)
    assert after.grid.config == before.grid.config


def test_a_map_that_says_nothing_of_the_noise_is_read(tmp_path: Path) -> None:
    _map().save(tmp_path / "a.csmap")
    with np.load(tmp_path / "a.csmap") as file:
        arrays = {name: file[name] for name in file.files if name != "noise_doubled_at"}
    with (tmp_path / "b.csmap").open("wb") as file:
        np.savez_compressed(file, **arrays)
    assert {scan.noise_doubled_at for scan in load_map(tmp_path / "b.csmap").scans} == {np.inf}


def test_edges_of_wheels_that_maps_had_once_are_left_out(tmp_path: Path) -> None:
    known = _map()
    with_wheels = replace(
        known, ends=np.tile(known.ends, (2, 1)), measured=np.tile(known.measured, (2, 1)),
        edge_covariances=np.tile(known.edge_covariances, (2, 1, 1)), kinds=np.array([2, 0]),
        weights=np.array([0.5, 1.0]),
    )  # fmt: skip
    with_wheels.save(tmp_path / "a.csmap")
    after = load_map(tmp_path / "a.csmap")
    assert after.kinds.tolist() == [0]
    assert after.weights.tolist() == [1.0]
    assert Slam(map=after).n_fragments == 1


def test_a_reading_at_a_limit_of_the_laser_stays_one(tmp_path: Path) -> None:
    one = _map()
    scan = LaserScan(np.array([0.1, 8.1]), angle_min=0.0, angle_increment=0.1, range_min=0.1, range_max=8.1)
    replace(one, scans=(scan, one.scans[1])).save(tmp_path / "a.csmap")
    assert load_map(tmp_path / "a.csmap").scans[0].valid.all()


def test_a_map_of_much_that_is_unknown_is_read_again(tmp_path: Path) -> None:
    one = _map()
    assert one.grid is not None
    log_odds = np.zeros((5000, 4000), dtype=np.float32)  # 76 MiB, and a file of 0.1
    replace(one, grid=replace(one.grid, log_odds=log_odds)).save(tmp_path / "a.csmap")
    found = load_map(tmp_path / "a.csmap").grid
    assert found is not None
    assert found.log_odds.shape == log_odds.shape


def test_a_missing_file(tmp_path: Path) -> None:
    with pytest.raises(LogFileError, match="does not exist"):
        load_map(tmp_path / "no.csmap")


def test_a_file_cut_short_at_any_place_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.csmap"
    _map().save(path)
    whole = path.read_bytes()
    for n in range(0, len(whole), 97):
        path.write_bytes(whole[:n])
        with pytest.raises((LogFormatError, LogFileError)):
            load_map(path)


@pytest.mark.parametrize(
    ("name", "value", "reason"),
    [
        ("csmap_version", np.array([99]), "version 99"),
        ("edge_ends", np.array([[0, 9]]), "keyframes that are not there"),
        ("poses", np.array([[0.0, 0.0, np.nan], [0.0, 0.0, 0.0]]), "poses must be finite"),
        ("n_beams", np.array([4, 99]), "not as many"),
        ("covariances", np.zeros((2, 5)), "must have shape"),
        ("csmap_version", np.array([]), "a map of version : install a later"),
        ("csmap_version", np.array([np.nan]), "a map of version nan: install a later"),
        ("grid_config", None, "damaged: 'grid_config'"),
        ("grid_config", np.float64(0.0), "damaged"),
        ("grid_origin", np.array([np.nan, 0.0]), "of finite numbers"),
        ("grid_log_odds", np.full((2, 2), np.nan), "of finite numbers"),
        ("edge_weights", np.array([1.5]), r"edge_weights must lie in \[0, 1\]"),
        ("edge_covariances", np.array([[-0.01, 0.0, 0.0, 0.01, 0.0, 0.01]]), "must be positive definite"),
    ],
)
def test_a_wrong_array_is_named(tmp_path: Path, name: str, value: np.ndarray | None, reason: str) -> None:
    path = tmp_path / "a.csmap"
    _map().save(path)
    with np.load(path) as file:
        arrays = dict(file)
    arrays[name] = value
    arrays = {name: array for name, array in arrays.items() if array is not None}
    with path.open("wb") as new:
        np.savez(new, **arrays)
    with pytest.raises(LogFormatError, match=reason):
        load_map(path)


def test_an_array_that_is_not_known_is_left_aside(tmp_path: Path) -> None:
    path = tmp_path / "a.csmap"
    _map().save(path)
    with np.load(path) as file:
        arrays = dict(file)
    with path.open("wb") as new:
        np.savez(new, tomorrow=np.zeros((2, 2, 2)), names=np.array(["a"]), **arrays)
    assert len(load_map(path)) == 2


def test_a_picture_or_a_folder_is_no_map(tmp_path: Path) -> None:
    with pytest.raises(LogFileError, match=r"is a folder: give the map\.csmap or map\.yaml in it"):
        load_map(tmp_path)
    (tmp_path / "picture.png").write_bytes(b"\x89PNG\r\n")
    with pytest.raises(LogFormatError, match=r"picture\.png is not a map that curvescan saved: give the map\.csmap of"):
        load_map(tmp_path / "picture.png")
