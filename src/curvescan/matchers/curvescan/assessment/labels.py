"""Labels: what each reading of one scan is to the other scan, at the pose found."""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.association import FORWARD, distances, motion_of, projected
from curvescan.matchers.curvescan.config import REACH, SURE_SIGMAS
from curvescan.matchers.curvescan.features.surfels import RANGE, VARIANCE
from curvescan.matchers.result import Label
from curvescan.types import Bools, Codes, Floats, Ints

# Out of the other scan's sight; where the other scan saw the same surface; where the other scan saw through; what is
# added where all of a surface moved.
OCCLUDED, INLIER, DYNAMIC, MOVED = 0, 1, 2, 4
# Metres, besides twice what may lie apart, by which a reading stands before the other scan's surface to be another
# thing. A reading without a line agrees so far across: of a thing as small as that the far side may be seen.
IN_FRONT = 0.05
_LABELS = (int(Label.NEW), int(Label.MATCHED), int(Label.DYNAMIC))  # of each code
_UNMATCHED = int(Label.UNMATCHED)

_MIN_PARTNERS = 4  # readings of a segment from which on its mean says whether it moved


@inlined
def agreeing_limits(surfels: Floats, i: int, surfels_other: Floats, j: int, margin: float) -> tuple[float, float]:
    """Return how far across and along the other's line a reading of the same surface may lie, metres."""
    if surfels[i, VARIANCE] < 0.0 or surfels_other[j, VARIANCE] < 0.0:
        return IN_FRONT + margin, REACH
    variance = surfels[i, VARIANCE] + surfels_other[j, VARIANCE]
    reach = REACH + REACH * surfels_other[j, RANGE]
    return SURE_SIGMAS * math.sqrt(variance) + margin, reach


@kernel
def beam_labels(n_ref: int, idx_ref: Ints, codes_ref: Codes, n_cur: int, idx_cur: Ints, codes_cur: Codes) -> Codes:
    """Return (n_ref + n_cur,) a Label for each beam of two scans, of the codes of their readings, if there are any."""
    labels = np.zeros(n_ref + n_cur, dtype=np.uint8)
    for i in range(idx_ref.size):
        labels[idx_ref[i]] = _LABELS[codes_ref[i] % MOVED] if codes_ref.size else _UNMATCHED
    for i in range(idx_cur.size):
        labels[n_ref + idx_cur[i]] = _LABELS[codes_cur[i] % MOVED] if codes_cur.size else _UNMATCHED
    return labels


@kernel
def static_segments(
    surfels: Floats, bounds: Ints, partner: Ints, surfels_other: Floats, pose: Floats, limit: float, least: float
) -> tuple[Bools, int]:
    """Return which readings are of surfaces that did not move as a whole, and how many surfaces did.

    A leg that took a small step agrees reading by reading, and yet lies to one side with all of them: a surface has
    moved when the mean distance of its readings from their partners' lines exceeds `limit` standard deviations of
    that mean, and `least` metres: lasers have errors that the readings of a wall share. One with fewer than four
    partners has not. partner (m,): reading of the other scan, -1 for none; pose: of the readings' scan in the other.
    """
    is_static = np.empty(surfels.shape[0], dtype=np.bool_)
    n_dynamic = 0
    motion = motion_of(pose, FORWARD)
    for k in range(bounds.size - 1):
        total, variance, n = 0.0, 0.0, 0
        for i in range(bounds[k], bounds[k + 1]):
            j = partner[i]
            if j < 0 or surfels[i, VARIANCE] < 0.0 or surfels_other[j, VARIANCE] < 0.0:
                continue
            x, y = projected(surfels, i, motion)
            total += distances(x, y, surfels_other, j)[0]
            variance += surfels[i, VARIANCE] + surfels_other[j, VARIANCE]
            n += 1
        has_moved = n >= _MIN_PARTNERS and total * total > max(limit * limit * variance, (least * n) ** 2)
        n_dynamic += has_moved
        for i in range(bounds[k], bounds[k + 1]):
            is_static[i] = not has_moved
    return is_static, n_dynamic
