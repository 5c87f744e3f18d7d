"""Step: what odometry, SLAM and localization return for each scan."""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum
from typing import TYPE_CHECKING

import numpy as np

from curvescan.deskew import predicted_velocity
from curvescan.matchers import MatchResult
from curvescan.se2 import is_positive_definite
from curvescan.se2.uncertain import UncertainPose, between, eigen3
from curvescan.types import Cov, Floats, Pose

if TYPE_CHECKING:
    from curvescan.slam.loops.closures import Closure


class StepOutcome(Enum):
    """How a scan got its pose; the value is a sentence for people."""

    STARTED = "First scan: its sensor frame is the frame of the trajectory."
    MATCHED = "Matched with the keyframe in use."
    CHAINED = "Matched with the scan before it, which became the keyframe."
    RELOCALIZED = "Not matched to the current keyframe or the previous scan; relocalized on an earlier keyframe."
    PREDICTED = "No match: the expected motion was taken."
    HELD = "Matches keep failing: the sensor is taken to stand still."
    LOST = "Lost: nothing known before matches; the track starts anew, its place in the old one is unknown."
    SEARCHING = "Not found in the map yet."
    FOUND = "Found in the map: no other place explains the scans as well."
    TRACKED = "Followed in the map: matched with its keyframes, now or a short way before."


MATCHES = (StepOutcome.MATCHED, StepOutcome.CHAINED, StepOutcome.RELOCALIZED, StepOutcome.FOUND, StepOutcome.TRACKED)
"""Outcomes that stand on a match."""

UNMEASURED = (StepOutcome.PREDICTED, StepOutcome.HELD, StepOutcome.LOST)
"""Outcomes of steps whose motion no match measured."""

IN_MAP = (StepOutcome.SEARCHING, StepOutcome.FOUND, StepOutcome.TRACKED, StepOutcome.PREDICTED)
"""Outcomes of localization."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class Step:
    """Where the sensor was at one scan, by odometry, SLAM or localization.

    Attributes
    ----------
    index : int
        Number of the scan, from 0.
    stamp : float
        Its stamp, seconds.
    pose : (3,) float64
        [x, y, theta] of the sensor: metres, metres, radians; at the middle of the sweep where the scan gives the times
        of its beams. Odometry: in the frame of the first scan. SLAM: in the frame ``map`` as it is now, so that it may
        jump when a loop closes. Localization: in the frame of the saved map; NaN while the sensor is searched for.
    covariance : (3, 3) float64
        Covariance of the pose, x, y, theta. In a saved map: against the map as it is around the sensor.
    pose_odom : (3,) float64
        Pose by the odometry alone, frame of the first scan: it drifts (``odom`` of REP-105).
    covariance_odom : (3, 3) float64
        Covariance of `pose_odom`; zero at the first scan.
    motion : (3,) float64
        Pose of the sensor seen from where it was at the previous scan, without any leap: chained, the motions are a
        continuous track. Zero at the first scan.
    motion_covariance : (3, 3) float64
        Covariance of the motion; very wide where the outcome is LOST.
    seconds : float
        What the motion took, a whole number of the usual times between two scans; 0 where stamps do not tell it.
    outcome : StepOutcome
        How the pose came about.
    match : MatchResult or None
        The odometry's match, also where it failed; None at the first scan.
    reference : int or None
        Number of the scan that `match` was tried with; None at the first scan.
    is_prior_rejected : bool
        Whether `odometry_pose` was left out: a match contradicts it, and the last motion supports the match.
    wheel_slip : float
        Where wheels told the motion along what the match leaves open: share of the way that they slip by, as the
        matches so far have it. Else NaN.
    is_unsettled : bool
        Whether a scan without a match lies behind, and how far the sensor moved there is not confirmed yet: a later
        scan does, or the sensor is LOST.
    closures : tuple of Closure
        SLAM: the loop closures that were accepted with this scan.
    is_revised : bool
        SLAM: whether the poses of earlier scans were revised with this scan.
    keyframe : int
        SLAM: number of the keyframe that the pose hangs on. Localization: keyframe of the map that the scan was matched
        with. -1 where there is none.
    fragment : int
        SLAM: part of the map that the scan is in; more than one where a sensor that was lost has not been found again.
    covariance_global : (3, 3) float64 or None
        Localization: covariance of the pose seen from the first keyframe of the map, with the map's errors between.
    """

    index: int
    stamp: float
    pose: Pose
    covariance: Cov
    pose_odom: Pose
    covariance_odom: Cov
    motion: Pose
    motion_covariance: Cov
    seconds: float
    outcome: StepOutcome
    match: MatchResult | None
    reference: int | None
    is_prior_rejected: bool = False
    wheel_slip: float = math.nan
    is_unsettled: bool = False
    closures: tuple[Closure, ...] = ()
    is_revised: bool = False
    keyframe: int = -1
    fragment: int = 0
    covariance_global: Cov | None = None

    @property
    def ok(self) -> bool:
        """Whether the pose is known: not while the sensor is searched for in a saved map."""
        return self.outcome is not StepOutcome.SEARCHING

    @property
    def velocity(self) -> Floats:
        """(3,) [vx, vy, omega] of the sensor, m/s, m/s, rad/s, to deskew the sweep with; 0 where stamps do not tell."""
        return predicted_velocity(self.motion, self.seconds)

    @property
    def is_driven(self) -> bool:
        """Whether wheels told the motion along what the match leaves open."""
        return math.isfinite(self.wheel_slip)

    @property
    def is_matched(self) -> bool:
        """Whether the pose stands on a match."""
        return self.outcome in MATCHES

    def __repr__(self) -> str:
        x, y, theta = self.pose
        closed = f", {len(self.closures)} loop closures" if self.closures else ""
        return f"Step({self.index}: {self.outcome.name}, x={x:.4f} m, y={y:.4f} m, theta={theta:.4f} rad{closed})"


def between_steps(origin: Step, step: Step) -> UncertainPose:
    """Return the pose of a step in the frame of an earlier one, with what was added to the covariance since."""
    found = between(UncertainPose(origin.pose, origin.covariance), UncertainPose(step.pose, step.covariance))
    if is_positive_definite(found.covariance):
        return found
    values, vectors = eigen3(found.covariance)
    # the two hang on one keyframe, or a stretch was settled since: the poses then differ by what was put right
    return UncertainPose(found.pose, (vectors * np.abs(values)) @ vectors.T)
