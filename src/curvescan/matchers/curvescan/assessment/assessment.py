"""Assessment: what two scans say of a pose, which directions they leave open, and what supports it."""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple, TypeAlias

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.assessment.confidence import ScoredPoses, Support, support_of
from curvescan.matchers.curvescan.assessment.evidence import Compared, gather_evidence
from curvescan.matchers.curvescan.assessment.information import Open, Row, matrices, pose_information
from curvescan.matchers.curvescan.assessment.labels import MOVED, mark_moved
from curvescan.matchers.curvescan.association import BACKWARD, FORWARD
from curvescan.matchers.curvescan.config import AS_GOOD, LASER_ERROR, NEAR, CurvescanConfig
from curvescan.matchers.curvescan.features.features import CurvescanFeatures
from curvescan.matchers.curvescan.pose_difference import distance, is_along
from curvescan.matchers.curvescan.prior import log_odds
from curvescan.matchers.curvescan.proposal.scoring import FINE, select
from curvescan.matchers.curvescan.proposal.search import Problem
from curvescan.matchers.curvescan.refinement import EXACTLY, refine
from curvescan.matchers.result import NO_COVARIANCE, NO_INFORMATION
from curvescan.types import Codes, Cov, Floats, Pose

# (3, 3): the information on a pose, zero along what is open, and its covariance, wide there.
Known: TypeAlias = tuple[Cov, Cov]

# How far along a weak direction the scans are compared, in what it is known to where it just counts as known.
DOUBLED: Floats = np.array([1.0, 2.0, 4])


class Assessment(NamedTuple):
    """What two scans say of a pose."""

    # codes_ref, codes_cur: (m,), (k,): what each reading is to the other scan; codes of labels.py
    codes_ref: Codes
    codes_cur: Codes
    n_inliers: int  # readings of the current scan that agree
    n_dynamic: int  # surfaces that moved as a whole, of both scans
    # information, axes, units: principal directions of the information; see
    # :func:`curvescan.matchers.curvescan.assessment.information.pose_information`. A few numbers that Python compares
    # are no arrays, which take ten times as long
    information: Row
    axes: Floats
    units: Floats
    is_open: Open  # of which of them the readings say next to nothing, or no more than tilted lines
    may_keep_pace: bool  # whether things that may move with the sensor alone measure what is measured

    @property
    def weakest(self) -> Pose:
        """(3,) least observable direction of the pose: metres, metres, radians; moves a typical reading by 1 m."""
        weakest: Pose = self.axes[:, 0] * self.units
        return weakest

    def is_weakly_observable(self, config: CurvescanConfig) -> bool:
        """Return whether one direction has much less information than the next."""
        return self.information[0] < config.information.degenerate_ratio * self.information[1]

    def as_good(self, config: CurvescanConfig) -> float:
        """Return the share of the score from which on a place along the weakest direction is as good."""
        return AS_GOOD if self.information[0] > LASER_ERROR**-2 else 1.0 - config.information.degenerate_ratio

    def is_enough(self, config: CurvescanConfig) -> bool:
        """Return whether so many readings agree that chance does not explain it."""
        return self.n_inliers >= min(config.scoring.min_inliers, len(self.codes_cur) / 3)

    def matrices(self, is_open: Open, config: CurvescanConfig) -> Known:
        """Return the (3, 3) information on the pose, zero along what is open, and its covariance, wide there."""
        return matrices(self.information, self.axes, self.units, is_open, config.information.degenerate_sigma)


class AssessedPose(NamedTuple):
    """The best candidate without what moved, and what the scans say of it."""

    scored: ScoredPoses  # it, and the other candidates
    is_degenerate: Open  # which principal directions of the information the scans leave open, the least informed first
    # rows of the candidates that may be right as well and differ by a motion along the least informed direction
    ties: list[int]
    assessment: Assessment | None = None  # of the first; None where too few readings agree
    # whether the scans agree as well anywhere along the least informed direction; else only at the ties, if any
    is_flat: bool = False
    support: Support | None = None  # what speaks for the first and against it; None where too few readings agree
    known: Known = (NO_INFORMATION, NO_COVARIANCE)  # what the scans say of the first alone


def assess_pose(ref: CurvescanFeatures, cur: CurvescanFeatures, pose: Pose, config: CurvescanConfig) -> Assessment:
    """Return what the scans say of a pose of the current scan in the reference."""
    limits = limits_of(config)
    _, compared = gather_evidence(ref, cur, pose[np.newaxis], limits[0])
    return assess(ref, cur, pose, compared, limits)


def limits_of(config: CurvescanConfig) -> tuple[float, float]:
    """Return the margin of readings and of surfaces that did not move, metres, and the least information."""
    return config.scoring.margin, config.information.max_sigma**-2


@kernel
def assess(
    of_ref: CurvescanFeatures, of_cur: CurvescanFeatures, pose: Floats, compared: Compared, limits: tuple[float, float]
) -> Assessment:
    """Return what readings say that were compared at a pose; their arrays change."""
    margin, least = limits
    ref, cur = of_ref.image.surfels, of_cur.image.surfels
    codes_ref, partner_ref, codes_cur, partner_cur = compared
    n_dynamic = mark_moved(cur, of_cur.bounds, codes_cur, partner_cur, ref, pose, FORWARD, margin)
    n_dynamic += mark_moved(ref, of_ref.bounds, codes_ref, partner_ref, cur, pose, BACKWARD, margin)
    n_inliers = 0
    for j in partner_cur:
        n_inliers += j >= 0
    partners = partner_ref, partner_cur
    information, spurious, axes, units, may_keep_pace = pose_information(of_ref, of_cur, partners, pose, least)
    a, b, c = information
    is_open = a < max(2.0 * spurious[0], least), b < max(2.0 * spurious[1], least), c < max(2.0 * spurious[2], least)
    return Assessment(codes_ref, codes_cur, n_inliers, n_dynamic, (a, b, c), axes, units, is_open, may_keep_pace)


def degenerate_directions(
    ref: CurvescanFeatures, cur: CurvescanFeatures, pose: Pose, assessment: Assessment, config: CurvescanConfig
) -> Open:
    """Return which principal directions the scans leave open, the least informed first.

    A direction is degenerate when its information does not exceed the spurious information of tilted lines, or is next
    to nothing; and the least informed, if it is weak, also when the scans agree as well some way along it.
    """
    images, (is_open, second, third) = (ref.image, cur.image), assessment.is_open
    if assessment.is_weakly_observable(config) and not is_open:
        moved = pose + config.information.max_sigma * np.outer(np.append(DOUBLED, -DOUBLED), assessment.weakest)
        here, beside = (float(select(one, *images, *FINE, 1, 4096, 0.0)[1][0]) for one in (pose[np.newaxis], moved))
        is_open = beside > assessment.as_good(config) * here
    return is_open, second, third


def without_dynamic(
    ref: CurvescanFeatures, cur: CurvescanFeatures, poses: Floats, assessment: Assessment, config: CurvescanConfig
) -> tuple[Floats, Assessment]:
    """Return the poses, the first refined without the surfaces that moved, and its assessment."""
    static_ref = ref.image._replace(samples=ref.image.surfels[assessment.codes_ref < MOVED])
    static_cur = cur.image._replace(samples=cur.image.surfels[assessment.codes_cur < MOVED])
    pose = refine(poses[:1], static_ref, static_cur, EXACTLY)
    return np.concatenate((pose, poses[1:])), assess_pose(ref, cur, pose[0], config)


def assess_best(problem: Problem, scored: ScoredPoses, assessment: Assessment | None) -> AssessedPose:
    """Return the best candidate refined without what moved, the directions left open there, and what supports it."""
    ref, cur, _, config, _ = problem
    if assessment is not None and assessment.n_dynamic:
        poses, assessment = without_dynamic(ref, cur, scored.poses, assessment, config)
        scored = replace(scored, poses=poses)
    if assessment is None or not assessment.is_enough(config):
        return AssessedPose(scored=scored, is_degenerate=(True, True, True), ties=[])
    poses = scored.poses
    is_open, second, third = degenerate_directions(ref, cur, poses[0], assessment, config)
    if is_open:
        # where the scans leave a direction open, the prior decides along it: it is not held against the pose
        slid = problem.prior.nearest_along(poses[0], assessment.weakest, config.hypotheses.along_reach)
        priors, wide_priors = log_odds(np.vstack((slid, poses[1:])), problem.prior)
        scored = replace(scored, priors=priors, wide_priors=wide_priors)
    along = along_weakest_direction(poses, assessment, is_open or scored.is_along_walls, config)
    least = assessment.as_good(config) * scored.scores[0]
    is_flat = is_open or (assessment.is_weakly_observable(config) and any(scored.scores[k] > least for k in along))
    others = [k for k in range(1, len(poses)) if distance(poses[k], poses[0]) > NEAR and not (is_flat and k in along)]
    support = support_of(scored, others)
    ties = [k for k in along if scored.scores[k] > least] if is_flat else ties_of(support, along, config)
    is_degenerate = is_flat or len(ties) > 0, second, third
    return AssessedPose(
        scored=scored,
        assessment=assessment,
        is_degenerate=is_degenerate,
        is_flat=is_flat,
        ties=ties,
        support=support,
        known=assessment.matrices(is_degenerate, config),
    )


def along_weakest_direction(poses: Floats, assessment: Assessment, is_open: bool, config: CurvescanConfig) -> list[int]:
    """Return the rows of the poses that differ from the first along its weakest direction, if that is weak or open."""
    least = 2.0 * config.information.degenerate_ratio * assessment.information[1]
    if not is_open and assessment.information[0] >= least:
        return []
    return [k for k in range(1, len(poses)) if is_along(assessment.weakest, poses[0], poses[k], 0.5 * NEAR)]


def ties_of(support: Support, along: list[int], config: CurvescanConfig) -> list[int]:
    """Return rows along the weakest direction that may be right instead of the first: all, unless it is sure alone."""
    if not along:
        return []
    ties = [k for k in support.repeated if k in along]
    if support.probabilities(ties)[0] < config.scoring.min_confidence:
        ties = [k for k in along if k in support.competing]
    return ties
