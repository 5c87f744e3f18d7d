"""Scans to CARMEN logs, a line each.

ROBOTLASER1 is the line that says most of a scan: its first angle, its increment and its limit, where FLASER leaves all
three to convention. It has a pose; where the log has no odometry for every scan the lines are RAWLASER1, which has
none, with an ODOM line before each scan whose pose is known.

Numbers have as many digits as it takes to read the same float64 again. Lost are range_min (readings below it are
written as 0, so that they stay *no reading*), the times of beams and sweeps, and the direction of the sweep: lines run
counter-clockwise, so that a clockwise scan is mirrored, its beams in opposite order at the same angles. No limit (inf)
becomes the largest float64. Beams that are not evenly spaced cannot be said.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np

from curvescan.errors import OutputError
from curvescan.io.files.gzip_files import text_file
from curvescan.io.log import Log, scans_with_poses
from curvescan.scan import LaserScan
from curvescan.types import Floats, Pose


def write_carmen(path: Path, log: Log, on_scan: Callable[[], object]) -> tuple[str, ...]:
    """Write a log as CARMEN text; a LogWriter. Raises OutputError."""
    odometry = log.odometry
    is_posed = odometry is not None and bool(np.isfinite(odometry.poses).all())
    losses: dict[str, None] = {}
    with text_file(path) as file:
        file.write("# CARMEN Logfile\n")
        for scan, pose in scans_with_poses(log):
            losses |= dict.fromkeys(_losses(scan))
            if not is_posed and pose is not None:
                file.write(f"ODOM {_row(pose)} 0 0 0 {scan.stamp!r} curvescan {scan.stamp!r}\n")
            file.write(_line(scan, pose if is_posed else None))
            on_scan()
    if odometry is not None and len(odometry) > 1 and not odometry.poses.any():
        losses["odometry that is 0 throughout: readers of CARMEN logs take it for none"] = None
    return tuple(losses)


def _line(scan: LaserScan, pose: Pose | None) -> str:
    if not scan.has_uniform_angles:
        raise OutputError(
            f"cannot write the scan at {scan.stamp} s to a CARMEN log: its lines have evenly spaced beams, these are "
            "not; CSV and NPZ keep them"
        )
    ranges, strengths = scan.ranges, scan.intensities
    ranges = np.where((ranges > 0.0) & (ranges < scan.range_min), 0.0, ranges)
    start, step = scan.angle_min, scan.angle_increment
    if step < 0.0:
        start, step = start + step * max(len(scan) - 1, 0), -step
        ranges, strengths = ranges[::-1], None if strengths is None else strengths[::-1]
    if not len(scan):  # a line has a beam at least
        ranges, strengths = np.array([np.nan]), None
    limit = min(scan.range_max, sys.float_info.max)
    remissions = "0" if strengths is None else f"{len(strengths)} {_row(strengths)}"
    tail = "" if pose is None else f"{_row(pose)} {_row(pose)} 0 0 0 0 0 "
    tag = "RAWLASER1" if pose is None else "ROBOTLASER1"
    return (
        f"{tag} 0 {start!r} {step * (len(ranges) - 1)!r} {step!r} {limit!r} 0 0 {len(ranges)} {_row(ranges)} "
        f"{remissions} {tail}{scan.stamp!r} curvescan {scan.stamp!r}\n"
    )


def _losses(scan: LaserScan) -> list[str]:
    lost = []
    if scan.range_min > 0.0:
        lost.append("range_min: a CARMEN log does not give it; readings below it are written as 0")
    if scan.time_increment or scan.scan_time:
        lost.append("time_increment and scan_time: a CARMEN log does not give them")
    if scan.angle_increment < 0.0:
        lost.append("the direction of the sweep: beams are written counter-clockwise, at the same angles")
    return lost


def _row(values: Floats) -> str:
    return " ".join(map(repr, values.tolist()))
