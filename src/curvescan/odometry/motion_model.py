"""Motion: what is expected of the next scan before it is matched.

The last motion repeated, as well as it was known, or what the wheels say. Along a corridor, where no match shows the
motion, it becomes less certain with each step. Wheels err in proportion to what they measure (Thrun, Burgard and Fox,
Probabilistic Robotics, 2005, section 5.4).
"""

from __future__ import annotations

import math

import numpy as np

from curvescan import se2
from curvescan.odometry.config import MotionConfig
from curvescan.se2.angles import wrap_angle
from curvescan.se2.uncertain import UncertainPose, identity
from curvescan.types import Pose

_MAX_STRETCH = 20.0
"""A longer pause than this many scans tells no more."""

_N_UNUSUAL = 10
"""So many steps of the clock are averaged before one is called long."""


class MotionModel:
    """The motion from a scan to the next: expected from the last one, or from another sensor's odometry.

    Parameters
    ----------
    config : MotionConfig
        How far each is believed.
    """

    def __init__(self, config: MotionConfig) -> None:
        self._config = config
        self._last = identity()
        self._change = (config.sigma_m**2, config.sigma_rad**2)  # variance of translation and turn
        self._wheels: Pose | None = None
        self._stamp = math.nan
        self._period = 0.0  # usual time between scans, seconds
        self._n_steps = 0  # of the clock, forwards
        self._n_failures = 0
        self._is_measured = False  # whether the expected place comes from the wheels

    def predict(self, stamp: float, odometry_pose: Pose | None) -> UncertainPose:
        """Return the expected pose of the next sensor frame in the last one.

        Parameters
        ----------
        stamp : float
            Time of the next scan, seconds. Where it is long after the last one, less is known of the motion; that it
            was longer is not concluded, for many logs are written in bursts.
        odometry_pose : (3,) float64 or None
            Pose of the sensor by its wheels or a gyro, in a frame of their own; NaN where they do not tell, as a gyro
            tells no place.
        """
        config, before = self._config, self._wheels
        self._wheels = odometry_pose
        pose, cov = self._last.pose.copy(), self._last.cov.copy()
        stretch = self._stretch(stamp) ** 2
        cov[0, 0] += stretch * self._change[0]
        cov[1, 1] += stretch * self._change[0]
        cov[2, 2] += stretch * self._change[1]
        self._is_measured = False
        if odometry_pose is None or before is None:
            return UncertainPose(pose, cov)
        by_wheels = se2.between(before, odometry_pose)
        turn = float(se2.wrap(odometry_pose[2] - before[2]))  # known where the place is not
        path = math.hypot(by_wheels[0], by_wheels[1])
        if math.isfinite(path):
            pose[:2] = by_wheels[:2]
            self._is_measured = True
            cov[:2, :] = cov[:, :2] = 0.0
            cov[0, 0] = cov[1, 1] = config.wheel_floor_m**2 + (config.wheel_share * path) ** 2
        if math.isfinite(turn):
            pose[2] = turn
            drift = config.wheel_drift * path if math.isfinite(path) else 0.0
            share = config.wheel_turn_share * turn
            cov[2, :] = cov[:, 2] = 0.0
            cov[2, 2] = config.wheel_floor_rad**2 + share**2 + drift**2
        return UncertainPose(pose, cov)

    def update(self, motion: UncertainPose, *, is_plausible: bool, is_fully_observed: bool) -> None:
        """Tell what the motion turned out to be.

        Parameters
        ----------
        motion : UncertainPose
            Of the sensor, in its last frame.
        is_plausible : bool
            Whether it is about what was expected; one that is not is not expected again.
        is_fully_observed : bool
            Whether the match left no direction open, so that the change from the last motion has been seen.
        """
        self._n_failures = 0
        if is_fully_observed:
            self._update_change(motion.pose - self._last.pose)
        else:
            self._inflate_change()
        self._last = motion if is_plausible else identity()

    def predict_without_match(self, expected: UncertainPose) -> tuple[UncertainPose, bool]:
        """Return the motion to take where no match shows it, and whether it is none at all."""
        self._n_failures += 1
        self._inflate_change()
        is_held = self._n_failures > self._config.max_repeats and not self._is_measured
        if is_held:
            expected = UncertainPose(np.zeros(3), expected.cov)
        self._last = expected
        return expected, is_held

    def inflated(self, expected: UncertainPose) -> UncertainPose:
        """Return an expected motion as it is believed after a failed match: what was measured still is."""
        if self._is_measured:
            return expected
        return UncertainPose(expected.pose, self._config.recovery_covariance)

    def _stretch(self, stamp: float) -> float:
        """Return how many times longer than usual the time since the last scan is, at least 1."""
        elapsed, self._stamp = stamp - self._stamp, stamp
        if not elapsed > 0.0:  # the first one, a clock that stands or goes back
            return 1.0
        self._n_steps += 1
        if self._n_steps <= _N_UNUSUAL:  # logs written in bursts begin with any step
            self._period += (elapsed - self._period) / self._n_steps
            return 1.0
        usual = self._period
        self._period += (min(elapsed, 3.0 * usual) - usual) / self._config.memory
        return min(max(elapsed / usual, 1.0), _MAX_STRETCH)

    def _update_change(self, change: Pose) -> None:
        config = self._config
        x, y, theta = change.tolist()
        theta = wrap_angle(theta)
        self._change = (
            self._averaged(self._change[0], 0.5 * (x * x + y * y), config.least_sigma_m),
            self._averaged(self._change[1], theta * theta, config.least_sigma_rad),
        )

    def _inflate_change(self) -> None:
        """Expect again, bit by bit, such turns as before any was seen: a robot starts to turn at once, not to drive."""
        place, turn = self._change
        wide = max(self._config.sigma_rad**2, turn)
        self._change = (place, turn + (wide - turn) / self._config.memory)

    def _averaged(self, variance: float, pose_keyframe_scan: float, least: float) -> float:
        pose_keyframe_scan = min(
            pose_keyframe_scan, self._config.motion_gate_chi2 * variance
        )  # one leap is not a habit
        return max(variance + (pose_keyframe_scan - variance) / self._config.memory, least**2)
