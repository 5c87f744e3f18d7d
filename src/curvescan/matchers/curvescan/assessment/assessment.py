"""Assessment: what two scans say of a pose, and which directions they leave open."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.assessment.evidence import Compared, gather_evidence
from curvescan.matchers.curvescan.assessment.information import Open, Row, matrices, pose_information
from curvescan.matchers.curvescan.assessment.labels import MOVED, mark_moved
from curvescan.matchers.curvescan.association import BACKWARD, FORWARD
from curvescan.matchers.curvescan.config import AS_GOOD, LASER_ERROR, CurvescanConfig, InformationConfig, ScoringConfig
from curvescan.matchers.curvescan.features.features import CurvescanFeatures
from curvescan.matchers.curvescan.proposal.scoring import FINE, select
from curvescan.matchers.curvescan.refinement import EXACTLY, refine
from curvescan.types import Codes, Cov, Floats, Pose

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

    @property
    def weakest(self) -> Pose:
        """(3,) least observable direction of the pose: metres, metres, radians; moves a typical reading by 1 m."""
        weakest: Pose = self.axes[:, 0] * self.units
        return weakest

    def is_weakly_observable(self, config: InformationConfig) -> bool:
        """Return whether one direction has much less information than the next."""
        return self.information[0] < config.degenerate_ratio * self.information[1]

    def as_good(self, config: InformationConfig) -> float:
        """Return the share of the score from which on a place along the weakest direction is as good."""
        return AS_GOOD if self.information[0] > LASER_ERROR**-2 else 1.0 - config.degenerate_ratio

    def is_enough(self, config: ScoringConfig) -> bool:
        """Return whether so many readings agree that chance does not explain it."""
        return self.n_inliers >= min(config.min_inliers, len(self.codes_cur) / 3)

    def matrices(self, is_open: Open, config: InformationConfig) -> tuple[Cov, Cov]:
        """Return the (3, 3) information on the pose, zero along what is open, and its covariance, wide there."""
        return matrices(self.information, self.axes, self.units, is_open, config.degenerate_sigma)


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
    scan_ref: CurvescanFeatures,
    scan_cur: CurvescanFeatures,
    pose: Floats,
    compared: Compared,
    limits: tuple[float, float],
) -> Assessment:
    """Return what readings say that were compared at a pose; their arrays change."""
    margin, least = limits
    ref, cur = scan_ref.image.surfels, scan_cur.image.surfels
    codes_ref, partner_ref, codes_cur, partner_cur = compared
    n_dynamic = mark_moved(cur, scan_cur.bounds, codes_cur, partner_cur, ref, pose, FORWARD, margin)
    n_dynamic += mark_moved(ref, scan_ref.bounds, codes_ref, partner_ref, cur, pose, BACKWARD, margin)
    n_inliers = 0
    for j in partner_cur:
        n_inliers += j >= 0
    information, spurious, axes, units = pose_information(
        ref, scan_ref.objects, partner_ref, cur, scan_cur.objects, partner_cur, pose, least
    )
    a, b, c = information
    is_open = a < max(2.0 * spurious[0], least), b < max(2.0 * spurious[1], least), c < max(2.0 * spurious[2], least)
    return Assessment(codes_ref, codes_cur, n_inliers, n_dynamic, (a, b, c), axes, units, is_open)


def degenerate_directions(
    ref: CurvescanFeatures, cur: CurvescanFeatures, pose: Pose, assessment: Assessment, config: CurvescanConfig
) -> Open:
    """Return which principal directions the scans leave open, the least informed first.

    A direction is degenerate when its information does not exceed the spurious information of tilted lines, or is next
    to nothing; and the least informed, if it is weak, also when the scans agree as well some way along it.
    """
    rules, images, (is_open, second, third) = config.information, (ref.image, cur.image), assessment.is_open
    if assessment.is_weakly_observable(rules) and not is_open:
        moved = pose + rules.max_sigma * np.outer(np.append(DOUBLED, -DOUBLED), assessment.weakest)
        here, beside = (float(select(one, *images, *FINE, 1, 4096, 0.0)[1][0]) for one in (pose[np.newaxis], moved))
        is_open = beside > assessment.as_good(rules) * here
    return is_open, second, third


def without_dynamic(
    ref: CurvescanFeatures, cur: CurvescanFeatures, poses: Floats, assessment: Assessment, config: CurvescanConfig
) -> tuple[Floats, Assessment]:
    """Return the poses, the first refined without the surfaces that moved, and its assessment."""
    static_ref = ref.image._replace(samples=ref.image.surfels[assessment.codes_ref < MOVED])
    static_cur = cur.image._replace(samples=cur.image.surfels[assessment.codes_cur < MOVED])
    pose = refine(poses[:1], static_ref, static_cur, EXACTLY)
    return np.concatenate((pose, poses[1:])), assess_pose(ref, cur, pose[0], config)
