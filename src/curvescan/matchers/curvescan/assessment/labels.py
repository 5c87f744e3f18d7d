"""Labels: what each reading of one scan is to the other scan, at the pose found."""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.association import Motion, distances, faces_away, motion_of, projected
from curvescan.matchers.curvescan.config import LIKELY_SIGMAS, REACH, SURE_SIGMAS
from curvescan.matchers.curvescan.features.surfels import RANGE, VARIANCE
from curvescan.matchers.result import Label
from curvescan.types import Codes, Floats, Ints

# Out of the other scan's sight; where the other scan saw the same surface; where the other scan saw through; what is
# added where all of a surface moved.
OCCLUDED, INLIER, DYNAMIC, MOVED = 0, 1, 2, 4
# Metres, besides twice what may lie apart, by which a reading stands before the other scan's surface to be another
# thing. A reading without a line agrees so far across: of a thing as small as that the far side may be seen.
IN_FRONT = 0.05
_LABELS = (int(Label.NEW), int(Label.MATCHED), int(Label.DYNAMIC))  # of each code
_UNMATCHED = int(Label.UNMATCHED)

_MIN_PARTNERS = 4  # readings of a segment from which on its mean says whether it moved
_MOVED2 = (2.0 * LIKELY_SIGMAS) ** 2  # square of the standard deviations beyond which that mean has


@inlined
def agreeing_limits(
    surfels: Floats, i: int, surfels_other: Floats, j: int, margin: float, motion: Motion
) -> tuple[float, float]:
    """Return how far across and along the other's line a reading of the same surface may lie, metres.

    Along none where the other sensor would see it from behind: the two sides of a wall are not the same surface.
    """
    if surfels[i, VARIANCE] < 0.0 or surfels_other[j, VARIANCE] < 0.0:
        return IN_FRONT + margin, REACH
    variance = surfels[i, VARIANCE] + surfels_other[j, VARIANCE]
    reach = 0.0 if faces_away(surfels, i, motion) else REACH + REACH * surfels_other[j, RANGE]
    return SURE_SIGMAS * math.sqrt(variance) + margin, reach


@kernel
def beam_labels(n_beams: int, beam_idx: Ints, codes: Codes) -> Codes:
    """Return (n_beams,) a Label for each beam of a scan, of the codes of its readings, if there are any."""
    labels = np.zeros(n_beams, dtype=np.uint8)
    for i in range(beam_idx.size):
        labels[beam_idx[i]] = _LABELS[codes[i] % MOVED] if codes.size else _UNMATCHED
    return labels


@kernel
def mark_moved(
    surfels: Floats, bounds: Ints, codes: Codes, partner: Ints, other: Floats, pose: Floats, way: float, least: float
) -> int:
    """Mark readings of surfaces that moved as a whole, and take their partners, in place; return how many did.

    A leg that took a small step agrees reading by reading, and yet lies to one side with all of them: a surface has
    moved when the mean distance of its readings from their partners' lines exceeds four standard deviations of that
    mean, and `least` metres: lasers have errors that the readings of a wall share. One with fewer than four partners
    has not. partner (m,): reading of the other scan, -1 for none.
    """
    n_moved = 0
    motion = motion_of(pose, way)
    for k in range(bounds.size - 1):
        total, variance, n = 0.0, 0.0, 0
        for i in range(bounds[k], bounds[k + 1]):
            j = partner[i]
            if j < 0 or surfels[i, VARIANCE] < 0.0 or other[j, VARIANCE] < 0.0:
                continue
            x, y = projected(surfels, i, motion)
            total += distances(x, y, other, j)[0]
            variance += surfels[i, VARIANCE] + other[j, VARIANCE]
            n += 1
        if n < _MIN_PARTNERS or total * total <= max(_MOVED2 * variance, (least * n) ** 2):
            continue
        n_moved += 1
        for i in range(bounds[k], bounds[k + 1]):
            codes[i] = MOVED + (DYNAMIC if codes[i] == INLIER else codes[i])
            partner[i] = -1
    return n_moved
