"""Movable things: small ones that stand free, as people do, and what the scans say of a pose without them.

A few people who keep pace with the robot stand still in its frame. Where nothing else fixes a direction, as in a bare
corridor, they would fix it, and wrongly; so what few free-standing things alone hold is taken for unobservable.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.assessment.assessment import Assessment
from curvescan.matchers.curvescan.assessment.information import pose_information
from curvescan.matchers.curvescan.assessment.labels import INLIER
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.features.features import CurvescanFeatures
from curvescan.matchers.curvescan.features.small_things import PERSON_EXTENT, extent_and_steps
from curvescan.types import Bools, Codes, Floats, Ints, Pose

_STANDS_FREE = 0.3  # metres: by so much at least are the surfaces on both sides farther away
_MAX_THINGS = 6  # more of them do not keep pace by chance
_WEAK = 0.5  # of the next direction's information: only a direction with less is looked at


def without_movable(
    ref: CurvescanFeatures, cur: CurvescanFeatures, pose: Pose, assessment: Assessment, config: CurvescanConfig
) -> Assessment:
    """Return the assessment; where only movable things fix a direction, their information is taken out."""
    if assessment.information[0] > _WEAK * assessment.information[1]:
        return assessment
    is_free = [
        free_standing(one.image.surfels, one.bounds, codes)
        for one, codes in ((ref, assessment.codes_ref), (cur, assessment.codes_cur))
    ]
    counts = [n for _, n in is_free]
    if max(counts) == 0 or max(counts) > _MAX_THINGS:
        return assessment
    information, spurious, axes, units = information_without(
        ref.image.surfels,
        assessment.partner_ref,
        is_free[0][0],
        cur.image.surfels,
        assessment.partner_cur,
        is_free[1][0],
        pose,
    )
    rules = config.information
    left = replace(assessment, information=information, spurious=spurious, axes=axes, units=units)
    # bare walls leave nothing but what their tilt seems to say; walls with a door or two leave enough
    is_left_open = information[0] < max(rules.max_sigma**-2, 2.0 * spurious[0])
    return left if is_left_open else assessment


@kernel
def free_standing(surfels: Floats, bounds: Ints, codes: Codes) -> tuple[Bools, int]:
    """Return which readings are of small things that stand free, and how many such things agree."""
    is_free = np.zeros(surfels.shape[0], dtype=np.bool_)
    n_things = 0
    for k in range(bounds.size - 1):
        extent2, before, behind = extent_and_steps(surfels, bounds, k)
        if extent2 > PERSON_EXTENT * PERSON_EXTENT:
            continue
        # another person may hide one side
        if max(before, behind) < _STANDS_FREE or min(abs(before), abs(behind)) < _STANDS_FREE:
            continue
        n_inliers = 0
        for i in range(bounds[k], bounds[k + 1]):
            is_free[i] = True
            n_inliers += codes[i] == INLIER
        n_things += n_inliers > 0
    return is_free, n_things


@kernel
def information_without(
    ref: Floats,
    partner_ref: Ints,
    is_left_out_ref: Bools,
    cur: Floats,
    partner_cur: Ints,
    is_left_out_cur: Bools,
    pose: Floats,
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the pose information, as :func:`pose_information` does, without the readings that are left out."""
    left_ref, left_cur = partner_ref.copy(), partner_cur.copy()
    for i in range(left_cur.size):
        left_cur[i] = -1 if is_left_out_cur[i] else left_cur[i]
    for i in range(left_ref.size):
        left_ref[i] = -1 if is_left_out_ref[i] else left_ref[i]
    return pose_information(ref, left_ref, cur, left_cur, pose)
