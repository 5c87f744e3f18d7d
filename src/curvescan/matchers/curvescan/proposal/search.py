"""Search: from features of two scans to the few poses worth a closer look."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.config import NEAR, SAME, SURE_SIGMAS, CurvescanConfig
from curvescan.matchers.curvescan.features.features import CurvescanFeatures
from curvescan.matchers.curvescan.features.landmarks import Landmarks
from curvescan.matchers.curvescan.features.range_image import RangeImage
from curvescan.matchers.curvescan.pose_difference import distance
from curvescan.matchers.curvescan.prior import TOLD, Prior, log_odds
from curvescan.matchers.curvescan.proposal.hypotheses import rotation_hypotheses, translation_hypotheses
from curvescan.matchers.curvescan.proposal.scoring import CLOSE, ROUGH, select
from curvescan.matchers.curvescan.refinement import refine
from curvescan.se2.uncertain import wrap_angle
from curvescan.types import Floats, Pose

_LEAST_SCORE = 0.1  # of a candidate: what scores less is there by chance, also its turn
# Then turns so many radians and twice as many to either side of the likeliest are tried. The directions of clutter tell
# the turn no better.
_TURN_STEP = 0.1
_N_REFINED, _N_KEPT = 6, 4  # poses that are refined, and of these how many are candidates
CONTESTED = 0.3  # a pose with this share of the best one's score competes with it, and is judged beside it
_CERTAIN_SCORE = 0.55  # from which on a prior is followed; one that leaves no other place, unless it is doubtful
_NARROW = (SURE_SIGMAS / NEAR) ** 2  # precision of that, 1/m^2


class Problem(NamedTuple):
    """What is to be matched."""

    # reference, current: both scans
    reference: CurvescanFeatures
    current: CurvescanFeatures
    prior: Prior  # where the current scan is expected in the reference
    config: CurvescanConfig  # all parameters
    effort: Effort  # those of them that kernels take


class Effort(NamedTuple):
    """How widely poses are looked for; as constants each would make Numba compile the kernels that take it anew."""

    # schedules of a quick refinement, and of a closer one
    sigmas: Floats
    closer: Floats
    max_tried: int  # places at which walls coincide
    n_rotations: int  # turns by the directions of surfaces
    doubtful_score: float  # as in ScoringConfig
    # poses refined and kept, and of which samples the rough and the close score are taken first
    n_kept: tuple[int, int]
    n_first: tuple[int, int]


class Candidates(NamedTuple):
    """The best poses found."""

    # (k, 3): poses of the current scan in the reference, that differ, refined on the samples, best first
    poses: Floats
    scores: Floats  # (k,): how well the scans agree there, at most 1
    n_tried: int  # poses that were verified


NOTHING = Candidates(poses=np.empty((0, 3)), scores=np.empty(0), n_tried=0)


def effort_of(config: CurvescanConfig) -> Effort:
    """Return how widely poses are looked for."""
    hypotheses, scoring = config.hypotheses, config.scoring
    return Effort(
        np.array(config.refinement.quick, dtype=float),
        np.array(config.refinement.closer, dtype=float),
        hypotheses.max_tried,
        hypotheses.n_rotations,
        scoring.doubtful_score,
        (_N_REFINED, _N_KEPT),
        (6, 64),
    )


def searched(problem: Problem, near: Candidates) -> Candidates:
    """Return what a search finds, and the pose of the prior, where the search has none beside it."""
    ref, cur, prior, _, effort = problem
    poses, scores, n_tried = search(ref.image, cur.image, ref.landmarks, cur.landmarks, prior.pose, effort)
    n = sum(score > _LEAST_SCORE for score in scores.tolist())  # NumPy counts four numbers in ten times as long
    poses, scores = poses[:n], scores[:n]
    if len(near.poses) and not any(distance(near.poses[0], pose) < SAME for pose in poses):
        poses, scores = np.concatenate((poses, near.poses)), np.concatenate((scores, near.scores))
        n_tried += len(near.scores)
    return Candidates(poses, scores, n_tried)


@kernel
def refine_guess(ref: RangeImage, cur: RangeImage, prior: Prior, effort: Effort) -> tuple[Candidates, bool]:
    """Return the pose of the prior, refined, none where no reading agrees.

    And whether it may be right: much agrees there, and the prior has it there.
    """
    guess = prior.pose.copy().reshape((1, 3))
    refined, n_kept = refine(guess, ref, cur, effort.sigmas), len(guess)  # 1 that is no constant
    near, scores = select(refined, ref, cur, CLOSE[0], CLOSE[1], n_kept, effort.n_first[1], NEAR)
    x, y = prior.precision[0, 0] - _NARROW, prior.precision[1, 1] - _NARROW
    least = effort.doubtful_score if x > 0.0 and x * y > prior.precision[0, 1] ** 2 else _CERTAIN_SCORE
    is_likely = scores.size > 0 and scores[0] > least and log_odds(near, prior)[0][0] > TOLD
    return Candidates(near, scores, n_kept), is_likely


@kernel
def search(
    ref: RangeImage, cur: RangeImage, marks_ref: Landmarks, marks_cur: Landmarks, expected: Pose, effort: Effort
) -> tuple[Floats, Floats, int]:
    """Return the best poses that landmarks and the one expected propose, their scores, and how many were verified.

    Where they find little support, or the best has a turn that was not tried, walls are laid on each other once more,
    with its turn: among round things the turns of the directions are too far off.
    """
    turned = rotation_hypotheses(marks_ref.directions, marks_cur.directions, effort.n_rotations, expected)
    tried = translation_hypotheses(turned, turned, ref, cur, marks_ref, marks_cur, effort.max_tried)
    poses, scores = explore(tried, ref, cur, effort)
    n_tried = tried.shape[0]
    if not is_found(poses, scores, turned, effort.doubtful_score):
        is_turn_known = scores.size > 0 and scores[0] > _LEAST_SCORE
        turned = poses[:1] if is_turn_known else turns_beside(turned[min(1, turned.shape[0] - 1)])
        tried = translation_hypotheses(poses, turned, ref, cur, marks_ref, marks_cur, effort.max_tried // 2)
        n_tried += tried.shape[0] - poses.shape[0]
        poses, scores = explore(tried, ref, cur, effort)
    return poses, scores, n_tried


@inlined
def is_found(poses: Floats, scores: Floats, turned: Floats, doubtful_score: float) -> bool:
    """Return whether the best pose finds support, and has the turn of one of (h, 3) `turned`.

    Of one that was refined to another turn competing poses were not tried.
    """
    nearest = math.pi
    for h in range(turned.shape[0] if scores.size > 0 and scores[0] > doubtful_score else 0):
        nearest = min(nearest, abs(wrap_angle(turned[h, 2] - poses[0, 2])))
    return nearest < 0.5 * SAME


@kernel
def turns_beside(pose: Floats) -> Floats:
    """Return (4, 3) poses turned a little to either side of one."""
    turned = np.empty((4, 3))
    for k in range(turned.shape[0]):
        turned[k, 0], turned[k, 1] = pose[0], pose[1]
        turned[k, 2] = pose[2] + _TURN_STEP * (k - 2 if k < 2 else k - 1)
    return turned


@kernel
def explore(poses: Floats, ref: RangeImage, cur: RangeImage, effort: Effort) -> tuple[Floats, Floats]:
    """Return a few poses and their scores: the best of those given, refined."""
    n_kept, n_first = effort.n_kept, effort.n_first
    chosen, _ = select(poses, ref, cur, ROUGH[0], ROUGH[1], n_kept[0], n_first[0], NEAR)
    refined = refine(chosen, ref, cur, effort.sigmas)
    return select(refined, ref, cur, CLOSE[0], CLOSE[1], n_kept[1], n_first[1], NEAR)
