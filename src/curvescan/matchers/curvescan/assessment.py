"""Evidence: what the readings of both scans say of one pose, and which directions they leave open."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.config import (
    ConsensusConfig,
    InformationConfig,
    VerificationConfig,
)
from curvescan.matchers.curvescan.features import ConsensusFeatures
from curvescan.matchers.curvescan.information import covariance, pose_information
from curvescan.matchers.curvescan.labels import AGREES, MOVED, compare_readings, surfaces_at_rest
from curvescan.matchers.curvescan.range_image import View
from curvescan.matchers.curvescan.scoring import best_beside
from curvescan.types import Bools, Codes, Cov, Floats, Ints, Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class Evidence:
    """What two scans say of a pose.

    Attributes
    ----------
    codes_ref, codes_cur : (m,), (k,) uint8
        What each reading is to the other scan; codes of labels.py.
    n_agree : int
        Readings of the current scan that agree.
    at_rest_ref, at_rest_cur : (m,), (k,) bool
        Which readings are of surfaces that did not move as a whole.
    n_moved : int
        Surfaces that did, of both scans.
    information, feigned, axes, units
        Principal directions of the information; see :func:`curvescan.matchers.curvescan.information.pose_information`.
    """

    codes_ref: Codes
    codes_cur: Codes
    n_agree: int
    at_rest_ref: Bools
    at_rest_cur: Bools
    n_moved: int
    information: Floats
    feigned: Floats
    axes: Floats
    units: Floats

    @property
    def weakest(self) -> Pose:
        """(3,) change of pose of which least is told: metres, metres and radians; it moves a typical reading by 1 m."""
        weakest: Pose = self.axes[:, 0] * self.units
        return weakest

    def is_weak(self, config: InformationConfig) -> bool:
        """Return whether much less is told in one direction than in the next."""
        return bool(self.information[0] < config.weak_ratio * self.information[1])

    def is_enough(self, config: VerificationConfig) -> bool:
        """Return whether so many readings agree that chance does not explain it."""
        return self.n_agree >= min(config.min_agreeing, len(self.codes_cur) / 3)

    def covariance(self, is_open: Bools, config: InformationConfig) -> Cov:
        """Return the (3, 3) covariance of the pose, wide in the open directions."""
        return covariance(self.information, self.axes, self.units, is_open, config.open_sigma)


def gather_evidence(
    ref: ConsensusFeatures, cur: ConsensusFeatures, pose: Pose, config: ConsensusConfig
) -> Evidence:
    """Return what the scans say of a pose of the current scan in the reference."""
    rules = config.verification
    codes_ref, codes_cur, n_agree, at_rest_ref, at_rest_cur, n_moved, told, feigned, axes, units = (
        weigh(
            ref.view,
            ref.bounds,
            cur.view,
            cur.bounds,
            pose,
            rules.margin,
            rules.moved_limit,
            rules.moved_least,
        )
    )
    return Evidence(
        codes_ref=codes_ref,
        codes_cur=codes_cur,
        n_agree=n_agree,
        at_rest_ref=at_rest_ref,
        at_rest_cur=at_rest_cur,
        n_moved=n_moved,
        information=told,
        feigned=feigned,
        axes=axes,
        units=units,
    )


@kernel
def leave_out_movers(codes: Codes, partner: Ints, at_rest: Bools) -> int:
    """Take their partners from the readings of surfaces that moved, in place, and return how many readings have one left."""
    n_left = 0
    for i in range(codes.size):
        if not at_rest[i]:
            codes[i] = MOVED if codes[i] == AGREES else codes[i]
            partner[i] = -1
        elif partner[i] >= 0:
            n_left += 1
    return n_left


@kernel
def weigh(
    ref: View,
    bounds_ref: Ints,
    cur: View,
    bounds_cur: Ints,
    pose: Floats,
    margin: float,
    limit: float,
    least: float,
) -> tuple[Codes, Codes, int, Bools, Bools, int, Floats, Floats, Floats, Floats]:
    """Return the fields of an Evidence; margin, limit and least as in VerificationConfig."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    back = np.array([-c * pose[0] - s * pose[1], s * pose[0] - c * pose[1], -pose[2]])
    codes_cur, partner_cur = compare_readings(cur.surfels, ref, pose, margin)
    codes_ref, partner_ref = compare_readings(ref.surfels, cur, back, margin)
    at_rest_cur, n_moved_cur = surfaces_at_rest(
        cur.surfels, bounds_cur, partner_cur, ref.surfels, pose, limit, least
    )
    at_rest_ref, n_moved_ref = surfaces_at_rest(
        ref.surfels, bounds_ref, partner_ref, cur.surfels, back, limit, least
    )
    n_agree = leave_out_movers(codes_cur, partner_cur, at_rest_cur)
    leave_out_movers(codes_ref, partner_ref, at_rest_ref)
    told, feigned, axes, units = pose_information(
        ref.surfels, partner_ref, cur.surfels, partner_cur, pose
    )
    n_moved = n_moved_cur + n_moved_ref
    return (
        codes_ref,
        codes_cur,
        n_agree,
        at_rest_ref,
        at_rest_cur,
        n_moved,
        told,
        feigned,
        axes,
        units,
    )


def open_directions(
    ref: ConsensusFeatures,
    cur: ConsensusFeatures,
    pose: Pose,
    evidence: Evidence,
    config: ConsensusConfig,
) -> Bools:
    """Return (3,) which principal directions the scans leave open, the least informed first.

    A direction is open when no more is told in it than tilted lines feign, or next to nothing; and the least informed,
    if it is weak, also when the scans agree as well some way along it.
    """
    rules, views = config.information, (ref.view, cur.view)
    information = evidence.information
    is_open: Bools = (information < 2.0 * evidence.feigned) | (information < rules.max_sigma**-2)
    if evidence.is_weak(rules) and not is_open[0]:
        fine = config.verification.fine
        here = best_beside(pose, evidence.weakest, np.zeros(1), *views, *fine)
        beside = best_beside(pose, evidence.weakest, np.array(rules.offsets), *views, *fine)
        is_open[0] = beside > rules.flat_score * here
    return is_open
