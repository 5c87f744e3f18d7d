"""Localizer: in the map that its own scans made it is found at once and tracked, whatever the sensor leaves out."""

from __future__ import annotations

from dataclasses import replace
from math import pi, radians
from pathlib import Path

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.odometry import StepOutcome
from curvescan.simulation import Sensor

SPINNING = Sensor(
    name="spinning, 720 beams in the whole of its turn",
    n_beams=720,
    angle_min=-pi,
    angle_increment=radians(0.5),
    range_min=0.15,
    range_max=12.0,
    sigma_range=0.015,
    dropout=0.02,
    period=0.135,
    time_increment=0.135 / 720.0,
)


def _with_dark_walls(log: cs.Simulation, seed: int) -> list[cs.LaserScan]:
    """Return scans that lose half of what comes back from every third 0.7 m of all surfaces: +inf."""
    rng = np.random.default_rng(seed)
    found = []
    for scan, pose in zip(log, log.truth.poses, strict=True):
        ends = se2.transform(pose, np.where(np.isfinite(scan.points), scan.points, 0.0))
        is_dark = np.floor(ends.sum(axis=1) / 0.7) % 3 == 0
        lost = is_dark & (rng.random(len(scan)) < 0.5)
        found.append(replace(scan, ranges=np.where(lost, np.inf, scan.ranges)))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("world", "seed"), [("clutter", 3), ("office", 5)])
def test_in_its_own_map_the_sensor_is_tracked(world: str, seed: int, tmp_path: Path) -> None:
    log = cs.simulate(world, sensor=SPINNING, n_scans=240, seed=seed, odometry_noise=None)
    scans = _with_dark_walls(log, seed)
    scans = [replace(scans[0], stamp=0.135 * k) for k in range(-20, 0)] + scans
    slam = cs.Slam()
    for scan in scans:
        slam.add(scan)
    slam.map.save(tmp_path / "floor.csmap")
    localizer = cs.Localizer(cs.load_map(tmp_path / "floor.csmap"))
    steps = [localizer.add(scan) for scan in scans]
    followed = [s.outcome in (StepOutcome.FOUND, StepOutcome.TRACKED) for s in steps]
    assert all(followed[:20])
    assert np.mean(followed) >= 0.95
    off = [se2.between(p, s.pose) for p, s in zip(slam.trajectory().poses, steps, strict=True)]
    off = np.array(off)[followed]
    assert np.hypot(off[:, 0], off[:, 1]).max() < 0.1
    assert np.abs(off[:, 2]).max() < radians(3.0)
