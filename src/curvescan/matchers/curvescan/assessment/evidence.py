"""Evidence: what the surfaces of both scans say for a pose and against it, in metres of surface.

Surfaces that stand free and are no larger than a person may have moved between the scans; what contradicts a pose at
any other surface is a wall seen through. Docs: docs/design-notes/confidence.md.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.assessment.labels import DYNAMIC, IN_FRONT, INLIER, OCCLUDED, agreeing_limits
from curvescan.matchers.curvescan.assessment.walls import excess_lengths
from curvescan.matchers.curvescan.association import BACKWARD, FORWARD, associate, is_seen_through, motion_of, project
from curvescan.matchers.curvescan.features.features import CurvescanFeatures
from curvescan.matchers.curvescan.features.range_image import reading_beside
from curvescan.matchers.curvescan.features.surfels import LENGTH, NX, NY, RANGE, VARIANCE
from curvescan.types import Codes, Floats, Ints

# Columns of an evidence. Metres of surface, the mean of both scans: that agrees; of that besides the two walls, not
# parallel, that agree most; that agrees and fixes the direction fixed least; MISFIT has no unit: mean squared distance
# of readings that agree over their variance; nearer than two readings of the other scan side by side, so seen through,
# and no small thing; small things that are seen through; that agrees besides those two walls and the two that face
# them, which are all of a bare room.
AGREEING, EXCESS, WEAKEST, MISFIT, SEEN_THROUGH, SMALL, BEYOND = range(7)
N_EVIDENCE = BEYOND + 1

# Of the readings of the reference, and of those of the current scan: what each is to the other scan, a code of
# labels.py, and the reading there that it agrees with, -1 without one.
Compared: TypeAlias = tuple[Codes, Ints, Codes, Ints]


@kernel
def gather_evidence(
    ref: CurvescanFeatures, cur: CurvescanFeatures, poses: Floats, margin: float
) -> tuple[Floats, Compared]:
    """Return (k, N_EVIDENCE) the evidence of (k, 3) poses, and the readings compared at the first."""
    found = np.zeros((poses.shape[0], N_EVIDENCE))
    codes_ref, codes_cur = np.empty(ref.beam_idx.size, dtype=np.uint8), np.empty(cur.beam_idx.size, dtype=np.uint8)
    partner_ref, partner_cur = np.empty(codes_ref.size, dtype=np.int64), np.empty(codes_cur.size, dtype=np.int64)
    for k in range(poses.shape[0] - 1, -1, -1):
        n_misfits = 0.0
        n_misfits += add_evidence(cur, ref, poses[k], FORWARD, margin, found[k], codes_cur, partner_cur)
        n_misfits += add_evidence(ref, cur, poses[k], BACKWARD, margin, found[k], codes_ref, partner_ref)
        for column in range(N_EVIDENCE):
            found[k, column] *= 1.0 / max(n_misfits, 1.0) if column == MISFIT else 0.5
    return found, (codes_ref, partner_ref, codes_cur, partner_cur)


@kernel
def add_evidence(
    scan: CurvescanFeatures,
    other_scan: CurvescanFeatures,
    pose: Floats,
    way: float,
    margin: float,
    found: Floats,
    codes: Codes,
    partner: Ints,
) -> int:
    """Add what the readings of one scan say of a pose to `found`, and compare them; return how many have a misfit."""
    surfels, is_small = scan.image.surfels, scan.objects.is_small
    other = other_scan.image
    placed = project(surfels, motion_of(pose, way), other)
    n_misfits = 0
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(surfels.shape[0]):
        codes[i], partner[i] = OCCLUDED, -1
        j, place, x, y, across, along = associate(placed, i, other)
        if j < 0:
            continue
        length = surfels[i, LENGTH]
        limit, reach = agreeing_limits(surfels, i, other.surfels, j, margin)
        beside = reading_beside(place, other, j)
        nearer = min(other.surfels[j, RANGE], other.surfels[beside, RANGE]) if beside >= 0 else 0.0
        if not is_small[i] and is_seen_through(x, y, nearer - max(limit, IN_FRONT)):
            found[SEEN_THROUGH] += length
        if along * along < reach * reach and abs(across) < limit:
            codes[i], partner[i] = INLIER, j
            nx, ny = surfels[i, NX], surfels[i, NY]
            found[AGREEING] += length
            xx, xy, yy = xx + length * nx * nx, xy + length * nx * ny, yy + length * ny * ny
            variance, variance_other = surfels[i, VARIANCE], other.surfels[j, VARIANCE]
            if variance > 0.0 and variance_other > 0.0:
                found[MISFIT] += across * across / (variance + variance_other)
                n_misfits += 1
        elif is_seen_through(x, y, other.surfels[j, RANGE] - 2.0 * limit - IN_FRONT):
            codes[i] = DYNAMIC
            found[SMALL] += length if is_small[i] else 0.0
    half = 0.5 * (xx - yy)
    found[WEAKEST] += 0.5 * (xx + yy) - math.sqrt(half * half + xy * xy)
    excess, beyond = excess_lengths(surfels, codes)
    found[EXCESS] += excess
    found[BEYOND] += beyond
    return n_misfits
