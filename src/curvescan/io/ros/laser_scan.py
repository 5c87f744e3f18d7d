"""LaserScan from sensor_msgs/LaserScan."""

from __future__ import annotations

import math
from typing import Any

from curvescan.errors import InvalidArgumentError
from curvescan.io.files.read_errors import BrokenRecordError
from curvescan.io.ros.messages import stamp_of
from curvescan.scan import LaserScan

NO_FIELDS = "LaserScan message without the usual fields"
BAD_ANGLES = "LaserScan header whose angle_min or angle_increment is not finite, or the increment 0"
BAD_LIMITS = "LaserScan header whose range limits break 0 <= range_min < range_max"


def scan_of(message: Any, *, stamp: float | None = None, range_max: float | None = None) -> LaserScan:
    """Return the LaserScan of a sensor_msgs/LaserScan message. Raises BrokenRecordError."""
    try:
        angle_min, step = float(message.angle_min), float(message.angle_increment)
        low = float(message.range_min)
        high = float(message.range_max) if range_max is None else range_max
        when = stamp_of(message.header) if stamp is None else stamp
        ranges, intensities = message.ranges, message.intensities
        n_beams, n_intensities = len(ranges), len(intensities)
    except (AttributeError, TypeError, ValueError, OverflowError) as error:
        raise BrokenRecordError(NO_FIELDS) from error
    if not (math.isfinite(angle_min) and math.isfinite(step) and step != 0.0):
        raise BrokenRecordError(BAD_ANGLES)
    if not 0.0 <= low < high:
        raise BrokenRecordError(BAD_LIMITS)
    times = _times(message)
    try:
        return LaserScan(
            ranges,
            angle_min=angle_min,
            angle_increment=step,
            range_min=low,
            range_max=high,
            stamp=when,
            intensities=intensities if n_beams == n_intensities > 0 else None,
            time_increment=_seconds(times[0]),
            scan_time=_seconds(times[1]),
        )
    except InvalidArgumentError as error:
        raise BrokenRecordError(NO_FIELDS) from error


def has_bad_times(message: Any) -> bool:
    """Return whether a message gives a time of beams or sweeps that is none: negative, infinite, not a number."""
    return not all(0.0 <= t < math.inf for t in _times(message))


def _times(message: Any) -> tuple[float, float]:
    try:
        return float(message.time_increment), float(message.scan_time)
    except (AttributeError, TypeError, ValueError, OverflowError):
        return 0.0, 0.0  # a definition of the bag's own that goes without


def _seconds(value: float) -> float:
    return value if 0.0 <= value < math.inf else 0.0
