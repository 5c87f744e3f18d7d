"""Which readings of a scan belong to something that moves, given where earlier scans were taken from.

A reading that lies where an earlier scan looked through is of something that was not there before. A walker moves less
than his own width from one scan to the next, so scans of about the last second are compared. A segment of which a part
is new is taken to move as a whole.

After Núñez et al. 2009, section 2.2: the segments without a partner are the dynamic ones. A free-space violation
separates what moved from what only came into view.
"""

import math
from collections import deque
from collections.abc import Iterable, Iterator, Sequence
from functools import lru_cache

import numpy as np

from curvescan import se2
from curvescan._jit import kernel
from curvescan.matchers.cfsma.config import SegmentationConfig
from curvescan.matchers.cfsma.segmentation import segment
from curvescan.scan import LaserScan, valid_readings
from curvescan.types import Bools, Floats, Points, Pose

MARGIN = 0.1
"""A reading must lie this much nearer than what the earlier scan saw, metres: noise, a small error of the pose."""

SHARE = 0.3  # share of a segment's readings that must be new for all of it to count as moving
LAGS = (1, 3, 6)  # how many scans back the earlier scans lie; at 5 to 10 Hz about the last second
_NO_OFFSETS = np.empty(0)
_HOLE = 3.5  # steps between two unevenly spaced beams from which on the sensor looked away between them

_SEGMENTS = SegmentationConfig(range_sigma=0.01, min_readings=3)


def dynamic_readings(current: LaserScan, earlier: Sequence[tuple[LaserScan, Pose]]) -> Bools:
    """Return which readings of a scan lie on something that moved since the earlier scans. result (n_beams,)."""
    is_new = np.zeros(len(current), dtype=np.bool_)
    for scan, pose in earlier:
        is_new |= _was_free(current, scan, pose)
    moved = is_new.copy()
    if not is_new.any():
        return moved
    readings = valid_readings(current)
    segments = segment(readings, _SEGMENTS)
    beams = readings.beam_idx[segments.order]
    n_new = np.concatenate([[0], np.cumsum(is_new[beams])])
    shares = (n_new[segments.stops] - n_new[segments.starts]) / (segments.stops - segments.starts)
    for k in np.flatnonzero(shares > SHARE).tolist():
        moved[beams[segments.starts[k] : segments.stops[k]]] = True
    return moved


def dynamic_along(scans: Iterable[LaserScan], poses: Pose, is_joined: Bools) -> Iterator[Bools]:
    """Yield the dynamic readings of each scan of a run, poses (n, 3), by comparison with the scans before it."""
    relative_to = {lag: se2.between(poses[:-lag], poses[lag:]) for lag in LAGS}  # all at once: fast
    history: deque[LaserScan] = deque(maxlen=max(LAGS))
    for k, (scan, joined) in enumerate(zip(scans, is_joined, strict=False)):
        if not joined:
            history.clear()
        lags = [lag for lag in LAGS if lag <= len(history)]
        yield dynamic_readings(scan, [(history[-lag], relative_to[lag][k - lag]) for lag in lags])
        history.append(scan)


def _was_free(current: LaserScan, earlier: LaserScan, pose: Pose) -> Bools:
    """Return (n_beams,) whether the earlier scan looked through the place of each reading."""
    if len(earlier) < 2:
        return np.zeros(len(current), dtype=np.bool_)
    first, step = earlier.angle_min, earlier.angle_increment
    offsets = _NO_OFFSETS if earlier.has_uniform_angles else math.copysign(1.0, step) * (earlier.angles - first)
    return _is_passed(current.points, current.valid, pose, first, step, offsets, _reach(earlier))


@kernel
def _is_passed(
    points: Points, valid: Bools, pose: Pose, first: float, step: float, offsets: Floats, reach: Floats
) -> Bools:
    """Return (n,) whether the beams on both sides of each reading, of a scan at `pose`, passed it by the margin.

    offsets: turn of each beam from the first, radians; empty where they are even. What lies in a hole between two beams
    was not seen, though both saw past it.
    """
    way, step = 1.0 if step > 0.0 else -1.0, abs(step)
    passed = np.zeros(valid.size, dtype=np.bool_)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(valid.size):
        if not valid[i]:
            continue
        x = c * points[i, 0] - s * points[i, 1] + pose[0]
        y = s * points[i, 0] + c * points[i, 1] + pose[1]
        turn = (way * (math.atan2(y, x) - first)) % (2.0 * math.pi)
        low, high = min(int(turn / step), reach.size), reach.size
        if offsets.size:
            low = -1
            while high - low > 1:
                middle = (low + high) // 2
                low, high = (middle, high) if offsets[middle] <= turn else (low, middle)
            if low >= 0 and low < reach.size - 1 and offsets[low + 1] - offsets[low] >= _HOLE * step:
                continue
        if 0 <= low < reach.size - 1:
            passed[i] = min(reach[low], reach[low + 1]) > math.sqrt(x * x + y * y) + MARGIN
    return passed


@lru_cache(maxsize=2 * max(LAGS))  # a scan is the earlier one of three
def _reach(scan: LaserScan) -> Floats:
    """Return (n_beams,) how far each beam is known to have met nothing; 0 where that is not known."""
    free_to_the_end = (scan.ranges == math.inf) & math.isfinite(scan.range_max)
    return np.where(scan.valid, scan.ranges, np.where(free_to_the_end, scan.range_max, 0.0))
