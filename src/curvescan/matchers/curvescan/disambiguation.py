"""Disambiguation: which of the refined candidates stands alone, and what the scans leave open there."""

from __future__ import annotations

import math

import numpy as np

from curvescan.matchers.curvescan.assessment.assessment import DOUBLED, AssessedPose, Assessment, Known, assess_pose
from curvescan.matchers.curvescan.assessment.confidence import ScoredPoses
from curvescan.matchers.curvescan.assessment.evidence import extent
from curvescan.matchers.curvescan.features.features import CurvescanFeatures
from curvescan.matchers.curvescan.pose_difference import difference
from curvescan.matchers.curvescan.proposal.scoring import FINE, agreement_lost, select
from curvescan.matchers.curvescan.proposal.search import Problem
from curvescan.matchers.curvescan.refinement import refine
from curvescan.matchers.result import Candidate, Outcome
from curvescan.types import Cov, Floats, Pose

# What a metre, a metre and a radian of a pose count when motions along a degenerate direction are measured.
_ARMS = np.array([1.0, 1.0, 2.0])
_DIRECTION_SIGMA = 0.003  # standard deviation of a degenerate direction, radians
# Least share of the score that a pose moved along a degenerate direction must keep: two scans taken a metre apart on a
# bare corridor have less in common than they seem to where they are laid over each other.
_SHARE = 0.7
# Metres of translation in a degenerate direction, which moves a typical reading by one: less is a turn.
_LEAST_SHIFT = 0.5
_UNSEEN = 1 / 9  # odds of each thing that the scans cannot show: of 1,744 such pairs it is so in one of 8
_BOX = 2.3  # metres from corner to corner of what agrees: in less a robot turns round


def disambiguate(problem: Problem, assessed: AssessedPose) -> tuple[Outcome, float]:
    """Return whether the pose stands alone, or why not, and how likely it is right within what its covariance says.

    A candidate along a degenerate direction does not compete: the covariance holds it.
    """
    assessment, support = assessed.assessment, assessed.support
    ref, cur, _, config, _ = problem
    least = config.scoring.min_confidence
    if assessment is None or support is None or all(assessed.is_degenerate):
        return Outcome.UNSUPPORTED, 0.0
    accept, unsupported = support.probabilities(assessed.ties)
    is_alone = set(support.repeated) <= set(assessed.ties)
    if is_alone and accept < least and 1.0 - unsupported < least:
        return Outcome.UNSUPPORTED, 0.0
    is_turned = assessed.scored.may_be_turned or is_in_box(ref, cur, assessed.scored, assessment)
    if not is_alone or accept < least or is_turned:
        return Outcome.AMBIGUOUS, 0.0
    return Outcome.MATCHED, 1.0 / (1.0 / accept + unseen_odds(assessed, assessment))


def unseen_odds(assessed: AssessedPose, assessment: Assessment) -> float:
    """Return the odds of what the scans cannot show: half a turn in a corridor or a bare room, and what kept pace."""
    scored, is_open = assessed.scored, assessed.is_degenerate[0]
    is_same_turned = (is_open or scored.is_bare or scored.is_along_walls) and not scored.is_told(0)
    return _UNSEEN * sum((is_same_turned, assessment.may_keep_pace and not is_open))


def is_in_box(ref: CurvescanFeatures, cur: CurvescanFeatures, scored: ScoredPoses, assessment: Assessment) -> bool:
    """Return whether the first pose may be turned by a quarter in a place as small as the cabin of an elevator.

    Of half a circle two walls are in sight, which fit any corner; what the door shows may be another floor.
    """
    views = (ref, assessment.codes_ref), (cur, assessment.codes_cur)
    return scored.is_bare_and_moved and max(extent(view.image.surfels, codes) for view, codes in views) < _BOX


def place(problem: Problem, assessed: AssessedPose, assessment: Assessment) -> tuple[Pose, Assessment, Known]:
    """Return the pose, moved along a direction that is open to where a prior has it; what the scans say there."""
    prior, config = problem.prior, problem.config
    ties, is_degenerate = assessed.ties, assessed.is_degenerate
    poses, pose = assessed.scored.poses, assessed.scored.poses[0]
    information, cov = assessed.known
    if assessed.is_flat and prior.is_told:
        pose, assessment = move_to_guess(problem, pose, assessment)
        information, cov = assessment.matrices(is_degenerate, config)
    if is_degenerate[0]:
        # walls are parallel to a few milliradians only
        dx, dy, _ = assessment.weakest.tolist()
        across = _DIRECTION_SIGMA * config.information.degenerate_sigma * np.array([-dy, dx, 0.0])
        cov = cov + np.outer(across, across)
    if is_degenerate[0] and ties:
        cov += covariance_of_ties(pose, poses[[0, *ties]])
    return pose, assessment, (information, cov)


def competing_poses(problem: Problem, assessed: AssessedPose, placed: Assessment | None) -> tuple[Candidate, ...]:
    """Return the best pose and its competing hypotheses, the most likely first, each with what the scans say there.

    placed: what they say of the best where it was placed, if it was.
    """
    support, first = assessed.support, assessed.assessment
    if support is None or first is None:
        return ()
    sigma = sigma_along(problem, assessed, first, (placed or first).weakest) if assessed.is_degenerate[0] else None
    poses, known, config = assessed.scored.poses, assessed.known, problem.config
    if sigma is not None:
        sure = first._replace(information=(sigma**-2, *first.information[1:]))
        known = sure.matrices((False, False, False), config)
    candidates, found, is_open, log_odds = [], first, assessed.is_degenerate, support.log_odds
    for row in [0, *sorted(support.competing, key=lambda row: -support.competing[row])]:
        if row:
            found = assess_pose(problem.reference, problem.current, poses[row], config)
            is_open, log_odds = found.is_open, support.log_odds + support.competing[row]
            known = found.matrices(is_open, config)
        one = Candidate(
            pose=poses[row],
            log_odds=log_odds,
            information=known[0],
            covariance=known[1],
            degenerate_direction=found.weakest if is_open[0] else None,
            n_matched=found.n_inliers,
        )
        candidates.append(one)
    return tuple(candidates)


def sigma_along(problem: Problem, assessed: AssessedPose, first: Assessment, direction: Pose) -> float | None:
    """Return how well the best place along the direction that the scans leave open is known, metres; None for not.

    It is where both scans see less agreement some way along. Near a guess the best place is not looked for.
    """
    rules, images = problem.config.information, (problem.reference.image, problem.current.image)
    if any(assessed.is_degenerate[1:]) or math.hypot(*direction[:2]) <= _LEAST_SHIFT:
        return None
    if problem.prior.is_told and (assessed.ties or first.is_open[0]):
        return None
    way = 2.0 * DOUBLED[-1] * rules.max_sigma * direction
    lost = agreement_lost(assessed.scored.poses[0], way, *images, *FINE)
    return rules.max_sigma if lost > 0.5 * rules.degenerate_ratio else None


def covariance_of_ties(pose: Pose, ties: Floats) -> Cov:
    """Return the (3, 3) second moment about a pose of those that it may as well be, each as likely, itself among them.

    The covariance of a pose is computed at one place along a degenerate direction, and knows the direction there to
    milliradians: a tie a metre along lies beside it by many of its standard deviations.
    """
    min_difference = np.array([difference(tie, pose) for tie in ties])
    moment: Cov = min_difference.T @ min_difference / len(ties)
    return moment


def move_to_guess(problem: Problem, pose: Pose, assessment: Assessment) -> tuple[Pose, Assessment]:
    """Return a pose moved along its degenerate direction to its guess, and its assessment there, if the scans agree.

    Where motion along it is unobservable, the pose lies anywhere; and as the direction itself is known to a few
    milliradians only, half a metre along it that is added afterwards would turn the pose by as much.
    """
    ref, cur, prior, config, effort = problem
    along = assessment.weakest * _ARMS
    offset = np.array(difference(prior.pose, pose)) * _ARMS
    distance_along = float(along @ offset) / float(along @ along)
    moved_along = pose + distance_along * assessment.weakest
    moved_along = refine(moved_along[np.newaxis], ref.full_image, cur.full_image, effort.closer)
    images = ref.wide_image, cur.wide_image
    before, after = (select(one, *images, *FINE, 1, 4096, 0.0)[1] for one in (pose[np.newaxis], moved_along))
    if not len(after) or after[0] < _SHARE * before[0]:
        return pose, assessment
    found = assess_pose(ref, cur, moved_along[0], config)
    return (moved_along[0], found) if found.is_enough(config) else (pose, assessment)
