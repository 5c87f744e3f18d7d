"""The lag of a log's odometry: how much later than the scans its headings turn.

Without a common clock a robot's wheels are stamped late, or early. The turns between scans (see ``rotation_direction``)
are compared with those of the odometry moved in time: the lag is where the two agree best.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from itertools import pairwise

import numpy as np

from curvescan import se2
from curvescan.diagnostics.rotation_direction import turn_between
from curvescan.scan import LaserScan
from curvescan.types import Floats

_N_WINDOWS = 12
_WINDOW = 15  # steps on either side of a sharp turn that are compared
_LAGS = np.arange(-10, 31) * 0.05  # lags that are tried, seconds: an odometry is late more often than early

_LEAST_LAG = 0.1
_BETTER = 0.6  # a lag is found where it leaves less than this share of the differences

_MIN_STEPS = 30


def odometry_lag(scans: Iterable[LaserScan], headings: Floats) -> float:
    """Return by how many seconds the (n,) headings of a log, radians or NaN, are late; 0 if no delay is found."""
    turns = se2.wrap(np.diff(headings))
    sharpness = np.where(np.isfinite(turns), np.abs(turns), 0.0)
    wanted = _windows(sharpness)
    stamps: list[float] = []
    rows: list[int] = []
    seen: list[float] = []
    for k, (earlier, later) in enumerate(pairwise(scans)):
        if not stamps:
            stamps.append(earlier.stamp)
        stamps.append(later.stamp)
        if k in wanted:
            rows.append(k)
            seen.append(turn_between(earlier, later))
    times = np.array(stamps)
    known = np.isfinite(headings[: times.size])
    if len(rows) < _MIN_STEPS or not known.all() or not (np.diff(times) > 0.0).all():
        return 0.0
    by_scans, row = np.array(seen), np.array(rows)
    whole = np.unwrap(headings[: times.size])

    def difference(lag: float) -> float:
        moved = np.interp(times + lag, times, whole)
        return float(np.mean(np.abs(moved[row + 1] - moved[row] - by_scans)))

    differences = np.array([difference(float(lag)) for lag in _LAGS])
    best = int(np.argmin(differences))
    lag = float(_LAGS[best])
    is_clear = differences[best] < _BETTER * difference(0.0) and abs(lag) >= _LEAST_LAG
    return lag if is_clear else 0.0


def without_lag(stamps: Floats, poses: Floats, lag: float) -> Floats:
    """Return poses as they would be without their lag. stamps (n,); poses (n, 3)."""
    columns = (poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2]))
    moved = np.column_stack([np.interp(stamps + lag, stamps, column) for column in columns])
    moved[:, 2] = se2.wrap(moved[:, 2])
    return moved


def _windows(sharpness: Floats) -> set[int]:
    """Return the steps around the sharpest turns."""
    left, wanted = sharpness.copy(), set[int]()
    for _ in range(_N_WINDOWS):
        k = int(np.argmax(left)) if left.size else 0
        if not left.size or left[k] <= math.radians(2.0):
            break
        low, high = max(k - _WINDOW, 0), min(k + _WINDOW + 1, left.size)
        wanted.update(range(low, high))
        left[low:high] = 0.0
    return wanted
