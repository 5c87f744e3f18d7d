"""Search: from features of two scans to the few poses worth a closer look."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.config import NEAR, SAME, CurvescanConfig
from curvescan.matchers.curvescan.features.features import CurvescanFeatures
from curvescan.matchers.curvescan.features.range_image import RangeImage
from curvescan.matchers.curvescan.pose_difference import distance
from curvescan.matchers.curvescan.prior import Prior
from curvescan.matchers.curvescan.proposal.hypotheses import most_voted, pair_keypoints
from curvescan.matchers.curvescan.proposal.rotation_hypotheses import (
    aligned_translations,
    degenerate_hypotheses,
    rotation_hypotheses,
)
from curvescan.matchers.curvescan.proposal.scoring import CLOSE, MOVED_ALONG, ROUGH, select
from curvescan.matchers.curvescan.refinement import refine
from curvescan.types import Floats, Pose

_MAX_PAIRS = 4000  # pairs of keypoints taken, at most
# Where no pose finds support, places up to so many metres along each axis are tried at which walls coincide within so
# many metres, and so many an axis.
_ALIGNED_REACH, _ALIGNED_BIN, _N_ALIGNED = 2.0, SAME, 3
_N_KEPT = 4  # poses that are refined
CONTESTED = 0.3  # a pose with this share of the best one's score competes with it, and is judged beside it
_FEW_TRIED, _CERTAIN_SCORE = 24, 0.55  # with fewer poses than this to try, other ways are tried up to the next score


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
    # of rough, moved and closely refined poses: metres, and metres for each metre of range; how many of each are kept,
    # and the samples that are tried first
    tolerances: tuple[float, float, float, float, float, float]
    n_kept: tuple[int, int, int]
    n_first: tuple[int, int, int]


class Candidates(NamedTuple):
    """The best poses found."""

    # (k, 3): poses that differ from one another, refined on the samples, best first; of the current scan in the
    # reference
    poses: Floats
    scores: Floats  # (k,): how well the scans agree there, at most 1
    n_tried: int  # poses that were verified


def propose(problem: Problem) -> Candidates:
    """Return the best poses: the expected one alone where it is to be trusted, else what a search finds, and it."""
    ref, cur, prior, config = problem
    if not prior.is_told:
        return search(ref, cur, prior, config)
    near = refine_guess(ref, cur, prior.pose, config)
    if is_trusted(ref, cur, prior, near, config):
        return near
    found = search(ref, cur, prior, config)
    if not len(near.scores) or any(distance(near.poses[0], pose) < SAME for pose in found.poses):
        return found
    return Candidates(
        poses=np.concatenate((found.poses, near.poses)),
        scores=np.concatenate((found.scores, near.scores)),
        n_tried=found.n_tried + 1,
    )


def refine_guess(ref: CurvescanFeatures, cur: CurvescanFeatures, guess: Pose, config: CurvescanConfig) -> Candidates:
    """Return the guess refined, or nothing where no reading agrees."""
    images = (ref.image, cur.image)
    near = refine(guess[np.newaxis], *images, config.refinement.quick_schedule)
    near, scores = select(near, *images, *CLOSE, 1, 64, NEAR)
    return Candidates(poses=near, scores=scores, n_tried=1)


def is_trusted(
    ref: CurvescanFeatures, cur: CurvescanFeatures, prior: Prior, near: Candidates, config: CurvescanConfig
) -> bool:
    """Return whether the refined guess is taken without a look at others.

    It is when enough readings agree there, it lies where the prior has it, and both axes are fixed.
    """
    rules = config.information
    return bool(
        len(near.scores)
        and near.scores[0] > config.scoring.guess_score
        and prior.tells(near.poses[0])
        and not len(
            degenerate_hypotheses(
                near.poses, ref.image, cur.image, config.hypotheses.along_step, 1, rules.degenerate_ratio
            )
        )
    )


def search(ref: CurvescanFeatures, cur: CurvescanFeatures, prior: Prior, config: CurvescanConfig) -> Candidates:
    """Return the best poses of all that keypoints, directions of surfaces and the prior propose.

    Where they find little support, and the best is not where the prior has it, the places where walls of both
    scans coincide are tried as well.
    """
    effort = _effort(config)
    poses, scores, rotated, n_tried = propose_widely(
        prior.pose, ref.image, ref.keypoints, ref.directions, cur.image, cur.keypoints, cur.directions, effort
    )
    found = Candidates(poses=poses, scores=scores, n_tried=n_tried)
    if not _is_doubtful(found, config) or _is_expected(found, prior, config):
        return found
    aligned = aligned_translations(
        rotated, ref.image.samples, cur.image.samples, _ALIGNED_REACH, _ALIGNED_BIN, _N_ALIGNED
    )
    tried = np.concatenate((found.poses, aligned))
    poses, scores = explore(tried, ref.image, cur.image, effort)
    return Candidates(poses=poses, scores=scores, n_tried=len(tried))


def _effort(config: CurvescanConfig) -> Effort:
    steps = config.hypotheses
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
        (*ROUGH, *MOVED_ALONG, *CLOSE),
        (_N_KEPT, _N_KEPT + 1, 3),
        (6, 12, 64),
    )


@kernel
def propose_widely(
    expected: Pose,
    ref: RangeImage,
    keypoints_ref: Floats,
    directions_ref: Floats,
    cur: RangeImage,
    keypoints_cur: Floats,
    directions_cur: Floats,
    effort: Effort,
) -> tuple[Floats, Floats, Floats, int]:
    """Return the best poses that keypoints, directions and a prior propose, their scores, all turns, and how many."""
    rotated = rotation_hypotheses(directions_ref, directions_cur, effort.n_rotations, expected)
    pairs = pair_keypoints(keypoints_ref, keypoints_cur, ref, cur, effort.min_turn, effort.max_pairs)
    tried = stack(rotated, most_voted(pairs, effort.cell, 0.5 * effort.cell, effort.max_tried))
    poses, scores = explore(tried, ref, cur, effort)
    return poses, scores, rotated, tried.shape[0]


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
    rough, rough_slope, moved, moved_slope, close, close_slope = effort.tolerances
    n_kept, n_first = effort.n_kept, effort.n_first
    chosen, _ = select(poses, ref, cur, rough, rough_slope, n_kept[0], n_first[0], NEAR)
    quick = refine(chosen, ref, cur, effort.sigmas)
    moved_along = degenerate_hypotheses(quick[:2], ref, cur, effort.along_step, effort.n_along, effort.degenerate_ratio)
    if moved_along.shape[0] > 0:
        chosen, _ = select(stack(quick, moved_along), ref, cur, moved, moved_slope, n_kept[1], n_first[1], NEAR)
        quick = refine(chosen, ref, cur, effort.sigmas)
    return select(quick, ref, cur, close, close_slope, n_kept[2], n_first[2], NEAR)


def _is_expected(found: Candidates, prior: Prior, config: CurvescanConfig) -> bool:
    """Return whether the best pose lies where the prior has it, and finds some support."""
    return bool(len(found.scores) and found.scores[0] > config.scoring.doubtful_score and prior.tells(found.poses[0]))


def _is_doubtful(found: Candidates, config: CurvescanConfig) -> bool:
    """Return whether the best pose finds little support, or middling with few poses or a close competing hypothesis."""
    scoring, scores = config.scoring, found.scores
    if not len(scores) or scores[0] < scoring.doubtful_score:
        return True
    if found.n_tried < _FEW_TRIED and scores[0] < _CERTAIN_SCORE:
        return True
    is_contested = len(scores) > 1 and scores[1] > CONTESTED * scores[0]
    return bool(is_contested and scores[0] < scoring.guess_score)
