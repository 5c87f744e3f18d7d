"""Correlative search: the poses of a whole map at which a scan ends on walls, with no guess.

After Olson, "Real-time correlative scan matching", ICRA 2009: every place where the sensor can be and every heading is
tried on a field of distances, coarsely; the best are refined on the field. It needs no landmarks and no overlap with
any one keyframe, so that a place seen from the other direction, in pieces, is found as well. A pose that cannot become
good is left after a quarter of its readings.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan import se2
from curvescan._jit import kernel
from curvescan.slam.localization.field import ON_WALL_M, REACH_M, DistanceField
from curvescan.types import Bools, Floats, Points, Pose

STEP_M = 0.3
"""Places that are tried lie so far from each other, metres; the refinement begins with half of it. Neighbouring
readings count as no farther from each other."""

_N_HEADINGS = 96
STEP_RAD = 2.0 * math.pi / _N_HEADINGS
"""Headings that are tried, and how far they lie from each other, radians."""

_N_READINGS = 48
"""Readings of a scan that are tried."""

_N_REFINED = 400
"""Poses that are refined, at most."""

_SAME_M, _SAME_RAD = 0.5, 4.0 * STEP_RAD
"""Poses nearer to each other are one, metres and radians."""

_LEAST = 0.35
"""Least mean over the readings of a pose that is refined, in [0, 1]."""


def is_same(one: Pose, other: Pose) -> Bools:
    """Return whether poses of the sensor are one place, (n,) of (n, 3)."""
    x, y, theta = np.moveaxis(se2.between(one, other), -1, 0)
    return np.asarray((np.hypot(x, y) < _SAME_M) & (np.abs(theta) < _SAME_RAD))


def thinned(points: Points, n_most: int = _N_READINGS) -> Points:
    """Return readings of a scan (n, 2) that stand for all, evenly along its contour and not along its angle."""
    if len(points) <= n_most:
        return np.ascontiguousarray(points)
    along = np.concatenate(([0.0], np.cumsum(_steps(points))))
    chosen = np.unique(np.searchsorted(along, np.linspace(0.0, along[-1], n_most)).clip(0, len(points) - 1))
    return np.ascontiguousarray(points[chosen])


def contour_length(points: Points) -> float:
    """Return the length of what a scan shows, metres, by its valid readings (n, 2) in the order of their beams."""
    return float(_steps(points).sum())


def _steps(points: Points) -> Floats:
    """Return (n - 1,) distances of neighbouring readings, metres; where a surface ends it goes on elsewhere."""
    return np.asarray(np.minimum(np.hypot(*np.diff(points, axis=0).T), STEP_M))


def likely_poses(field: DistanceField, places: Points, points: Points, n_most: int) -> Pose:
    """Return (k, 3) poses in places (n, 2) at which a scan (m, 2) ends on walls, best first, none the same."""
    if len(places) == 0 or len(points) < 8:
        return np.empty((0, 3))
    # shuffled, so that a few readings stand for all when a pose is given up
    points = points[np.random.default_rng(0).permutation(len(points))]
    scores, headings = _best_headings(field, places, points)
    order = np.argsort(-scores, axis=None, kind="stable")[:_N_REFINED]
    order = order[scores.ravel()[order] >= _LEAST]
    rough = np.column_stack((places[order // scores.shape[1]], headings.ravel()[order]))
    found, fine = refined(field, rough, points)
    chosen: list[int] = []
    for k in np.argsort(-fine, kind="stable").tolist():
        if not is_same(found[chosen], found[k]).any():
            chosen.append(k)
        if len(chosen) == n_most:
            break
    return found[chosen]


@kernel
def _score(field: DistanceField, points: Points, pose: Floats, reach: float, least: float) -> float:
    """Return the mean over the readings of how near to a wall they end; 0 as soon as it cannot be worth it."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    n_rows, n_columns = field.distance.shape
    n, total = len(points), 0.0
    for k in range(n):
        column = math.floor((pose[0] + c * points[k, 0] - s * points[k, 1] - field.origin[0]) / field.resolution)
        row = math.floor((pose[1] + s * points[k, 0] + c * points[k, 1] - field.origin[1]) / field.resolution)
        if 0 <= row < n_rows and 0 <= column < n_columns:
            total += max(0.0, 1.0 - float(field.distance[row, column]) / reach)
        if 4 * (k + 1) == n - n % 4 and total < 0.7 * least * (k + 1):
            return 0.0
    return total / n


@kernel
def _best_headings(field: DistanceField, places: Points, points: Points) -> tuple[Floats, Floats]:
    """Return (n, 2) scores and headings of the best two headings of each place."""
    scores, headings = np.zeros((len(places), 2)), np.zeros((len(places), 2))
    pose = np.empty(3)
    for p in range(len(places)):
        pose[0], pose[1] = places[p, 0], places[p, 1]
        for h in range(_N_HEADINGS):
            pose[2] = (h + 0.5) * STEP_RAD - math.pi
            score = _score(field, points, pose, REACH_M, _LEAST)
            apart = abs(pose[2] - headings[p, 0])
            is_other = min(apart, 2.0 * math.pi - apart) > _SAME_RAD
            if score > scores[p, 0]:
                if is_other:
                    scores[p, 1], headings[p, 1] = scores[p, 0], headings[p, 0]
                scores[p, 0], headings[p, 0] = score, pose[2]
            elif score > scores[p, 1] and is_other:
                scores[p, 1], headings[p, 1] = score, pose[2]
    return scores, headings


@kernel
def refined(field: DistanceField, rough: Pose, points: Points) -> tuple[Pose, Floats]:
    """Return poses (n, 3) moved uphill to where a scan (m, 2) fits best, by steps that are halved; (n,) how well."""
    poses, scores = rough.copy(), np.zeros(len(rough))
    for p in range(len(rough)):
        step, turn, reach = 0.5 * STEP_M, 0.5 * STEP_RAD, REACH_M
        for _ in range(4):
            best, moved, n = _score(field, points, poses[p], reach, 0.0), True, 0
            while moved and n < 6:
                moved = False
                n += 1
                for axis in range(3):
                    for sign in (-1, 1):
                        before = poses[p, axis]
                        poses[p, axis] += (turn if axis == 2 else step) * sign
                        score = _score(field, points, poses[p], reach, 0.0)
                        if score > best:
                            best, moved = score, True
                        else:
                            poses[p, axis] = before
            step, turn, reach = 0.5 * step, 0.5 * turn, max(0.5 * reach, ON_WALL_M)
        scores[p] = _score(field, points, poses[p], 0.5 * REACH_M, 0.0)
    return poses, scores
