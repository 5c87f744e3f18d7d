"""Disambiguation: which of the refined candidates stands alone, and what the scans leave open there."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from curvescan.matchers.curvescan.assessment.assessment import (
    DOUBLED,
    Assessment,
    assess_pose,
    degenerate_directions,
    without_dynamic,
)
from curvescan.matchers.curvescan.assessment.confidence import ANY, Support, WeighedPoses, support_of
from curvescan.matchers.curvescan.assessment.evidence import SMALL, extent
from curvescan.matchers.curvescan.assessment.information import Open
from curvescan.matchers.curvescan.candidates import direction_of_walls
from curvescan.matchers.curvescan.config import NEAR, CurvescanConfig
from curvescan.matchers.curvescan.features.features import CurvescanFeatures
from curvescan.matchers.curvescan.pose_difference import difference, distance, is_along
from curvescan.matchers.curvescan.prior import log_odds
from curvescan.matchers.curvescan.proposal.scoring import FINE, agreement_lost, select
from curvescan.matchers.curvescan.proposal.search import Problem
from curvescan.matchers.curvescan.refinement import refine
from curvescan.matchers.result import NO_COVARIANCE, NO_INFORMATION, Candidate, Outcome
from curvescan.types import Cov, Floats, Pose

# (3, 3): the information on a pose, zero along what is open, and its covariance, wide there.
Known: TypeAlias = tuple[Cov, Cov]

# What a metre, a metre and a radian of a pose count when motions along a degenerate direction are measured.
_ARMS = np.array([1.0, 1.0, 2.0])
_DIRECTION_SIGMA = 0.003  # standard deviation of a degenerate direction, radians
# Least share of the score that a pose moved along a degenerate direction must keep: two scans taken a metre apart on a
# bare corridor have less in common than they seem to where they are laid over each other.
_SHARE = 0.7
# Metres of translation in a degenerate direction, which moves a typical reading by one: less is a turn.
_LEAST_SHIFT = 0.5
_MAX_CANDIDATES = 8
_BOX = 2.3  # metres from corner to corner of what agrees: in less a robot turns round
_STILL = -0.015  # log odds of the prior from which on it speaks for the pose there: 0.35 m, 20 degrees


class AssessedPose(NamedTuple):
    """The best candidate without what moved, and what the scans say of it."""

    weighed: WeighedPoses  # it, and the other candidates
    is_degenerate: Open  # which principal directions of the information the scans leave open, the least informed first
    # rows of the candidates that may be right as well and differ by a motion along the least informed direction
    ties: list[int]
    assessment: Assessment | None = None  # of the first; None where too few readings agree
    # whether the scans agree as well anywhere along the least informed direction; else only at the ties, if there are
    # any
    is_flat: bool = False
    support: Support | None = None  # what speaks for the first and against it; None where too few readings agree
    known: Known = (NO_INFORMATION, NO_COVARIANCE)  # what the scans say of the first alone


def assess(problem: Problem, weighed: WeighedPoses, assessment: Assessment | None) -> AssessedPose:
    """Return the best candidate refined without what moved, the directions left open there, and what supports it."""
    ref, cur, _, config, _ = problem
    if assessment is not None and assessment.n_dynamic:
        poses, assessment = without_dynamic(ref, cur, weighed.poses, assessment, config)
        weighed = replace(weighed, poses=poses)
    if assessment is None or not assessment.is_enough(config.scoring):
        return AssessedPose(weighed=weighed, is_degenerate=(True, True, True), ties=[])
    poses = weighed.poses
    is_open, second, third = degenerate_directions(ref, cur, poses[0], assessment, config)
    if is_open:
        # where the scans leave a direction open, the prior decides along it: it is not held against the pose
        slid = problem.prior.nearest_along(poses[0], assessment.weakest, config.hypotheses.along_reach)
        priors, wide_priors = log_odds(np.vstack((slid, poses[1:])), problem.prior)
        weighed = replace(weighed, priors=priors, wide_priors=wide_priors)
    walls = direction_of_walls(ref, assessment) if weighed.is_one_way else None
    along = along_weakest_direction(poses, assessment, is_open, walls, config)
    least = assessment.as_good(config.information) * weighed.scores[0]
    is_flat = is_open or (
        assessment.is_weakly_observable(config.information) and any(weighed.scores[k] > least for k in along)
    )
    others = [k for k in range(1, len(poses)) if distance(poses[k], poses[0]) > NEAR and not (is_flat and k in along)]
    support = support_of(weighed, others)
    ties = [k for k in along if weighed.scores[k] > least] if is_flat else ties_of(support, along, config)
    if walls is not None:
        ties = [k for k in along if k in ties or weighed.is_as_likely(k)]
    is_degenerate = is_flat or len(ties) > 0, second, third
    return AssessedPose(
        weighed=weighed,
        assessment=assessment,
        is_degenerate=is_degenerate,
        is_flat=is_flat,
        ties=ties,
        support=support,
        known=assessment.matrices(is_degenerate, config.information),
    )


def along_weakest_direction(
    poses: Floats, assessment: Assessment, is_open: bool, walls: Pose | None, config: CurvescanConfig
) -> list[int]:
    """Return the rows of the poses that differ from the first by a motion along its weakest direction, if weak or open.

    Or along the `walls`, where nearly all that agrees runs their way.
    """
    rules = config.information
    is_weak = assessment.information[0] < 2.0 * rules.degenerate_ratio * assessment.information[1]
    directions = [] if walls is None else [walls]
    if is_weak or is_open:
        directions.append(assessment.weakest)
    return [k for k in range(1, len(poses)) if any(is_along(one, poses[0], poses[k], 0.5 * NEAR) for one in directions)]


def ties_of(support: Support, along: list[int], config: CurvescanConfig) -> list[int]:
    """Return rows along the weakest direction that may be right instead of the first: all, unless it is sure alone."""
    if not along:
        return []
    ties = [k for k in support.repeated if k in along]
    if support.probabilities(ties)[0] < config.scoring.min_confidence:
        ties = [k for k in along if k in support.rivals]
    return ties


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
    is_turned = assessed.weighed.may_be_turned or is_in_box(ref, cur, assessed.weighed, assessment)
    if not is_alone or accept < least or is_turned:
        return Outcome.AMBIGUOUS, 0.0
    return Outcome.MATCHED, accept


def is_in_box(ref: CurvescanFeatures, cur: CurvescanFeatures, weighed: WeighedPoses, assessment: Assessment) -> bool:
    """Return whether the first pose may be turned by a quarter in a place as small as the cabin of an elevator.

    Nothing but its walls agrees, no people hide the rest, and neither a prior nor standing still speaks for the pose.
    Of half a circle two walls are in sight, which fit any corner; what the door shows may be another floor.
    """
    if not weighed.is_bare or weighed.evidence[0, SMALL] > ANY or weighed.is_told(0) or weighed.wide_priors[0] > _STILL:
        return False
    sizes = (extent(ref.image.surfels, assessment.codes_ref), extent(cur.image.surfels, assessment.codes_cur))
    return max(sizes) < _BOX


def place(problem: Problem, assessed: AssessedPose, assessment: Assessment) -> tuple[Pose, Assessment, Known]:
    """Return the pose, moved along a direction that is open to where a prior has it; what the scans say there."""
    prior, config = problem.prior, problem.config
    ties, is_degenerate = assessed.ties, assessed.is_degenerate
    poses, pose = assessed.weighed.poses, assessed.weighed.poses[0]
    information, cov = assessed.known
    if assessed.is_flat and prior.is_told:
        pose, assessment = move_to_guess(problem, pose, assessment)
        information, cov = assessment.matrices(is_degenerate, config.information)
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
    poses, rules = assessed.weighed.poses, problem.config.information
    known = assessed.known
    if sigma is not None:
        sure = first._replace(information=(sigma**-2, *first.information[1:]))
        known = sure.matrices((False, False, False), rules)
    candidates, found, is_open, log_odds = [], first, assessed.is_degenerate, support.log_odds
    for row in [0, *sorted(support.rivals, key=lambda row: -support.rivals[row])][:_MAX_CANDIDATES]:
        if row:
            found = assess_pose(problem.reference, problem.current, poses[row], problem.config)
            is_open, log_odds = found.is_open, support.log_odds + support.rivals[row]
            known = found.matrices(is_open, rules)
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
    lost = agreement_lost(assessed.weighed.poses[0], way, *images, *FINE)
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
    return (moved_along[0], found) if found.is_enough(config.scoring) else (pose, assessment)
