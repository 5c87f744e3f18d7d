"""The result of SLAM for each scan."""

from __future__ import annotations

from dataclasses import dataclass

from curvescan.matchers import MatchResult
from curvescan.odometry.step import StepOutcome
from curvescan.slam.loops.closures import Closure
from curvescan.types import Cov, Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class SlamStep:
    """Where the sensor was at one scan.

    Attributes
    ----------
    index : int
        Number of the scan, from 0.
    stamp : float
        Its stamp, seconds.
    pose : (3,) float64
        [x, y, theta] of the sensor in the frame ``map`` as it is now: metres, metres, radians. It may jump when a loop closes.
    covariance : (3, 3) float64
        Covariance of the pose, x, y, theta.
    pose_odom : (3,) float64
        The same in the frame ``odom``, which drifts and does not jump (REP-105), unless the odometry is configured to look for known
        places itself.
    covariance_odom : (3, 3) float64
        Covariance of `pose_odom`.
    motion : (3,) float64
        Pose of the sensor seen from where it was at the previous scan, without any leap; see :class:`OdometryStep`.
    motion_covariance : (3, 3) float64
        Covariance of the motion.
    outcome : StepOutcome
        How the odometry found it.
    match : MatchResult or None
        The odometry's match.
    reference : int or None
        Number of the scan that `match` was tried with.
    closures : tuple of Closure
        The loop closures that were accepted with this scan; matches of neighbouring keyframes are none.
    is_revised : bool
        Whether the poses of earlier scans were revised with this scan.
    keyframe : int
        Number of the keyframe that the pose hangs on.
    fragment : int
        Number of the part of the map that it is in; more than one where a sensor that was lost has not been found again.
    """

    index: int
    stamp: float
    pose: Pose
    covariance: Cov
    pose_odom: Pose
    covariance_odom: Cov
    motion: Pose
    motion_covariance: Cov
    outcome: StepOutcome
    match: MatchResult | None
    reference: int | None
    closures: tuple[Closure, ...]
    is_revised: bool
    keyframe: int
    fragment: int
