"""Search: from features of two scans to the few poses worth a closer look."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.config import NEAR, SAME, CurvescanConfig
from curvescan.matchers.curvescan.features.features import CurvescanFeatures, Landmarks
from curvescan.matchers.curvescan.features.range_image import RangeImage
from curvescan.matchers.curvescan.pose_difference import distance
from curvescan.matchers.curvescan.prior import Prior, tells
from curvescan.matchers.curvescan.proposal.hypotheses import most_voted, pair_keypoints
from curvescan.matchers.curvescan.proposal.rotation_hypotheses import (
    aligned_translations,
    degenerate_hypotheses,
    rotation_hypotheses,
)
from curvescan.matchers.curvescan.proposal.scoring import CLOSE, MOVED_ALONG, ROUGH, select
from curvescan.matchers.curvescan.refinement import refine
from curvescan.types import Floats

_MAX_PAIRS = 4000  # pairs of keypoints taken, at most
# Where no pose finds support, places up to so many metres along each axis are tried at which walls coincide within so
# many metres, and so many an axis.
_ALIGNED_REACH, _ALIGNED_BIN, _N_ALIGNED = 2.0, SAME, 3
_N_KEPT = 4  # poses that are refined
CONTESTED = 0.3  # a pose with this share of the best one's score competes with it, and is judged beside it
_FEW_TRIED, _CERTAIN_SCORE = 24, 0.55  # see Effort


class Problem(NamedTuple):
    """What is to be matched."""

    # reference, current: both scans
    reference: CurvescanFeatures
    current: CurvescanFeatures
    prior: Prior  # where the current scan is expected in the reference
    config: CurvescanConfig  # all parameters


class Effort(NamedTuple):
    """How widely poses are looked for; as constants each would make Numba compile the kernels that take it anew."""

    sigmas: Floats  # schedule of a quick refinement
    min_turn: float  # by which the turns of two keypoints may differ, radians
    max_pairs: int  # of keypoints
    cell: float  # width of a cell of votes, metres
    max_tried: int  # voted poses
    n_rotations: int  # turns by the directions of surfaces
    along_step: float  # of places along a corridor, metres
    n_along: int  # places to each side
    degenerate_ratio: float  # as in InformationConfig
    doubtful_score: float  # as in ScoringConfig
    # with fewer poses than this to try, or a close rival, other ways are tried up to that score
    few_tried: int
    certain_score: float
    # of rough, moved and closely refined poses how many are kept, and the samples that are tried first
    n_kept: tuple[int, int, int]
    n_first: tuple[int, int, int]


class Candidates(NamedTuple):
    """The best poses found."""

    # (k, 3): poses that differ from one another, refined on the samples, best first; of the current scan in the
    # reference
    poses: Floats
    scores: Floats  # (k,): how well the scans agree there, at most 1
    n_tried: int  # poses that were verified


NOTHING = Candidates(poses=np.empty((0, 3)), scores=np.empty(0), n_tried=0)


def effort_of(config: CurvescanConfig) -> Effort:
    """Return how widely poses are looked for."""
    steps, scoring = config.hypotheses, config.scoring
    return Effort(
        config.refinement.quick_schedule,
        config.keypoints.min_turn,
        _MAX_PAIRS,
        steps.cell,
        steps.max_tried,
        steps.n_rotations,
        steps.along_step,
        round(steps.along_reach / steps.along_step),
        config.information.degenerate_ratio,
        scoring.doubtful_score,
        _FEW_TRIED,
        _CERTAIN_SCORE,
        (_N_KEPT, _N_KEPT + 1, 3),
        (6, 12, 64),
    )


def at_prior(problem: Problem, effort: Effort) -> tuple[Candidates, bool]:
    """Return the pose of a prior that tells where it is, refined, and whether it may be right."""
    ref, cur, prior, _ = problem
    if not prior.is_told:
        return NOTHING, False
    poses, scores, is_likely = refine_guess(ref.image, cur.image, prior, effort)
    return Candidates(poses, scores, len(poses)), is_likely


def searched(problem: Problem, near: Candidates, effort: Effort) -> Candidates:
    """Return what a search finds, and the pose of the prior, where the search has none beside it."""
    ref, cur, prior, _ = problem
    return Candidates(*search(ref.image, cur.image, ref.landmarks, cur.landmarks, prior, *near[:2], effort))


@kernel
def refine_guess(ref: RangeImage, cur: RangeImage, prior: Prior, effort: Effort) -> tuple[Floats, Floats, bool]:
    """Return the pose of the prior, refined, and its score, none where no reading agrees.

    And whether it may be right: much agrees there, and the prior has it there.
    """
    guess = np.empty((1, 3))
    for k in range(3):
        guess[0, k] = prior.pose[k]
    refined, n_kept = refine(guess, ref, cur, effort.sigmas), len(guess)  # 1 that is no constant
    near, scores = select(refined, ref, cur, CLOSE[0], CLOSE[1], n_kept, effort.n_first[2], NEAR)
    return near, scores, scores.size > 0 and scores[0] > effort.certain_score and tells(prior, near)


@kernel
def search(
    ref: RangeImage,
    cur: RangeImage,
    marks_ref: Landmarks,
    marks_cur: Landmarks,
    prior: Prior,
    near: Floats,
    near_scores: Floats,
    effort: Effort,
) -> tuple[Floats, Floats, int]:
    """Return the fields of Candidates: the best poses that landmarks and the prior propose, and the `near` one.

    Where they find little support, and the best is not where the prior has it, the places where walls of both
    scans coincide are tried as well.
    """
    rotated = rotation_hypotheses(marks_ref.directions, marks_cur.directions, effort.n_rotations, prior.pose)
    pairs = pair_keypoints(marks_ref.keypoints, marks_cur.keypoints, ref, cur, effort.min_turn, effort.max_pairs)
    tried = stack(rotated, most_voted(pairs, effort.cell, 0.5 * effort.cell, effort.max_tried))
    poses, scores = explore(tried, ref, cur, effort)
    is_expected = scores.size > 0 and scores[0] > effort.doubtful_score and tells(prior, poses)
    if not is_expected and is_doubtful(scores, tried.shape[0], effort):
        aligned = aligned_translations(rotated, ref.samples, cur.samples, _ALIGNED_REACH, _ALIGNED_BIN, _N_ALIGNED)
        tried = stack(poses, aligned)
        poses, scores = explore(tried, ref, cur, effort)
    for k in range(scores.size):
        if near_scores.size == 0 or distance(near[0], poses[k]) < SAME:
            return poses, scores, tried.shape[0]
    with_near = np.empty(scores.size + near_scores.size)
    for k in range(with_near.size):
        with_near[k] = scores[k] if k < scores.size else near_scores[k - scores.size]
    return stack(poses, near), with_near, tried.shape[0] + near_scores.size


@inlined
def is_doubtful(scores: Floats, n_tried: int, effort: Effort) -> bool:
    """Return whether the best pose finds little support, or middling with few poses or a close competing hypothesis."""
    if scores.size == 0 or scores[0] < effort.doubtful_score:
        return True
    has_rival = scores.size > 1 and scores[1] > CONTESTED * scores[0]
    return bool(scores[0] < effort.certain_score and (n_tried < effort.few_tried or has_rival))


@kernel
def stack(first: Floats, second: Floats) -> Floats:
    """Return (h + k, 3) the poses of both; np.concatenate takes half a second to compile."""
    n = first.shape[0]
    both = np.empty((n + second.shape[0], 3))
    for i in range(both.shape[0]):
        for k in range(3):
            both[i, k] = first[i, k] if i < n else second[i - n, k]
    return both


@kernel
def explore(poses: Floats, ref: RangeImage, cur: RangeImage, effort: Effort) -> tuple[Floats, Floats]:
    """Return a few poses and their scores: the best of those given, refined.

    If need be they are moved along a degenerate direction and refined again.
    """
    n_kept, n_first = effort.n_kept, effort.n_first
    chosen, _ = select(poses, ref, cur, ROUGH[0], ROUGH[1], n_kept[0], n_first[0], NEAR)
    quick = refine(chosen, ref, cur, effort.sigmas)
    moved_along = degenerate_hypotheses(quick[:2], ref, cur, effort.along_step, effort.n_along, effort.degenerate_ratio)
    if moved_along.shape[0] > 0:
        chosen, _ = select(
            stack(quick, moved_along), ref, cur, MOVED_ALONG[0], MOVED_ALONG[1], n_kept[1], n_first[1], NEAR
        )
        quick = refine(chosen, ref, cur, effort.sigmas)
    return select(quick, ref, cur, CLOSE[0], CLOSE[1], n_kept[2], n_first[2], NEAR)
