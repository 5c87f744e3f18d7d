"""Scoring: how well two scans agree at a pose, each projected into the other's range image.

A reading agrees when it lies near the line through the reading that the other sensor has in its direction,
and both surfaces face alike. It contradicts when it lies in front: there the other sensor saw through. What lies
behind is hidden and says nothing.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan import se2
from curvescan._jit import kernel
from curvescan.matchers.curvescan.association import (
    FORWARD,
    Motion,
    associate,
    is_seen_through,
    motion_of,
    project,
    project_into,
    turned,
)
from curvescan.matchers.curvescan.config import LIKELY_SIGMAS, SURE_SIGMAS
from curvescan.matchers.curvescan.features.range_image import RangeImage, reading_beside
from curvescan.matchers.curvescan.features.surfels import NX, NY, RANGE, SPACING, VARIANCE, X, Y
from curvescan.types import Floats

# Share of the spacing of two readings on a surface by which a point of it may lie from the nearest one: half, and some
# more where the surface is not straight.
ALONG = 0.6
# Tolerances of a pose not yet refined, quickly refined, and to be judged: metres, and metres for each metre of range.
ROUGH, CLOSE, FINE = (0.08, 0.03), (0.04, 0.005), (0.03, 0.004)
# Square of how far along a surface a point may lie from the nearest reading, besides, in limits across it.
_REACH2 = SURE_SIGMAS * SURE_SIGMAS
# What is uncertain of a score of one sample; of n it is this over their root. A sample counts from -0.5 to 1.
_PROSPECT = 0.6
_MAX_ALIKE = 4  # poses near one that is kept that are tried in its place: more of them hardly score better


@kernel
def score_samples(
    samples: Floats, placed: Floats, low: int, high: int, image: RangeImage, motion: Motion, slack: float, slope: float
) -> float:
    """Return the agreements less half the contradictions of samples low to high of one scan in another.

    placed: the samples, projected there; motion: FORWARD, of the first scan into the second.
    """
    score = 0.0
    surfels = image.surfels
    for k in range(low, min(high, samples.shape[0])):
        j, place, qx, qy, across, _ = associate(placed, k, image)
        if j < 0:
            continue
        limit = slack + slope * surfels[j, RANGE]
        noise2 = max(samples[k, VARIANCE], 0.0) + max(surfels[j, VARIANCE], 0.0)
        limit2 = max(limit * limit, LIKELY_SIGMAS * LIKELY_SIGMAS * noise2)
        ux, uy = qx - surfels[j, X], qy - surfels[j, Y]
        along = ALONG * surfels[j, SPACING]
        # no quotient or root stands before a branch, which would wait for it
        if across * across < limit2 and ux * ux + uy * uy < _REACH2 * limit2 + along * along:
            mx, my = turned(samples[k, NX], samples[k, NY], motion)
            alike = surfels[j, NX] * mx + surfels[j, NY] * my
            if alike > 0.0:
                score += (1.0 - across * across / limit2) * alike
                continue
        front = surfels[j, RANGE] - 2.0 * (limit if limit2 == limit * limit else math.sqrt(limit2))
        if not is_seen_through(qx, qy, front):
            continue
        # between two beams the nearer surface may reach as far as the other beam
        i = reading_beside(place, image, j)
        front -= max(surfels[j, RANGE] - surfels[i, RANGE], 0.0) if i >= 0 else 0.0
        if is_seen_through(qx, qy, front):
            score -= 0.5
    return score


@kernel
def score_pose(
    pose: Floats,
    ref: RangeImage,
    cur: RangeImage,
    tolerance: float,
    slope: float,
    n_first: int,
    least: float,
    placed: tuple[Floats, Floats],
) -> float:
    """Return the score of one pose, both ways round, at most 1.

    n_first samples of each scan are tried, then as many more as before, until all are or the score has no
    prospect of reaching `least`; it is then that of the samples tried. placed: room to project the samples of both.
    """
    x, y, theta = pose[0], pose[1], pose[2]
    c, s = math.cos(theta), math.sin(theta)
    there, back = Motion(c, s, x, y, FORWARD), Motion(c, -s, -c * x - s * y, s * x - c * y, FORWARD)
    samples_ref, samples_cur = ref.samples, cur.samples
    n_ref, n_cur = samples_ref.shape[0], samples_cur.shape[0]
    # all at once, by vector instructions, which takes no longer than the first few one by one
    placed_ref, placed_cur = placed
    project_into(placed_ref, samples_ref, back, cur)
    project_into(placed_cur, samples_cur, there, ref)
    low, high, score, rate, prospect = n_first - n_first, n_first, 0.0, 0.0, 1.0  # 0 that is no constant
    while low < max(n_ref, n_cur) and rate >= least - prospect:
        score += score_samples(samples_cur, placed_cur, low, high, ref, there, tolerance, slope)
        score += score_samples(samples_ref, placed_ref, low, high, cur, back, tolerance, slope)
        n = min(high, n_ref) + min(high, n_cur)
        # few samples err more: what is certain of a score narrows with the root of their number
        rate, prospect = score / n, _PROSPECT / math.sqrt(n)
        low = high
        high *= 2
    return rate


@kernel
def select(
    poses: Floats,
    ref: RangeImage,
    cur: RangeImage,
    tolerance: float,
    slope: float,
    n_kept: int,
    n_first: int,
    min_difference: float,
) -> tuple[Floats, Floats]:
    """Return the (k, 3) best poses that differ from one another, best first, and their scores (k,)."""
    best = np.empty((n_kept, 3))
    scores = np.empty(n_kept)
    n_alike = np.zeros(n_kept, dtype=np.int64)
    placed = np.empty((3, ref.samples.shape[0])), np.empty((3, cur.samples.shape[0]))
    n = 0
    for h in range(poses.shape[0]):
        x, y, theta = poses[h, 0], poses[h, 1], poses[h, 2]
        least = scores[n - 1] if n == n_kept else -1.0
        like = -1
        for k in range(n):
            turn = abs(best[k, 2] - theta)
            dx, dy = best[k, 0] - x, best[k, 1] - y
            if (
                dx * dx + dy * dy < min_difference * min_difference
                and min(turn, 2.0 * math.pi - turn) < 0.5 * min_difference
            ):
                like = k
                break
        if like >= 0:
            n_alike[like] += 1
            if n_alike[like] > _MAX_ALIKE:
                continue
            least = scores[like]
        score = score_pose(poses[h], ref, cur, tolerance, slope, n_first, least, placed)
        if score <= least:
            continue
        place = like  # the entry that goes: its like, or the last
        alike = n_alike[like] if like >= 0 else 1
        if like < 0:
            place = min(n, n_kept - 1)
            n = min(n + 1, n_kept)
        while place > 0 and scores[place - 1] < score:
            scores[place], n_alike[place] = scores[place - 1], n_alike[place - 1]
            for k in range(3):
                best[place, k] = best[place - 1, k]
            place -= 1
        scores[place], n_alike[place] = score, alike
        best[place, 0], best[place, 1], best[place, 2] = x, y, theta
    return best[:n], scores[:n]


def agreement_lost(pose: Floats, motion: Floats, ref: RangeImage, cur: RangeImage, *limits: float) -> float:
    """Return the share of the agreement at a pose that is lost a (3,) motion before or behind it, the less of both.

    Of samples whose place the other sensor saw at both poses: what leaves its sight says nothing. limits: as of FINE.
    """
    poses = np.array([pose, pose - motion, pose + motion])
    views = (cur.samples, ref, poses), (ref.samples, cur, se2.inverse(poses))
    said = np.hstack([agreements(*view, *limits) for view in views])
    is_seen = np.isfinite(said[0] + said[1:])
    before, after = (np.where(is_seen, at, 0.0).sum(axis=1) for at in (said[0], said[1:]))
    return float((1.0 - after / np.maximum(before, 1.0)).min())


@kernel
def agreements(samples: Floats, image: RangeImage, poses: Floats, tolerance: float, slope: float) -> Floats:
    """Return (p, n) how samples agree with another scan at (p, 3) poses in it; NaN where it did not see their place."""
    said = np.empty((poses.shape[0], samples.shape[0]))
    surfels = image.surfels
    for p in range(poses.shape[0]):
        motion = motion_of(poses[p], FORWARD)
        placed = project(samples, motion, image)
        for k in range(samples.shape[0]):
            j, _, x, y, _, _ = associate(placed, k, image)
            said[p, k] = np.nan
            if j >= 0:
                said[p, k] = score_samples(samples, placed, k, k + 1, image, motion, tolerance, slope)
                ux, uy = x - surfels[j, X], y - surfels[j, Y]
                limit, along = tolerance + slope * surfels[j, RANGE], ALONG * surfels[j, SPACING]
                if said[p, k] == 0.0 and ux * ux + uy * uy >= _REACH2 * limit * limit + along * along:
                    said[p, k] = np.nan
    return said
