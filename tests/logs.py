"""Logs with all that a scan can have, and what it means that two are the same."""

from __future__ import annotations

import numpy as np

from curvescan.io import MemoryLog
from curvescan.io.log import Log
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan

FIELDS = ("angle_min", "angle_increment", "range_min", "range_max", "time_increment", "scan_time")
CODES = (np.nan, np.inf, -np.inf, 0.0, -1.0, 81.91)


def short(value: float) -> float:
    """Return the float64 of the nearest float32, as a ROS message holds it."""
    return float(np.float32(value))


def rich_log(*, n: int = 12, uneven: bool = False, digits: type = np.float32) -> MemoryLog:
    """Return scans that differ in beams, limits, direction and intensities, with stamps that repeat and go back."""
    rng = np.random.default_rng(7)
    scans = []
    for i in range(n):
        n_beams = (31, 40, 0, 1)[i % 4]
        ranges = rng.uniform(0.1, 9.0, n_beams)
        ranges[: len(CODES)] = CODES[:n_beams]
        angles = np.cumsum(rng.uniform(0.01, 0.09, n_beams)) - 1.5
        step = digits(0.05 if i % 3 else -0.04)
        even = {"angle_min": float(digits(-1.2)), "angle_increment": float(step)}
        is_uneven = uneven and n_beams > 2 and i % 3 != 1
        scans.append(
            LaserScan(
                ranges.astype(digits),
                **({"angles": angles} if is_uneven else even),
                range_min=float(digits(0.02 * (i % 3))),
                range_max=np.inf if i == 5 else float(digits(8.1)),
                stamp=round(1_700_000_000.123456 + 0.1 * i - (0.35 if i % 5 == 4 else 0.0), 6),
                intensities=rng.uniform(0, 255, n_beams).astype(digits) if i % 4 == 1 else None,
                time_increment=float(digits(1e-4)),
                scan_time=float(digits(0.1)),
            )
        )
    poses = rng.uniform(-3.0, 3.0, (n, 3))
    poses[0] = np.nan
    stamps = np.array([scan.stamp for scan in scans])
    return MemoryLog(scans=tuple(scans), odometry=Trajectory(stamps=stamps, poses=poses))


def assert_same_scan(a: LaserScan, b: LaserScan) -> None:
    """Check that two scans are the same to the bit."""
    np.testing.assert_array_equal(a.ranges, b.ranges)
    np.testing.assert_array_equal(a.angles, b.angles)
    assert [getattr(a, name) for name in FIELDS] == [getattr(b, name) for name in FIELDS]
    assert a.stamp == b.stamp
    assert (a.intensities is None) == (b.intensities is None or not len(b.intensities))
    if a.intensities is not None:
        np.testing.assert_array_equal(a.intensities, b.intensities)


def assert_same_scans(a: Log, b: Log) -> None:
    """Check that two logs hold the same scans to the bit."""
    assert len(a) == len(b) == len(list(b))
    for left, right in zip(a, b, strict=True):
        assert_same_scan(left, right)
