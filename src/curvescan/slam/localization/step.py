"""What the localizer returns for each scan."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

import numpy as np

from curvescan.odometry.step import OdometryStep
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Cov, Pose


class LocalizerOutcome(Enum):
    """How a scan got its pose in the map; the value is a sentence for people."""

    SEARCHING = "Not found in the map yet."
    FOUND = "Found without a guess: no other place in the map explains the scans as well."
    TRACKED = "Matched with keyframes around, now or a short way before."
    """At most half the distance of keyframes before; the odometry has matched all scans since."""
    PREDICTED = "Carried on by the odometry: no match with the map where one was due."


@dataclass(frozen=True, eq=False, kw_only=True)
class LocalizerStep:
    """Where the sensor was at one scan.

    Attributes
    ----------
    index : int
        Number of the scan, from 0.
    stamp : float
        Its stamp, seconds.
    pose : (3,) float64
        [x, y, theta] of the sensor in the frame ``map``: metres, metres, radians; NaN while it is searched for.
    covariance : (3, 3) float64
        Covariance of the pose against the map as it is around the sensor; NaN while it is searched for.
    covariance_global : (3, 3) float64
        Covariance of the pose seen from the first keyframe of the map: with what the map itself errs from there to here.
    pose_odom : (3,) float64
        Pose by the odometry alone, frame of the first scan.
    covariance_odom : (3, 3) float64
        Covariance of `pose_odom`.
    motion : (3,) float64
        Pose of the sensor seen from where it was at the previous scan, without any leap; see :class:`OdometryStep`.
    motion_covariance : (3, 3) float64
        Covariance of the motion.
    outcome : LocalizerOutcome
        How it was found.
    keyframe : int
        Keyframe of the map that it was matched with; -1 where none was.
    """

    index: int
    stamp: float
    pose: Pose
    covariance: Cov
    covariance_global: Cov
    pose_odom: Pose
    covariance_odom: Cov
    motion: Pose
    motion_covariance: Cov
    outcome: LocalizerOutcome
    keyframe: int

    @property
    def ok(self) -> bool:
        """Whether the pose is known."""
        return self.outcome is not LocalizerOutcome.SEARCHING


NOWHERE = UncertainPose(np.full(3, np.nan), np.full((3, 3), np.nan))
"""The pose of a sensor that is searched for."""


def as_step(
    step: OdometryStep, here: UncertainPose, covariance_global: Cov, outcome: LocalizerOutcome, keyframe: int = -1
) -> LocalizerStep:
    """Return the record of a scan whose pose in the map is `here`, by its step of the odometry."""
    return LocalizerStep(
        index=step.index,
        stamp=step.stamp,
        pose=here.pose,
        covariance=here.cov,
        covariance_global=covariance_global,
        pose_odom=step.pose,
        covariance_odom=step.covariance,
        motion=step.motion,
        motion_covariance=step.motion_covariance,
        outcome=outcome,
        keyframe=keyframe,
    )
