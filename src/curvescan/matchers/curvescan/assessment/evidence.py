"""Evidence: what the surfaces of both scans say for a pose and against it, in metres of surface.

Surfaces that stand free and are no larger than a person may have moved between the scans; what contradicts a pose at
any other surface is a wall seen through. A corner of two walls fits any other corner, and four walls are all of a bare
room: what agrees beyond them says more. Docs: docs/design-notes/confidence.md.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.assessment.labels import DYNAMIC, IN_FRONT, INLIER, OCCLUDED, agreeing_limits
from curvescan.matchers.curvescan.association import (
    BACKWARD,
    FORWARD,
    Motion,
    associate,
    is_seen_through,
    motion_of,
    project,
)
from curvescan.matchers.curvescan.config import ARM, PARALLEL
from curvescan.matchers.curvescan.features.features import Surfaces
from curvescan.matchers.curvescan.features.range_image import reading_beside
from curvescan.matchers.curvescan.features.surfels import CX, CY, LENGTH, NX, NY, RANGE, VARIANCE, X, Y
from curvescan.types import Bools, Codes, Floats, Ints

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

_ALIKE = 0.98  # cosine of the angle, 11 degrees, within which a reading faces as its wall does, or against another
_N_TAKEN = 48  # readings that stand for all
_N_SEEDS = 16  # of these the ones through which walls are looked for
# Rows of the readings taken: normal, centre and length of each.
LINE_NX, LINE_NY, LINE_CX, LINE_CY, LINE_LENGTH = range(5)
_LINE_COLUMNS = (NX, NY, CX, CY, LENGTH)
_N_LINE = len(_LINE_COLUMNS)


@kernel
def gather_evidence(ref: Surfaces, cur: Surfaces, poses: Floats, margin: float) -> tuple[Floats, Compared]:
    """Return (k, N_EVIDENCE) the evidence of (k, 3) poses, and the readings compared at the first."""
    found = np.zeros((poses.shape[0], N_EVIDENCE))
    codes_ref, codes_cur = np.empty(ref.beam_idx.size, dtype=np.uint8), np.empty(cur.beam_idx.size, dtype=np.uint8)
    partner_ref, partner_cur = np.empty(codes_ref.size, dtype=np.int64), np.empty(codes_cur.size, dtype=np.int64)
    for k in range(poses.shape[0] - 1, -1, -1):
        n_misfits = add_evidence(cur, ref, motion_of(poses[k], FORWARD), margin, found[k], codes_cur, partner_cur)
        n_misfits += add_evidence(ref, cur, motion_of(poses[k], BACKWARD), margin, found[k], codes_ref, partner_ref)
        for column in range(N_EVIDENCE):
            found[k, column] *= 1.0 / max(n_misfits, 1.0) if column == MISFIT else 0.5
    return found, (codes_ref, partner_ref, codes_cur, partner_cur)


@kernel
def add_evidence(
    scan: Surfaces, other_scan: Surfaces, motion: Motion, margin: float, found: Floats, codes: Codes, partner: Ints
) -> int:
    """Add what the readings of one scan say of a pose to `found`, and compare them; return how many have a misfit."""
    surfels, is_small = scan.image.surfels, scan.objects.is_small
    other = other_scan.image
    placed = project(surfels, motion, other)
    n_misfits = 0
    xx, xy, yy = 0.0, 0.0, 0.0
    for i in range(surfels.shape[0]):
        codes[i], partner[i] = OCCLUDED, -1
        j, place, x, y, across, along = associate(placed, i, other)
        if j < 0:
            continue
        length = surfels[i, LENGTH]
        limit, reach = agreeing_limits(surfels, i, other.surfels, j, margin, motion)
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


@kernel
def excess_lengths(surfels: Floats, codes: Codes) -> tuple[float, float]:
    """Return the lengths of agreeing surface beyond the two best walls, and beyond those and the facing ones, metres.

    A wall is what lies within 0.12 m of a line and faces like it within 0.2 rad; it is looked for through some
    readings, and of many only some are taken.
    """
    n = 0
    for i in range(codes.size):
        n += codes[i] == INLIER and surfels[i, LENGTH] > 0.0
    stride = max(n // _N_TAKEN, 1)
    lines = np.empty((_N_LINE, n // stride + 1))
    count, seen, total = n - n, 0, 0.0  # 0 that is no constant
    for i in range(codes.size):
        if codes[i] != INLIER or surfels[i, LENGTH] <= 0.0:
            continue
        total += surfels[i, LENGTH]
        if seen % stride == 0:
            for row in range(_N_LINE):
                lines[row, count] = surfels[i, _LINE_COLUMNS[row]]
            count += 1
        seen += 1
    on_wall = readings_on_walls(lines, count)
    taken = np.zeros(count, dtype=np.bool_)
    walls = np.empty(4, dtype=np.int64)  # seeds: the longest, the longest across, those that face them
    excess, beyond = total, total
    for turn in range(4):
        length, walls[turn] = longest_wall(lines, on_wall, taken, walls, turn)
        for k in range(count):
            if walls[turn] >= 0:
                taken[k] = taken[k] or on_wall[walls[turn], k]
        beyond -= length * stride
        excess = beyond if turn < 2 else excess
    return max(excess, 0.0), max(beyond, 0.0)


@inlined
def readings_on_walls(lines: Floats, count: int) -> Bools:
    """Return (n_seeds, count) which readings lie on the line through reading k * step, and face like it."""
    step = max(count // _N_SEEDS, 1)
    on_wall = np.empty(((count + step - 1) // step, count), dtype=np.bool_)
    for seed in range(on_wall.shape[0]):
        nx, ny = lines[LINE_NX, seed * step], lines[LINE_NY, seed * step]
        cx, cy = lines[LINE_CX, seed * step], lines[LINE_CY, seed * step]
        for k in range(count):
            is_alike = nx * lines[LINE_NX, k] + ny * lines[LINE_NY, k] >= _ALIKE
            off = nx * (lines[LINE_CX, k] - cx) + ny * (lines[LINE_CY, k] - cy)
            on_wall[seed, k] = is_alike & (abs(off) < ARM)
    return on_wall


@kernel
def longest_wall(lines: Floats, on_wall: Bools, taken: Bools, walls: Ints, turn: int) -> tuple[float, int]:
    """Return the length of readings on the longest wall of those left, and the seed of it, -1 without any.

    The first may be any, the second runs across the first, the third faces the first and the fourth the second.
    """
    best, best_seed = 0.0, -1
    if turn > 0 and walls[0 if turn == 1 else turn - 2] < 0:
        return best, best_seed
    count = taken.size
    step = max(count // _N_SEEDS, 1)
    for seed in range(on_wall.shape[0]):
        if taken[seed * step]:
            continue
        if turn > 0:
            wall = walls[0 if turn == 1 else turn - 2] * step
            nx, ny = lines[LINE_NX, seed * step], lines[LINE_NY, seed * step]
            facing = nx * lines[LINE_NX, wall] + ny * lines[LINE_NY, wall]
            if abs(facing) > PARALLEL if turn == 1 else facing > -_ALIKE:
                continue
        length = 0.0
        for k in range(count):
            if on_wall[seed, k] and not taken[k]:
                length += lines[LINE_LENGTH, k]
        if length > best:
            best, best_seed = length, seed
    return best, best_seed


def extent(surfels: Floats, codes: Codes) -> float:
    """Return how far from each other the readings that agree lie at most, metres; of many, some stand for all."""
    agreeing = surfels[codes == INLIER][:, [X, Y]]
    some = agreeing[:: max(len(agreeing) // _N_TAKEN, 1)]
    offsets = some[:, np.newaxis] - some
    return float(np.sqrt((offsets**2).sum(axis=2).max(initial=0.0)))
