"""Evidence: what the surfaces of both scans say for a pose and against it, in metres of surface.

Surfaces that stand free and are no larger than a person may have moved between the scans; what contradicts a pose at
any other surface is a wall seen through. Docs: docs/design-notes/confidence.md.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.assessment.labels import DYNAMIC, IN_FRONT, INLIER, OCCLUDED, agreeing_limits
from curvescan.matchers.curvescan.assessment.walls import excess_lengths
from curvescan.matchers.curvescan.association import (
    BACKWARD,
    FORWARD,
    Motion,
    associate,
    is_seen_through,
    motion_of,
    project,
    turned,
    turned_back,
)
from curvescan.matchers.curvescan.config import PARALLEL
from curvescan.matchers.curvescan.features.features import CurvescanFeatures
from curvescan.matchers.curvescan.features.objects import STANDS_BEFORE
from curvescan.matchers.curvescan.features.surfels import CX, CY, LENGTH, NX, NY, RANGE, VARIANCE, X, Y, distance2
from curvescan.types import Bools, Codes, Floats, Ints

# Columns of an evidence. Metres of surface, the mean of both scans: that agrees; of that besides the two walls, not
# parallel, that agree most; that agrees and fixes the direction fixed least; MISFIT has no unit: mean squared distance
# of readings that agree over their variance; parallel to the other scan's surface and beside it; seen through, and no
# small thing; seen through, in runs longer than 0.5 m; seen through, and small things; that agrees besides those two
# walls and the two that face them, which are all of a bare room.
AGREEING, EXCESS, WEAKEST, MISFIT, MISSED, SEEN_THROUGH, LARGE, SMALL, BEYOND = range(9)
N_EVIDENCE = BEYOND + 1

# Of the readings of the reference, and of those of the current scan: what each is to the other scan, a code of
# labels.py, and the reading there that it agrees with, -1 without one.
Compared: TypeAlias = tuple[Codes, Ints, Codes, Ints]

_CLEAR = 2  # readings beside a person on a wall whose lines the person may have tilted
_LARGE_EXTENT = 0.5  # metres: extent of a surface that is no person's
_BESIDE = 0.3  # metres: a surface no farther from the other scan's, and parallel to it, is meant to be it


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
    surfels, bounds, is_small = scan.image.surfels, scan.bounds, scan.objects.is_small
    other, is_small_other = other_scan.image, other_scan.objects.is_small
    motion = motion_of(pose, way)
    placed = project(surfels, motion, other)
    n_misfits = 0
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(surfels.shape[0]):
        codes[i], partner[i] = OCCLUDED, -1
        j, _, x, y, across, along = associate(placed, i, other)
        if j < 0:
            continue
        length = surfels[i, LENGTH]
        limit, reach = agreeing_limits(surfels, i, other.surfels, j, margin)
        is_on_line = along * along < reach * reach
        if is_on_line and abs(across) < limit:
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
            found[SMALL if is_small[i] else SEEN_THROUGH] += length
        elif is_on_line and abs(across) < _BESIDE and not (is_small[i] or is_small_other[j]):
            found[MISSED] += length if is_parallel(surfels, i, motion, other.surfels, j) else 0.0
    half = 0.5 * (xx - yy)
    found[WEAKEST] += 0.5 * (xx + yy) - math.sqrt(half * half + xy * xy)
    excess, beyond = excess_lengths(surfels, codes)
    found[EXCESS] += excess
    found[BEYOND] += beyond
    large, people = runs_seen_through(surfels, bounds, codes, is_small)
    found[LARGE] += large
    found[SEEN_THROUGH] -= people
    found[SMALL] += people
    return n_misfits


@inlined
def is_parallel(surfels: Floats, i: int, motion: Motion, surfels_other: Floats, j: int) -> bool:
    """Return whether a reading, moved, faces as one of the other scan does."""
    nx, ny = surfels[i, NX], surfels[i, NY]
    x, y = turned(nx, ny, motion) if motion.way > 0.0 else turned_back(nx, ny, motion)
    return bool(x * surfels_other[j, NX] + y * surfels_other[j, NY] > PARALLEL)


@kernel
def runs_seen_through(surfels: Floats, bounds: Ints, codes: Codes, is_small: Bools) -> tuple[float, float]:
    """Return the length of surface seen through in runs longer than 0.5 m, and of shorter ones that may be people.

    These stand before what is on both sides of them, metres. A person who leans on a wall is of one surface with it.
    """
    large, people = 0.0, 0.0
    for k in range(bounds.size - 1):
        run, first = 0.0, -1
        for i in range(bounds[k], bounds[k + 1]):
            is_in = codes[i] == DYNAMIC
            if is_in:
                first = i if first < 0 else first
                run += surfels[i, LENGTH]
            if first >= 0 and (not is_in or i == bounds[k + 1] - 1):
                last = i if is_in else i - 1
                if distance2(surfels, first, last) > _LARGE_EXTENT * _LARGE_EXTENT:
                    large += run
                elif not is_small[first]:  # all of a surface is, or none
                    middle = (first + last) // 2
                    stands_free = stands_before(surfels, bounds, k, middle, first, first - 1)
                    if stands_free and stands_before(surfels, bounds, k, middle, last, last + 1):
                        people += run
                run, first = 0.0, -1
    return large, people


@kernel
def stands_before(surfels: Floats, bounds: Ints, k: int, middle: int, edge: int, beside: int) -> bool:
    """Return whether a run of readings of surface k stands before what is `beside` its `edge`."""
    if beside < 0 or beside >= surfels.shape[0]:
        return True
    if surfels[beside, RANGE] - surfels[edge, RANGE] > STANDS_BEFORE:
        return True
    if beside < bounds[k] or beside >= bounds[k + 1]:
        return False
    wall = min(max(beside + _CLEAR * (beside - edge), bounds[k]), bounds[k + 1] - 1)
    dx, dy = surfels[middle, X] - surfels[wall, CX], surfels[middle, Y] - surfels[wall, CY]
    return bool(surfels[wall, NX] * dx + surfels[wall, NY] * dy > STANDS_BEFORE)
