"""What a laser's poses mean for the robot's base: pose in odom, twist, map -> odom. No ROS in here."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan.se2 import uncertain
from curvescan.se2.uncertain import UncertainPose

UNKNOWN = 1e6
"""Variance of what is not known, in the square of its unit."""

_NOWHERE = np.zeros((3, 3))


@dataclass(frozen=True, eq=False, kw_only=True)
class BaseState:
    """The base at one scan.

    Attributes
    ----------
    odom_base : UncertainPose
        Pose of the base in odom: continuous, the chain of its motions.
    twist : (3,) float64
        Velocity in the base frame, m/s, m/s, rad/s.
    twist_covariance : (3, 3) float64
        Of the twist.
    map_odom : (3,) float64
        Pose of odom in map; identity without SLAM.
    """

    odom_base: UncertainPose
    twist: np.ndarray
    twist_covariance: np.ndarray
    map_odom: np.ndarray


class BaseMotion:
    """Turns the steps of an odometry of the laser into states of the base.

    Parameters
    ----------
    mount : (3,) float64
        Pose of the laser in the base frame: metres, metres, radians.
    """

    def __init__(self, mount: np.ndarray) -> None:
        self._mount = UncertainPose(np.asarray(mount, dtype=np.float64), _NOWHERE)
        self._unmount = uncertain.inverse(self._mount)
        self._stamp: float | None = None
        self._before: UncertainPose | None = None
        self._odom_base = uncertain.identity()

    @property
    def mount(self) -> np.ndarray:
        """Pose of the laser in the base frame."""
        return self._mount.pose

    def on_base(self, laser: UncertainPose) -> UncertainPose:
        """Return a pose, or a motion, of the laser as one of the base."""
        return uncertain.compose(uncertain.compose(self._mount, laser), self._unmount)

    def add(self, step: object, stamp: float) -> BaseState:
        """Return the base's state at the next step of :class:`curvescan.Odometry` or :class:`curvescan.Slam`."""
        laser_in_odom = UncertainPose(getattr(step, "pose_odom", step.pose), step.covariance)
        motion = self._motion(step, laser_in_odom)
        moved = self.on_base(motion)
        self._odom_base = uncertain.compose(self._odom_base, moved)
        twist, covariance = np.zeros(3), np.diag([UNKNOWN] * 3)
        if self._stamp is not None and stamp > self._stamp:
            seconds = stamp - self._stamp
            twist, covariance = se2.log(moved.pose) / seconds, moved.cov / seconds**2
        self._stamp, self._before = stamp, laser_in_odom
        base_in_map = self.on_base(UncertainPose(step.pose, step.covariance))
        # the chain leaves out where odometry leapt back from its drift: that much it is known to be wrong
        known = self.on_base(laser_in_odom)
        leap = self._odom_base.pose - known.pose
        leap[2] = se2.wrap(leap[2])
        odom_base = UncertainPose(self._odom_base.pose, known.cov + np.outer(leap, leap))
        return BaseState(
            odom_base=odom_base,
            twist=twist,
            twist_covariance=covariance,
            map_odom=se2.compose(base_in_map.pose, se2.inverse(odom_base.pose)),
        )

    def _motion(self, step: object, laser_in_odom: UncertainPose) -> UncertainPose:
        """Return the motion of the laser since the last step, without any leap."""
        motion = getattr(step, "motion", None)
        if isinstance(motion, UncertainPose):
            return motion
        if motion is not None:
            return UncertainPose(motion, step.motion_covariance)
        if self._before is None:
            return uncertain.identity()
        return uncertain.between(self._before, laser_in_odom)
