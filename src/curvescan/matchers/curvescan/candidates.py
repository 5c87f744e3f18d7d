"""Candidates: the few best poses refined on all readings, with those along a direction that the scans leave open.

Poses are the rows of an array, best first; scores the numbers beside them. A competing hypothesis is a pose with nearly
the best score.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.assessment.assessment import Assessment, assess_pose
from curvescan.matchers.curvescan.assessment.confidence import GUESSED_REPETITION, WeighedPoses, weigh
from curvescan.matchers.curvescan.assessment.labels import INLIER
from curvescan.matchers.curvescan.config import SAME, CurvescanConfig
from curvescan.matchers.curvescan.features.features import N_WIDE, CurvescanFeatures
from curvescan.matchers.curvescan.features.range_image import RangeImage
from curvescan.matchers.curvescan.features.sampling import choose_samples
from curvescan.matchers.curvescan.features.surfels import LENGTH, NX, NY
from curvescan.matchers.curvescan.pose_difference import distance
from curvescan.matchers.curvescan.proposal.scoring import CLOSE, FINE, select
from curvescan.matchers.curvescan.proposal.search import CONTESTED, Candidates, Problem
from curvescan.matchers.curvescan.refinement import EXACTLY, refine_fully
from curvescan.types import Floats, Pose

_MIN_SCORE = 0.02  # least score of a pose that is looked at any further
_N_TOP = 5  # poses that are judged beside one another, at most
_AS_GOOD, _AS_GOOD_MARGIN = 0.93, 0.04  # a pose with this share of the best score, or less below it, is as good
_FINE_STEP = 0.05  # metres at the typical reading: steps in which the best place along a direction is looked for
_MAX_TURN = 0.5  # radians: turns along it are tried up to this angle
_FINISH = (*FINE, _N_TOP, 4096, SAME)


class RefinedCandidates(NamedTuple):
    """The candidates that come near the best, refined on all readings."""

    weighed: WeighedPoses  # poses of the current scan in the reference and what speaks for each, the most likely first
    assessment: Assessment | None  # of the first; None where no pose finds enough support
    is_guess_decisive: bool = False  # whether a guess decided between poses that explain the scans


def refine_candidates(problem: Problem, found: Candidates) -> RefinedCandidates:
    """Return the candidates refined on all readings, and the best of those along a weakly observable direction.

    Of poses that explain the scans the one that a guess is clearly nearest to is kept alone.
    """
    ref, cur, _, config = problem
    poses, scores = top_candidates(ref, cur, found, config)
    weighed = weigh(problem, poses, scores)
    if not len(poses) or scores[0] < _MIN_SCORE or weighed.is_hopeless:
        return RefinedCandidates(weighed=weighed, assessment=None)
    best = weighed.poses[0]
    assessment = assess_pose(ref, cur, best, config)
    along = direction_to_search(ref, assessment, weighed, config)
    if along is not None:
        poses, scores = search_degenerate_direction(ref, cur, weighed.poses, along, config)
        weighed = weigh(problem, poses, scores)
        if not np.array_equal(best, weighed.poses[0]):
            assessment = assess_pose(ref, cur, weighed.poses[0], config)
    kept = prefer(problem, weighed)
    if kept is None:
        return RefinedCandidates(weighed=weighed, assessment=assessment)
    weighed = weighed.rows([kept])
    if kept > 0:
        assessment = assess_pose(ref, cur, weighed.poses[0], config)
    return RefinedCandidates(weighed=weighed, assessment=assessment, is_guess_decisive=True)


def direction_to_search(
    ref: CurvescanFeatures, assessment: Assessment, weighed: WeighedPoses, config: CurvescanConfig
) -> Pose | None:
    """Return the direction along which the best pose may lie elsewhere, or None.

    It is the least informed one, where that is weakly observable. Where nearly all that agrees runs one way, as in a
    corridor, it is that way: what fixes the pose along it may be people who agree by chance.
    """
    if assessment.is_weakly_observable(config.information):
        return assessment.weakest
    if not weighed.is_one_way:
        return None
    return direction_of_walls(ref, assessment)


def direction_of_walls(ref: CurvescanFeatures, assessment: Assessment) -> Pose:
    """Return (3,) the motion of 1 m along the surfaces of the reference that agree."""
    agreeing = ref.image.surfels[assessment.codes_ref == INLIER]
    length, nx, ny = agreeing[:, LENGTH], agreeing[:, NX], agreeing[:, NY]
    doubled = length @ (2.0 * nx * ny), length @ (nx * nx - ny * ny)
    facing = 0.5 * math.atan2(*doubled)
    return np.array([-math.sin(facing), math.cos(facing), 0.0])


def top_candidates(
    ref: CurvescanFeatures, cur: CurvescanFeatures, found: Candidates, config: CurvescanConfig
) -> tuple[Floats, Floats]:
    """Return the best pose and those that come near it, refined on all readings, best first, and their scores."""
    if not len(found.scores):
        return found.poses, found.scores
    scores = found.scores.tolist()
    rows = [k for k, score in enumerate(scores) if score > CONTESTED * scores[0]]
    near = found.poses[: len(rows)] if rows == list(range(len(rows))) else found.poses[rows]
    return _finish(ref, cur, near, config)


def search_degenerate_direction(
    ref: CurvescanFeatures, cur: CurvescanFeatures, poses: Floats, weakest: Pose, config: CurvescanConfig
) -> tuple[Floats, Floats]:
    """Return the poses and the best of those along the weakest direction of the first, best first, and their scores."""
    n = round(config.hypotheses.along_reach / _FINE_STEP)
    offsets = np.arange(-n, n + 1) * _FINE_STEP
    moved_along = poses[0] + offsets[:, np.newaxis] * weakest
    moved_along = moved_along[np.abs(offsets * weakest[2]) < _MAX_TURN]
    images = ref.wide_image, cur.wide_image
    best, _ = select(moved_along, *images, *CLOSE, 4, 24, SAME)
    return _finish(ref, cur, np.concatenate((poses, best)), config)


def _finish(
    ref: CurvescanFeatures, cur: CurvescanFeatures, poses: Floats, config: CurvescanConfig
) -> tuple[Floats, Floats]:
    return finish(poses, ref.image, cur.image, N_WIDE, config.refinement.closer_schedule, EXACTLY, _FINISH)


@kernel
def finish(
    poses: Floats,
    ref: RangeImage,
    cur: RangeImage,
    n_wide: int,
    closer: Floats,
    full: Floats,
    limits: tuple[float, float, int, int, float],
) -> tuple[Floats, Floats]:
    """Return poses refined on all readings, best first, and their scores; limits: the arguments of `select`."""
    final = refine_fully(poses, ref, cur, closer, full)
    if len(poses) > 1:  # one pose has only to be enough; several are compared on more samples
        ref = RangeImage(choose_samples(ref.surfels, n_wide), ref.surfels, ref.azimuth, ref.table)
        cur = RangeImage(choose_samples(cur.surfels, n_wide), cur.surfels, cur.azimuth, cur.table)
    tolerance, slope, n_kept, n_first, min_difference = limits
    return select(final, ref, cur, tolerance, slope, n_kept, n_first, min_difference)


def competing_hypotheses(scores: Floats) -> list[int]:
    """Return the rows of the poses that are as good as the first."""
    least = min(_AS_GOOD * scores[0], scores[0] - _AS_GOOD_MARGIN)
    return [k for k in range(1, len(scores)) if scores[k] > least]


def prefer(problem: Problem, weighed: WeighedPoses) -> int | None:
    """Return the row of the one of several poses that explain the scans that a guess is clearly nearest to, or None."""
    poses = weighed.poses
    if problem.guess is None or len(poses) == 1:
        return None
    competing = competing_hypotheses(weighed.scores)
    rows = [k for k in range(1, len(poses)) if k in competing or weighed.repetition(k) > GUESSED_REPETITION]
    if not rows:
        return None
    rows = [0, *rows]
    distances = [distance(poses[k], problem.guess) for k in rows]
    first, second = np.argsort(distances, kind="stable")[:2].tolist()
    return None if 2.0 * distances[first] > distances[second] else rows[first]
