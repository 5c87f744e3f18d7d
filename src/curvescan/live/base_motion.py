"""What a laser's poses mean for the robot's base: pose in odom, twist, map -> odom. No ROS in here."""

from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan.odometry import Step
from curvescan.se2 import uncertain
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Cov, Floats, Pose

UNKNOWN = 1e6  # variance of what is not known, in the square of its unit

_NOWHERE = np.zeros((3, 3))


@dataclass(frozen=True, eq=False, kw_only=True)
class BaseState:
    """The base at one scan."""

    odom_base: UncertainPose  # pose of the base in odom: continuous, the chain of its motions
    twist: Floats  # (3,): velocity in the base frame, m/s, m/s, rad/s
    twist_covariance: Cov  # (3, 3): of the twist
    # (3,): pose of odom in map, with SLAM and in a saved map, where it stays while the laser is
    # searched for anew; None until it has been found there
    map_odom: Pose | None


class BaseMotion:
    """Turns the steps of an odometry of the laser into states of the base. mount (3,)."""

    def __init__(self, mount: Pose) -> None:
        self._mount = UncertainPose(np.asarray(mount, dtype=np.float64), _NOWHERE)
        self._unmount = uncertain.inverse(self._mount)
        self._stamp: float | None = None
        self._map_odom: Pose | None = None
        self._odom_base = uncertain.identity()

    @property
    def mount(self) -> Pose:
        """Pose of the laser in the base frame."""
        return self._mount.pose

    def on_base(self, laser: UncertainPose) -> UncertainPose:
        """Return a pose, or a motion, of the laser as one of the base."""
        return uncertain.compose(uncertain.compose(self._mount, laser), self._unmount)

    def add(self, step: Step, stamp: float) -> BaseState:
        """Return the base's state at the next step of an odometry, a SLAM or a localizer of curvescan."""
        moved = self.on_base(UncertainPose(step.motion, step.motion_covariance))
        self._odom_base = uncertain.compose(self._odom_base, moved)
        twist, covariance = np.zeros(3), np.diag([UNKNOWN] * 3)
        if self._stamp is not None and stamp > self._stamp:
            seconds = stamp - self._stamp
            twist, covariance = se2.log(moved.pose) / seconds, moved.covariance / seconds**2
        self._stamp = stamp
        # the chain leaves out where odometry leapt back from its drift: that much it is known to be wrong
        known = self.on_base(UncertainPose(step.pose_odom, step.covariance_odom))
        leap = self._odom_base.pose - known.pose
        leap[2] = se2.wrap(leap[2])
        odom_base = UncertainPose(self._odom_base.pose, known.covariance + np.outer(leap, leap))
        if np.isfinite(step.pose).all():  # NaN until the laser has been found in the map
            base_in_map = self.on_base(UncertainPose(step.pose, _NOWHERE)).pose
            self._map_odom = se2.compose(base_in_map, se2.inverse(odom_base.pose))
        return BaseState(odom_base=odom_base, twist=twist, twist_covariance=covariance, map_odom=self._map_odom)
