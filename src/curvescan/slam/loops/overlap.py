"""Overlap: how much of what one keyframe sees others see too, foretold from coarse range profiles.

Matching two scans that have nothing in common is what costs most. A profile holds the mean range of each sector; its
ends, carried to the other keyframe, are seen there if they lie in its field of view and not behind what it sees.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.scan import LaserScan
from curvescan.types import Floats, Ints, Pose

N_SECTORS = 72
"""Sectors of 5 deg."""

_BEHIND = 0.5
"""So far behind what a keyframe sees, metres and share of the range, a place counts as hidden."""


def range_profile(scan: LaserScan) -> Floats:
    """Return (2, N_SECTORS) mean and greatest range of each sector from -pi on; 0 where there is no reading."""
    valid = scan.valid
    angles, ranges = scan.angles[valid], scan.ranges[valid]
    sector = np.floor((angles + math.pi) / (2.0 * math.pi) * N_SECTORS).astype(np.int64) % N_SECTORS
    count = np.bincount(sector, minlength=N_SECTORS)
    mean = np.bincount(sector, ranges, minlength=N_SECTORS) / np.maximum(count, 1)
    greatest = np.zeros(N_SECTORS)
    np.maximum.at(greatest, sector, ranges)
    return np.stack((mean, greatest))


@kernel
def foretold_overlap(profiles: Floats, rows: Ints, relative: Pose, newest: Floats) -> Floats:
    """Return the (k,) smaller of the shares that each keyframe sees of the newest, at (k, 3), and the newest of it."""
    shares = np.empty(len(rows))
    for n in range(len(rows)):
        x, y, theta = relative[n, 0], relative[n, 1], relative[n, 2]
        c, s = math.cos(theta), math.sin(theta)
        there = _seen_share(newest, profiles[rows[n]], x, y, theta)
        back = _seen_share(profiles[rows[n]], newest, -c * x - s * y, s * x - c * y, -theta)
        shares[n] = min(there, back)
    return shares


@kernel
def new_shares(profiles: Floats, poses: Pose) -> Floats:
    """Return the (n,) share of what each keyframe sees that none before it sees, each at one of (n, 3) poses."""
    shares = np.empty(len(profiles))
    for n in range(len(profiles)):
        is_new = profiles[n, 0] > 0.0
        n_all = np.count_nonzero(is_new)
        for b in range(n):
            c, s = math.cos(poses[b, 2]), math.sin(poses[b, 2])
            dx, dy = poses[n, 0] - poses[b, 0], poses[n, 1] - poses[b, 1]
            x, y, theta = c * dx + s * dy, c * dy - s * dx, poses[n, 2] - poses[b, 2]
            for k in np.flatnonzero(is_new):
                is_new[k] = not _is_seen(int(k), profiles[n], profiles[b], x, y, theta)
        shares[n] = float(np.count_nonzero(is_new)) / max(float(n_all), 1.0)
    return shares


@kernel
def _seen_share(points: Floats, viewer: Floats, x: float, y: float, theta: float) -> float:
    """Return the share of a profile's ends that another sees, the first at pose (x, y, theta) in the other."""
    n_all = n_seen = 0
    for k in range(points.shape[1]):
        if points[0, k] > 0.0:
            n_all += 1
            n_seen += _is_seen(k, points, viewer, x, y, theta)
    return n_seen / max(n_all, 1)


@kernel
def _is_seen(k: int, points: Floats, viewer: Floats, x: float, y: float, theta: float) -> bool:
    """Return whether another sees the end of sector k of a profile."""
    n = points.shape[1]
    step = 2.0 * math.pi / n
    angle = theta - math.pi + (k + 0.5) * step
    px, py = x + points[0, k] * math.cos(angle), y + points[0, k] * math.sin(angle)
    far = viewer[1, int((math.atan2(py, px) + math.pi) / step) % n]
    return bool(far > 0.0 and math.sqrt(px * px + py * py) < far + _BEHIND)
