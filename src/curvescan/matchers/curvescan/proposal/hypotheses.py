"""Hypotheses: where the current scan may have been taken, from pairs of keypoints, the most voted first.

Two oriented keypoints of one kind, one of each scan, fix a pose. True pairs fix the same one, over and over; false ones
scatter. So a pose gets the votes of all poses in its cell of a coarse grid, in the manner of Hough's transform.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.features.keypoints import DIRECTION, FX, FY, KIND, TURN
from curvescan.matchers.curvescan.features.objects import STANDS_BEFORE
from curvescan.matchers.curvescan.features.range_image import RangeImage, reading_at
from curvescan.matchers.curvescan.features.surfels import RANGE
from curvescan.se2.uncertain import wrap_angle
from curvescan.types import Floats


@inlined
def is_in_sight(x: float, y: float, image: RangeImage, margin: float) -> bool:
    """Return whether a scan leaves the way from its sensor to a place free, as far as it saw."""
    j = reading_at(x, y, image)
    if j < 0:
        return True
    reach = image.surfels[j, RANGE] + margin
    return bool(x * x + y * y < reach * reach)


@kernel
def pair_keypoints(
    keypoints_ref: Floats,
    keypoints_cur: Floats,
    ref: RangeImage,
    cur: RangeImage,
    turn_tolerance: float,
    max_pairs: int,
) -> Floats:
    """Return (h, 3) poses of the current scan in the reference, one for each pair of keypoints of one kind.

    Left out are poses at which one sensor would stand behind what the other saw.
    """
    poses = np.empty((max_pairs, 3))
    n = 0
    for i in range(keypoints_cur.shape[0]):
        x, y, direction = keypoints_cur[i, FX], keypoints_cur[i, FY], keypoints_cur[i, DIRECTION]
        turn, kind = keypoints_cur[i, TURN], keypoints_cur[i, KIND]
        for j in range(keypoints_ref.shape[0]):
            if keypoints_ref[j, KIND] != kind or n >= max_pairs:
                continue
            if abs(keypoints_ref[j, TURN] - turn) > turn_tolerance:
                continue
            theta = wrap_angle(keypoints_ref[j, DIRECTION] - direction)
            c, s = math.cos(theta), math.sin(theta)
            tx = keypoints_ref[j, FX] - c * x + s * y
            ty = keypoints_ref[j, FY] - s * x - c * y
            if not is_in_sight(tx, ty, ref, STANDS_BEFORE):
                continue
            if not is_in_sight(-c * tx - s * ty, s * tx - c * ty, cur, STANDS_BEFORE):
                continue
            poses[n, 0], poses[n, 1], poses[n, 2] = tx, ty, theta
            n += 1
    return poses[:n]


@kernel
def most_voted(poses: Floats, cell: float, turn: float, max_kept: int) -> Floats:
    """Return at most max_kept poses, those of the fullest cells first.

    Cells are `cell` metres and `turn` radians wide; two grids half a cell apart are summed, so that no border
    halves a cluster. Cells share the counters of a hash table: a clash adds a vote, no more.
    """
    n = poses.shape[0]
    size = 2048
    # flat: arrays of another shape or type take a quarter of a second more to compile
    counts = np.zeros(2 * size, dtype=np.int64)
    keys = np.empty(2 * n, dtype=np.int64)
    for h in range(n):
        for g in range(2):
            a = math.floor(poses[h, 0] / cell + 0.5 * g)
            b = math.floor(poses[h, 1] / cell + 0.5 * g)
            # theta in (-pi, pi]: the seam may cut a cell, the other grid cuts it elsewhere
            d = math.floor((poses[h, 2] + math.pi) / turn + 0.5 * g)
            key = (a * 73856093 ^ b * 19349663 ^ d * 83492791) & (size - 1)
            keys[2 * h + g] = key + g * size
            counts[keys[2 * h + g]] += 1
    most = 64
    starts = np.zeros(most + 1, dtype=np.int64)
    votes = np.empty(n, dtype=np.int64)
    for h in range(n):
        v = counts[keys[2 * h]] + counts[keys[2 * h + 1]]
        votes[h] = most - 1 - min(v, most - 1)
        starts[votes[h] + 1] += 1
    for v in range(most):
        starts[v + 1] += starts[v]
    kept = np.empty((min(n, max_kept), 3))
    for h in range(n):
        place = starts[votes[h]]
        starts[votes[h]] += 1
        if place < max_kept:
            for k in range(3):
                kept[place, k] = poses[h, k]
    return kept
