"""Scans to CSV, in the layout of csv_layout.py; nothing is lost, every float64 is read again to the bit."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from curvescan.io.arrays.csv_layout import ANGLES, COLUMNS, INTENSITIES, POSE_COLUMNS, RANGES
from curvescan.io.files.gzip_files import text_file
from curvescan.io.log import Log, scans_with_poses
from curvescan.scan import LaserScan
from curvescan.types import Floats

_TITLE = "# scans of a 2D laser: metres, radians, seconds; a line each, its ranges from the last column on\n"


def write_csv_scans(path: Path, log: Log, on_scan: Callable[[], object]) -> tuple[str, ...]:
    """Write a log as CSV; a LogWriter that loses nothing."""
    has_poses = log.odometry is not None
    angles: Floats = np.empty(0)
    with text_file(path) as file:
        file.write(_TITLE)
        file.write(",".join((*COLUMNS, *(POSE_COLUMNS if has_poses else ()), RANGES)) + "\n")
        for scan, pose in scans_with_poses(log):
            is_even = is_on_grid(scan)
            if not is_even and not np.array_equal(angles, scan.angles):
                angles = scan.angles
                file.write(f"{ANGLES},{_row(angles)}\n")
            if scan.intensities is not None:
                file.write(f"{INTENSITIES},{_row(scan.intensities)}\n")
            file.write(_head(scan, is_even))
            if has_poses:
                file.write(",,," if pose is None else f",{_row(pose)}")
            file.write(f",{_row(scan.ranges)}\n" if len(scan) else "\n")
            on_scan()
    return ()


def is_on_grid(scan: LaserScan) -> bool:
    """Return whether angle_min and angle_increment give the beams' directions to the bit."""
    grid = scan.angle_min + scan.angle_increment * np.arange(len(scan), dtype=np.float64)
    return scan.has_uniform_angles and np.array_equal(grid, scan.angles)


def _head(scan: LaserScan, is_even: bool) -> str:
    directions = f"{scan.angle_min!r},{scan.angle_increment!r}" if is_even else ","
    return (
        f"{scan.stamp!r},{directions},{scan.range_min!r},{scan.range_max!r},{scan.time_increment!r},{scan.scan_time!r}"
    )


def _row(values: Floats) -> str:
    return ",".join(map(repr, values.tolist()))
