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
from curvescan.types import Bools, Floats, Ints, Points, Pose

MARGIN = 0.1
"""A reading must lie this much nearer than what the earlier scan saw, metres: noise, a small error of the pose."""

SHARE = 0.3  # share of a segment's readings that must be new for all of it to count as moving
LAGS = (1, 3, 6)  # how many scans back the earlier scans lie; at 5 to 10 Hz about the last second
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
    reach = _reach(earlier)
    if earlier.has_uniform_angles:
        layout = earlier.angle_min, earlier.angle_increment
        return _is_passed(current.points, current.valid, pose, reach, *layout, MARGIN)
    x, y = se2.transform(pose, current.points).T
    left, is_seen = _beam_before(earlier, np.arctan2(y, x))
    is_nearer = np.minimum(reach[left], reach[left + 1]) > np.hypot(x, y) + MARGIN
    return np.asarray(is_seen & current.valid & is_nearer)


@kernel
def _is_passed(
    points: Points, valid: Bools, pose: Pose, reach: Floats, angle_min: float, step: float, margin: float
) -> Bools:
    """Return (n,) whether the beams on both sides of each reading, of a scan at `pose`, passed it by a margin."""
    passed = np.zeros(valid.size, dtype=np.bool_)
    way = 1.0 if step > 0.0 else -1.0
    c, s = math.cos(pose[2]), math.sin(pose[2])
    for i in range(valid.size):
        if not valid[i]:
            continue
        x = c * points[i, 0] - s * points[i, 1] + pose[0]
        y = s * points[i, 0] + c * points[i, 1] + pose[1]
        beam = (way * (math.atan2(y, x) - angle_min)) % (2.0 * math.pi) / (way * step)
        if beam < reach.size - 1:
            left = int(beam)
            passed[i] = min(reach[left], reach[left + 1]) > math.sqrt(x * x + y * y) + margin
    return passed


def _beam_before(scan: LaserScan, bearings: Floats) -> tuple[Ints, Bools]:
    """Return the beam that a scan swept just before each bearing, and whether the next beam came just after it."""
    way, step = np.sign(scan.angle_increment), abs(scan.angle_increment)
    turn = np.remainder(way * (bearings - scan.angle_min), 2.0 * np.pi)
    offsets = way * (scan.angles - scan.angle_min)
    beam = np.searchsorted(offsets, turn, side="right") - 1
    # what lies in a hole between two beams was not seen, though both saw past it
    widths = np.append(np.diff(offsets), np.inf)
    is_seen = (beam >= 0) & (widths[beam] < _HOLE * step)
    return np.where(is_seen, beam, 0), is_seen


@lru_cache(maxsize=2 * max(LAGS))  # a scan is the earlier one of three
def _reach(scan: LaserScan) -> Floats:
    """Return (n_beams,) how far each beam is known to have met nothing; 0 where that is not known."""
    free_to_the_end = np.isposinf(scan.ranges) & np.isfinite(scan.range_max)
    return np.where(scan.valid, scan.ranges, np.where(free_to_the_end, scan.range_max, 0.0))
