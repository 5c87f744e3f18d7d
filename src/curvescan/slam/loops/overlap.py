"""Overlap: how much of what one keyframe sees another sees too, predicted from coarse range profiles.

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
def predicted_overlap(profiles: Floats, rows: Ints, relative: Pose, newest: Floats, least: float) -> Floats:
    """Return (k,) the smaller share of what two see, the newest at (k, 3) and each keyframe; below `least` either."""
    shares = np.empty(len(rows))
    for n in range(len(rows)):
        x, y, theta = relative[n, 0], relative[n, 1], relative[n, 2]
        c, s = math.cos(theta), math.sin(theta)
        shares[n] = _seen_share(newest, profiles[rows[n]], x, y, theta)
        if shares[n] >= least:
            shares[n] = min(shares[n], _seen_share(profiles[rows[n]], newest, -c * x - s * y, s * x - c * y, -theta))
    return shares


@kernel
def _seen_share(points: Floats, viewer: Floats, x: float, y: float, theta: float) -> float:
    """Return the share of a profile's ends that another sees, the first at pose (x, y, theta) in the other."""
    n = points.shape[1]
    step = 2.0 * math.pi / n
    n_all = n_seen = 0
    # the direction of a sector, and by what it turns to the next
    c, s = math.cos(theta - math.pi + 0.5 * step), math.sin(theta - math.pi + 0.5 * step)
    c_step, s_step = math.cos(step), math.sin(step)
    for k in range(n):
        px, py = x + points[0, k] * c, y + points[0, k] * s
        c, s = c * c_step - s * s_step, s * c_step + c * s_step
        if points[0, k] <= 0.0:
            continue
        n_all += 1
        sector = int((math.atan2(py, px) + math.pi) / step) % n
        far = viewer[1, sector]
        if far > 0.0 and math.sqrt(px * px + py * py) < far + _BEHIND:
            n_seen += 1
    return n_seen / max(n_all, 1)
