"""What a match leaves open: how a corridor runs, and where along it two views lie.

Its walls agree anywhere along it, and views from both ends see other jambs of its doors. But where a pose is wrong, one
scan sees through what the other one sees: a wall where a door is.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan import se2
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Floats, Ints, Points, Pose

_APART_M = 0.05
"""Readings farther apart than this across an open direction are of different walls, metres."""

_FLAT = 0.01
"""Variance of a wall across the direction, of that along it: of more it is none."""

_SHIFTS = _APART_M * np.arange(-20, 21)
"""Places that are tried, metres along: within a metre of the match."""

_N_WIDEST, _FAR_M = 11, 8
"""Places in a row that still count as one, known to 0.3 m; readings farther away than this, metres, say nothing."""

_N_SLOTS = 2048
"""Directions of a view, all around."""


def placed(found: UncertainPose, along: Pose, reference: LaserScan, current: LaserScan) -> UncertainPose | None:
    """Return where a match lies along the way that it leaves open; None where the scans do not tell.

    along (3,): as of :func:`along_walls`.
    """
    poses = found.pose + _SHIFTS[:, np.newaxis] * along
    n = _n_through(current, reference, poses) + _n_through(reference, current, se2.inverse(poses))
    first, last = np.flatnonzero(n <= n.min() + 4 * (1.0 + math.sqrt(n.min())))[[0, -1]].tolist()  # more is no chance
    if first == 0 or last == len(_SHIFTS) - 1 or last - first >= _N_WIDEST:
        return None
    low, high = _SHIFTS[[first - 1, last + 1]].tolist()
    spread, width = found.cov @ along, high - low  # twice what one errs by: places of a stretch err alike
    cov = found.cov - np.outer(spread, spread) / (along @ spread + width * width)
    return UncertainPose(found.pose + 0.5 * (low + high) * along, cov)


def _n_through(seen: LaserScan, viewer: LaserScan, poses: Pose) -> Ints:
    """Return (k,) how many readings of a scan the viewer sees through, with that scan at each of (k, 3) poses."""
    points, (c, s) = seen.points[seen.valid], (math.cos(poses[0, 2]), math.sin(poses[0, 2]))
    x = poses[:, :1] + (c * points[:, 0] - s * points[:, 1])
    y = poses[:, 1:2] + (s * points[:, 0] + c * points[:, 1])
    slot = np.floor(np.arctan2(y, x) * (_N_SLOTS / (2.0 * math.pi))).astype(np.int64)
    noise = [float(np.median(np.abs(np.diff(one.ranges[one.valid], 2)))) for one in (seen, viewer)]  # times 1.7
    margin = max(_APART_M, math.hypot(*noise))
    return np.asarray(np.sum(np.hypot(x, y) < np.minimum(_sight(viewer)[slot] - margin, _FAR_M), axis=1))


def _sight(scan: LaserScan) -> Floats:
    """Return (_N_SLOTS,) how far a scan sees at the least in each direction from 0 on: the nearer of two readings."""
    angles = se2.wrap(scan.angles)
    order = np.argsort(angles, kind="stable")
    angles, ranges = angles[order], np.where(scan.valid, scan.ranges, 0.0)[order]
    middles = se2.wrap((np.arange(_N_SLOTS) + 0.5) * (2.0 * math.pi / _N_SLOTS))
    after = np.searchsorted(angles, middles) % len(angles)
    is_seen = (angles[after] - angles[after - 1]) % (2.0 * math.pi) < 2.0 * abs(scan.mean_increment)
    return np.where(is_seen, np.minimum(ranges[after], ranges[after - 1]), 0.0)


def along_walls(points: Points, direction: Pose) -> Pose:
    """Return an open direction, (x, y, theta), turned to how the walls beside it run, of length 1 and without its turn.

    A match has it by the normals of single readings, to some milliradians: of one that stands still a way of 2 m seems
    to lead 4 mm into the wall, and many edges shorten the corridor by a tenth. The walls run straight over metres, and
    say it to 0.2 milliradians. A turn, little in a way of 1 m, would open the heading where it is 100 m.

    points (n, 2): of the reference scan, in whose frame the direction is.
    """
    along = direction[:2] / np.hypot(direction[0], direction[1])
    for _ in range(3):  # two walls in one line part only where the direction is nearly right
        across = np.array([-along[1], along[0]])
        order = np.argsort(points @ across, kind="stable")
        x, y = points[order] @ along, points[order] @ across
        wall = np.cumsum(np.diff(y, prepend=y[:1]) > _APART_M)
        n = np.bincount(wall)
        x -= (np.bincount(wall, x) / n)[wall]
        y -= (np.bincount(wall, y) / n)[wall]
        is_flat = (np.bincount(wall, y * y) < _FLAT * np.bincount(wall, x * x))[wall]
        if not is_flat.any():
            break
        along = along + float(np.sum((x * y)[is_flat]) / np.sum((x * x)[is_flat])) * across
        along /= np.hypot(along[0], along[1])
    return np.array([*along, 0.0])
