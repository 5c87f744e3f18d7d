"""What a match leaves open: how a corridor runs, and where along it two views lie.

Its walls agree anywhere along it, and views from both ends see other jambs of its doors. But where a pose is wrong, one
scan sees through what the other one sees: a wall where a door is.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan import se2
from curvescan._jit import kernel
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Floats, Ints, Points, Pose

_APART_M = 0.05
"""Readings farther apart across an open direction are of different walls, metres; nearer are a 16th of all in one."""

_SHIFTS = _APART_M * np.arange(-20, 21)
"""Places that are tried, metres along: within a metre of the match."""

_N_WIDEST = 11
"""Places in a row that still count as one, known to 0.3 m."""

_THING_M = 0.5
"""Readings nearer to each other are of one thing, metres."""

_FAR_M = 8
"""Metres beyond which readings say nothing."""

_N_SLOTS = 2048
"""Directions that a view has, all around."""


def within_sight(found: UncertainPose, along: Pose, reference: LaserScan, current: LaserScan) -> UncertainPose:
    """Return a match with what it claims of the way that it leaves open: that both scans see one place."""
    seen, other = (one.points[one.valid] for one in (reference, current))
    x, y = seen @ along[:2], se2.transform(found.pose, other) @ along[:2]
    # what they share falls from all to nothing as the one is moved past the other: a triangle
    first, last = x.min() - y.max(), x.max() - y.min()
    return _known_along(found, along, 0.5 * (first + last), (last - first) ** 2 / 24)


def placed(found: UncertainPose, along: Pose, reference: LaserScan, current: LaserScan) -> UncertainPose | None:
    """Return where a match lies along the way that it leaves open, of `along_walls`; None where no scan tells."""
    poses = found.pose + _SHIFTS[:, np.newaxis] * along
    n = n_through(reference, current, poses)
    first, last = np.flatnonzero(n <= n.min() + 4 * (1.0 + math.sqrt(n.min())))[[0, -1]].tolist()  # more is no chance
    if first == 0 or last == len(_SHIFTS) - 1 or last - first >= _N_WIDEST:
        return None
    low, high = _SHIFTS[[first - 1, last + 1]].tolist()
    # twice what one errs by: places of a stretch err alike
    return _known_along(found, along, 0.5 * (low + high), (high - low) ** 2)


def _known_along(found: UncertainPose, along: Pose, way: float, variance: float) -> UncertainPose:
    """Return a match with another measurement of how far along it lies from where it is."""
    spread = found.covariance @ along
    gain = spread / (along @ spread + variance)
    return UncertainPose(found.pose + way * gain, found.covariance - np.outer(gain, spread))


def n_through(reference: LaserScan, current: LaserScan, poses: Pose) -> Ints:
    """Return (k,) how many readings of two scans the other one sees through, with the current one at (k, 3) poses.

    One thing in each does not count, the one of the most such readings: somebody may have walked there.
    """
    noise = (float(np.median(np.abs(np.diff(one.ranges[one.valid], 2)))) for one in (reference, current))  # times 1.7
    margin, found = max(_APART_M, math.hypot(*noise)), np.zeros(len(poses), dtype=np.int64)
    for seen, viewer, at in ((current, reference, poses), (reference, current, se2.inverse(poses))):
        angles, ranges = se2.wrap(viewer.angles), np.where(viewer.valid, viewer.ranges, 0.0)
        order, gap = np.argsort(angles, kind="stable"), 2.0 * abs(viewer.mean_increment)
        found += _count(seen.points[seen.valid], angles[order], ranges[order], gap, at, margin)
    return found


@kernel
def _count(points: Points, angles: Floats, ranges: Floats, gap: float, poses: Pose, margin: float) -> Ints:
    """Return (k,) how many points (n, 2), moved by (k, 3) poses, lie before what two beams see, but for one thing's.

    angles (m,): of the beams, sorted; ranges (m,): 0 without a reading; gap: angle between beams that have one missing.
    """
    sight, step = np.zeros(_N_SLOTS), 2.0 * math.pi / _N_SLOTS
    for k in range(angles.size):
        low = angles[k - 1] - (2.0 * math.pi if k == 0 else 0.0)
        if angles[k] - low < gap:
            for slot in range(math.ceil(low / step - 0.5), math.ceil(angles[k] / step - 0.5)):
                sight[slot % _N_SLOTS] = min(ranges[k - 1], ranges[k])
    n = np.zeros(len(poses), dtype=np.int64)
    for k in range(len(poses)):
        c, s = math.cos(poses[k, 2]), math.sin(poses[k, 2])
        last = n_one = n_most = 0
        for i in range(len(points)):
            x = poses[k, 0] + c * points[i, 0] - s * points[i, 1]
            y = poses[k, 1] + s * points[i, 0] + c * points[i, 1]
            free = min(sight[math.floor(math.atan2(y, x) / step) % _N_SLOTS] - margin, _FAR_M)
            if free > 0.0 and x * x + y * y < free * free:
                apart = math.hypot(points[i, 0] - points[last, 0], points[i, 1] - points[last, 1])
                n_one = n_one + 1 if apart < _THING_M else 1
                n[k], n_most, last = n[k] + 1, max(n_most, n_one), i
        n[k] -= n_most
    return n


def along_walls(points: Points, direction: Pose) -> Pose:
    """Return an open direction, (x, y, theta), turned to how the walls beside it run, of length 1 and without its turn.

    A match has it by the normals of single readings, to some milliradians, and many such edges shorten a corridor by a
    tenth. Its walls say it to 0.2 milliradians. A turn, little in a way of 1 m, would open the heading in 100 m.

    points (n, 2): of the reference scan, in whose frame the direction is.
    """
    along, m = direction[:2] / np.hypot(*direction[:2]), len(points) // 32
    for _ in range(3):  # two walls in one line part only where the direction is nearly right
        across = np.array([-along[1], along[0]])
        order = np.argsort(points @ across, kind="stable")
        x, y = points[order] @ along, points[order] @ across
        # not what crosses the way: jambs, and the end of the corridor
        is_wall = y[2 * m :] - y[: len(y) - 2 * m] < _APART_M
        x, y = x[m : len(x) - m][is_wall], y[m : len(y) - m][is_wall]
        wall = np.cumsum(np.diff(y, prepend=y[:1]) > _APART_M)
        for one in (x, y):
            one -= (np.bincount(wall, one) / np.bincount(wall))[wall]
        along = along + float(x @ y / (x @ x or 1.0)) * across
        along /= np.hypot(along[0], along[1])
    return np.array([*along, 0.0])
