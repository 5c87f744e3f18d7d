"""What the odometry returns for each scan."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from curvescan.matchers import MatchResult
from curvescan.types import Cov, Pose


class StepOutcome(Enum):
    """How a scan got its pose; the value is a sentence for people."""

    STARTED = "First scan: its sensor frame is the frame of the trajectory."
    MATCHED = "Matched with the keyframe in use."
    CHAINED = "Matched with the scan before it, which became the keyframe."
    RELOCALIZED = "Not matched to the current keyframe or the previous scan; relocalized on an earlier keyframe."
    PREDICTED = "No match: the expected motion was taken."
    HELD = "Matches keep failing: the sensor is taken to stand still."
    LOST = "Lost: nothing known before matches; the track starts anew, its place in the old one is unknown."


MATCHES = (StepOutcome.MATCHED, StepOutcome.CHAINED, StepOutcome.RELOCALIZED)
"""Outcomes that stand on a match."""


@dataclass(frozen=True, eq=False, kw_only=True)
class OdometryStep:
    """Where the sensor was at one scan.

    Attributes
    ----------
    index : int
        Number of the scan, from 0.
    stamp : float
        Its stamp, seconds.
    pose : (3,) float64
        [x, y, theta] of the sensor in the frame of the first scan: metres, metres, radians; at the middle of the sweep
        where the scan gives the times of its beams.
    covariance : (3, 3) float64
        Covariance of the pose, x, y, theta; zero at the first scan.
    motion : (3,) float64
        Pose of the sensor seen from where it was at the previous scan. Zero at the first scan.
    motion_covariance : (3, 3) float64
        Covariance of the motion; very wide where the outcome is LOST.
    outcome : StepOutcome
        How the pose came about.
    match : MatchResult or None
        The match behind it, also where it failed; None at the first scan.
    reference : int or None
        Number of the scan that `match` was tried with; None at the first scan.
    is_prior_rejected : bool
        Whether `odometry_pose` was left out of this step because a match, which the last motion supports, contradicts it.
    """

    index: int
    stamp: float
    pose: Pose
    covariance: Cov
    motion: Pose
    motion_covariance: Cov
    outcome: StepOutcome
    match: MatchResult | None
    reference: int | None
    is_prior_rejected: bool = False

    def __repr__(self) -> str:
        x, y, theta = self.pose
        return (
            f"OdometryStep({self.index}: {self.outcome.name}, x={x:.4f} m, y={y:.4f} m, theta={theta:.4f} rad, "
            f"stamp={self.stamp!r})"
        )
