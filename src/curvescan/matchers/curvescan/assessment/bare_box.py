"""Bare boxes: places as small as the cabin of an elevator, of which nothing but walls agrees.

A sensor that sees half a circle has two or three walls of such a place in sight, and two walls fit any corner. A robot
turns round in it, what is seen through the door may be another floor, and nothing that is hidden contradicts: the right
pose and one turned by a quarter look alike.
"""

from __future__ import annotations

import numpy as np

from curvescan.matchers.curvescan.assessment.assessment import Assessment
from curvescan.matchers.curvescan.assessment.confidence import ANY, WeighedPoses
from curvescan.matchers.curvescan.assessment.evidence import BEYOND, SMALL
from curvescan.matchers.curvescan.assessment.labels import INLIER
from curvescan.matchers.curvescan.config import NEAR
from curvescan.matchers.curvescan.features.features import CurvescanFeatures
from curvescan.matchers.curvescan.features.surfels import X, Y
from curvescan.types import Codes, Floats

_SIZE = 2.3  # metres from corner to corner of what agrees: in less a robot turns round
_N_TAKEN = 48  # readings that stand for all where an extent is measured


def is_in_box(ref: CurvescanFeatures, cur: CurvescanFeatures, weighed: WeighedPoses, assessment: Assessment) -> bool:
    """Return whether only the walls of a small bare place agree at the first pose, and the robot may have turned in it.

    Neither a guess nor standing still speaks for the pose.
    """
    best = weighed.evidence[0]
    if best[BEYOND] >= ANY or best[SMALL] > ANY:
        return False
    if weighed.is_guessed[0] or weighed.motions[0] <= NEAR:
        return False
    sizes = (extent(ref.image.surfels, assessment.codes_ref), extent(cur.image.surfels, assessment.codes_cur))
    return max(sizes) < _SIZE


def extent(surfels: Floats, codes: Codes) -> float:
    """Return how far from each other the readings that agree lie at most, metres; of many, some stand for all."""
    agreeing = surfels[codes == INLIER][:, [X, Y]]
    some = agreeing[:: max(len(agreeing) // _N_TAKEN, 1)]
    offsets = some[:, np.newaxis] - some
    return float(np.sqrt((offsets**2).sum(axis=2).max(initial=0.0)))
