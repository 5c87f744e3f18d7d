"""The columns of a scan in our CSV and NPZ: names, what may be missing, and the scan that they make."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from curvescan.errors import InvalidArgumentError
from curvescan.io.files.read_errors import BrokenRecordError
from curvescan.io.log import NO_POSE, PoseRow
from curvescan.scan import LaserScan
from curvescan.types import Floats

OPTIONAL: Mapping[str, float] = {"range_min": 0.0, "range_max": math.inf, "time_increment": 0.0, "scan_time": 0.0}
"""Numbers of a scan that a file may leave out, and what is then taken."""
DEFAULTS: Mapping[str, float] = {"angle_min": math.nan, "angle_increment": math.nan, **OPTIONAL}
COLUMNS = ("stamp", *DEFAULTS)
POSE_COLUMNS = ("x", "y", "theta")  # wheel odometry: pose of the laser at the scan


def make_scan(
    value: Mapping[str, float], ranges: Floats, angles: Floats | None, intensities: Floats | None
) -> LaserScan:
    """Return the scan of the numbers of COLUMNS and its (n,) ranges; angles replace angle_min and angle_increment."""
    if not math.isfinite(value["stamp"]):
        raise BrokenRecordError("time stamp not finite")
    if not 0.0 <= value["range_min"] < value["range_max"]:
        raise BrokenRecordError("range limits break 0 <= range_min < range_max")
    given = ("angle_min", "angle_increment") if angles is None else ()
    fields: dict[str, Any] = {name: value[name] for name in ("stamp", *given, *OPTIONAL)}
    try:
        if angles is None:
            return LaserScan(ranges, intensities=intensities, **fields)
        return LaserScan(ranges, angles=angles, intensities=intensities, **fields)
    except InvalidArgumentError:
        raise BrokenRecordError("angles or times that make no scan") from None


def make_pose(x: float, y: float, theta: float) -> PoseRow:
    """Return a pose of the wheels, unknown where a number is."""
    return (x, y, theta) if math.isfinite(x) and math.isfinite(y) and math.isfinite(theta) else NO_POSE


def is_on_grid(scan: LaserScan) -> bool:
    """Return whether angle_min and angle_increment give the beams' directions to the bit."""
    grid = scan.angle_min + scan.angle_increment * np.arange(len(scan), dtype=np.float64)
    return scan.has_uniform_angles and np.array_equal(grid, scan.angles)
