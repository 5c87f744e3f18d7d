"""Contest: the few best poses refined on all readings, and which of them, if any, stands alone.

Poses are the rows of an array, best first; scores the numbers beside them. A rival is a pose with nearly the best score.
"""

from __future__ import annotations

import numpy as np

from curvescan.matchers.curvescan.assessment import Assessment, assess_pose
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.features import CurvescanFeatures
from curvescan.matchers.curvescan.pose_difference import difference, distance, is_along
from curvescan.matchers.curvescan.range_image import RangeImage
from curvescan.matchers.curvescan.refinement import refine, refine_fully
from curvescan.matchers.curvescan.scoring import select
from curvescan.matchers.curvescan.search import Candidates
from curvescan.types import Cov, Floats, Pose

_ARMS = np.array([1.0, 1.0, 2.0])
"""What a metre, a metre and a radian of a pose count when slides are measured."""

_SHARE = 0.7
"""Least share of the score that a pose slid along an open direction must keep: two scans taken a metre apart on a bare
corridor have less in common than they seem to where they are laid over each other."""


def top_candidates(
    ref: CurvescanFeatures, cur: CurvescanFeatures, found: Candidates, config: CurvescanConfig
) -> tuple[Floats, Floats]:
    """Return the best pose and those that come near it, refined on all readings, best first, and their scores."""
    if not len(found.scores):
        return found.poses, found.scores
    near = found.poses[found.scores > config.scoring.contested * found.scores[0]]
    return _finish(ref, cur, near, config)


def search_degenerate_direction(
    ref: CurvescanFeatures,
    cur: CurvescanFeatures,
    poses: Floats,
    weakest: Pose,
    config: CurvescanConfig,
) -> tuple[Floats, Floats]:
    """Return the poses and the best of those along the weakest direction of the first, best first, and their scores."""
    rules = config.information
    n = round(config.hypotheses.along_reach / rules.fine_along_step)
    offsets = np.arange(-n, n + 1) * rules.fine_along_step
    moved_along = poses[0] + offsets[:, np.newaxis] * weakest
    moved_along = moved_along[np.abs(offsets * weakest[2]) < rules.max_along_turn]
    best, _ = select(
        moved_along, *_wide_range_images(ref, cur, config), *config.scoring.close, 4, 24, 0.1
    )
    return _finish(ref, cur, np.concatenate((poses, best)), config)


def _finish(
    ref: CurvescanFeatures, cur: CurvescanFeatures, poses: Floats, config: CurvescanConfig
) -> tuple[Floats, Floats]:
    sigmas = config.refinement.closer_schedule, config.refinement.full_schedule
    final = refine_fully(poses, ref.image, cur.image, *sigmas)
    # one pose has only to be enough; several are told apart by more probes
    images = _wide_range_images(ref, cur, config) if len(poses) > 1 else (ref.image, cur.image)
    return select(final, *images, *config.scoring.fine, 3, 4096, 0.1)


def _wide_range_images(
    ref: CurvescanFeatures, cur: CurvescanFeatures, config: CurvescanConfig
) -> tuple[RangeImage, RangeImage]:
    """Return the views of both scans with more probes, to tell apart poses that are nearly as good as each other."""
    n_wide = config.scoring.n_wide
    return ref.with_samples(n_wide), cur.with_samples(n_wide)


def without_dynamic(
    ref: CurvescanFeatures,
    cur: CurvescanFeatures,
    poses: Floats,
    assessment: Assessment,
    config: CurvescanConfig,
) -> tuple[Floats, Assessment]:
    """Return the poses, the first refined without the surfaces that moved, and the evidence for it."""
    if not assessment.n_dynamic:
        return poses, assessment
    static_ref = ref.image._replace(samples=ref.image.surfels[assessment.is_static_ref])
    static_cur = cur.image._replace(samples=cur.image.surfels[assessment.is_static_cur])
    pose = refine(poses[:1], static_ref, static_cur, config.refinement.full_schedule)
    return np.concatenate((pose, poses[1:])), assess_pose(ref, cur, pose[0], config)


def competing_hypotheses(scores: Floats, config: CurvescanConfig) -> list[int]:
    """Return the rows of the poses that are as good as the first."""
    share, margin = config.scoring.ambiguity
    least = min(share * scores[0], scores[0] - margin)
    return [k for k in range(1, len(scores)) if scores[k] > least]


def prefer(
    guess: Pose | None, poses: Floats, scores: Floats, config: CurvescanConfig
) -> tuple[Floats, Floats]:
    """Return the poses, or of those as good as the first the one that a guess is clearly nearest to, alone."""
    rows = [0, *competing_hypotheses(scores, config)]
    if guess is None or len(rows) == 1:
        return poses, scores
    distances = [distance(poses[k], guess) for k in rows]
    first, second = np.argsort(distances, kind="stable")[:2].tolist()
    if 2.0 * distances[first] > distances[second]:
        return poses, scores
    kept = rows[first]
    return poses[kept : kept + 1], scores[kept : kept + 1]


def along_degenerate_direction(
    poses: Floats, scores: Floats, assessment: Assessment, config: CurvescanConfig
) -> list[int]:
    """Return the rows of the rivals that differ by a motion along the first one's weakest direction."""
    tolerance = config.information.along_tolerance
    return [
        k
        for k in competing_hypotheses(scores, config)
        if is_along(assessment.weakest, poses[0], poses[k], tolerance)
    ]


def nearest_of_ties(
    guess: Pose | None, poses: Floats, scores: Floats, rows: list[int], config: CurvescanConfig
) -> Pose:
    """Return of the first pose and those rows that tie with it the one nearest to the guess, or to standing still."""
    around = np.zeros(3) if guess is None else guess
    ties = [0, *(k for k in rows if scores[k] > config.information.tie * scores[0])]
    nearest: Pose = poses[min(ties, key=lambda k: distance(poses[k], around))]
    return nearest


def covariance_of_ties(pose: Pose, ties: Floats) -> Cov:
    """Return the (3, 3) second moment about a pose of those that it may as well be, each as likely, itself among them.

    The covariance of a pose is told at one place along an open direction, and knows the direction there to milliradians:
    a tie a metre along lies beside it by many of its standard deviations.
    """
    min_difference = np.array([difference(tie, pose) for tie in ties])
    moment: Cov = min_difference.T @ min_difference / len(ties)
    return moment


def move_to_guess(
    ref: CurvescanFeatures,
    cur: CurvescanFeatures,
    guess: Pose,
    pose: Pose,
    assessment: Assessment,
    config: CurvescanConfig,
) -> tuple[Pose, Assessment]:
    """Return a pose slid along its open direction to where a guess has it, and the evidence there, if the scans agree.

    Where nothing tells how far along it went, the pose lies anywhere; and as the direction itself is known to a few
    milliradians only, a slide of half a metre that is made afterwards would turn the pose by as much.
    """
    along = assessment.weakest * _ARMS
    offset = np.array(difference(guess, pose)) * _ARMS
    slide = float(along @ offset) / float(along @ along)
    moved_along = pose + slide * assessment.weakest
    moved_along = refine(
        moved_along[np.newaxis], ref.full_image, cur.full_image, config.refinement.closer_schedule
    )
    images = _wide_range_images(ref, cur, config)
    before, after = (
        select(one, *images, *config.scoring.fine, 1, 4096, 0.0)[1]
        for one in (pose[np.newaxis], moved_along)
    )
    if not len(after) or after[0] < _SHARE * before[0]:
        return pose, assessment
    found = assess_pose(ref, cur, moved_along[0], config)
    return (moved_along[0], found) if found.is_enough(config.scoring) else (pose, assessment)
