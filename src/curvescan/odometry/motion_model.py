"""Motion: what is expected of the next scan before it is matched.

The last motion repeated, as well as it was known, or what the wheels say. Along a corridor, where no match shows the
motion, it becomes less certain with each step. Wheels err in proportion to what they measure (Thrun, Burgard and Fox,
Probabilistic Robotics, 2005, section 5.4).
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan.deskew import Deskewer
from curvescan.odometry.config import MotionConfig
from curvescan.odometry.wheels import Wheels
from curvescan.se2.uncertain import UncertainPose, fuse, identity, wrap_angle
from curvescan.types import Cov, Pose

_RECOVERED = 0.5
"""Seconds from which on a sensor that moved unseen is taken to be no farther off: it has stopped, or turned back."""

_LONGEST_STEP = 1_000.0
"""Metres from a scan to the next that an odometry can measure; beyond, it is no measurement."""

_WHEEL_FLOOR = 0.003
"""Wheel odometry errs by this much at the least, metres and radians a step."""

_MAX_STRETCH = 20
"""A pause longer than this many scans counts as this many."""

_MOVING = 3
"""Wheels that report the very pose of the scan before, after a motion longer than this many times the least change
that is expected, were not updated."""

_MOST_MISSED = 1
"""Scans in a row without a match after which wheels that report the same pose are believed: the sensor stands still."""


class Prediction(NamedTuple):
    """What is expected of a scan before it is matched."""

    motion: UncertainPose  # the sensor seen from where it was at the last scan
    repeated: UncertainPose  # the last motion repeated: the same as `motion` without another odometry
    is_measured: bool  # whether the translation of `motion` is that of another odometry
    deskewer: Deskewer  # the clock of the stream at this scan
    odometry_pose: Pose | None  # (3,): pose of the sensor at this scan by another odometry
    config: MotionConfig  # how far a sensor gets
    seconds: float = math.inf  # since the last match, by the clock of the stream
    stretch: int = 1  # scans since the last one, with those that are missing
    is_missed: bool = False  # whether `odometry_pose` is taken not to have been updated since the last scan

    @property
    def is_confirmed(self) -> bool:
        """Whether another odometry goes on as the sensor did: one that does not may have leaped, or lag."""
        return self.is_measured and fuse(self.motion, self.repeated)[1] <= self.config.motion_gate_chi2

    @property
    def recovery(self) -> Cov:
        """(3, 3) how much farther from there the sensor may be once a match failed or contradicts."""
        most = np.array([self.config.recovery_sigma_m, self.config.recovery_sigma_m, self.config.recovery_sigma_rad])
        x, y, theta = self.motion.pose.tolist()
        way = math.hypot(x, y)
        moved = min(round(self.seconds / _RECOVERED, 2), 1.0) * most + np.array([way, way, abs(theta)])
        return np.diag(np.minimum(moved, most) ** 2)

    @property
    def reach(self) -> float:
        """How far from there it gets since the last match, if it moves at once: standard deviation, metres."""
        x, y, _ = self.motion.pose.tolist()
        return min(self.config.recovery_sigma_m * self.seconds / _RECOVERED, _LONGEST_STEP) + math.hypot(x, y)

    @property
    def onward(self) -> Pose:
        """(3,) how much farther it is, where scans are missing in between."""
        return (self.stretch - 1) * self.motion.pose


class MotionModel(NamedTuple):
    """The motion from a scan to the next: expected from the last one, or from another sensor's odometry.

    Immutable: each scan makes a new one.
    """

    config: MotionConfig  # how well each is known
    last: UncertainPose  # the last motion
    variance_translation: float  # of the change from a motion to the next, m^2 an axis
    variance_turn: float  # the same of the turn, rad^2
    wheels: Wheels  # what is known of the other odometry
    # (3,): pose at the last scan by another odometry, or at the scan before where it was not updated since
    odometry_pose: Pose | None = None
    # (3,): the sensor at the last scan seen from where it was at that pose; None where that pose is of the last scan
    moved: Pose | None = None
    deskewer: Deskewer = Deskewer()  # the clock of the stream
    n_failures: int = 0  # scans without a match in a row

    @classmethod
    def at_start(cls, config: MotionConfig) -> MotionModel:
        """Return the model before the first scan."""
        variance = config.sigma_m**2
        return cls(config, identity(), variance, variance, Wheels(slip=config.wheel_slip))

    def predict(self, stamp: float, odometry_pose: Pose | None, scan_time: float = 0.0) -> Prediction:
        """Return the expected pose of the next sensor frame in the last one; odometry_pose (3,)."""
        deskewer = self.deskewer.ticked(stamp, scan_time)
        stretch = min(deskewer.n_steps, _MAX_STRETCH)
        # since the last match; a clock that stands tells nothing
        seconds = max(deskewer.elapsed, deskewer.period) * (1 + self.n_failures) if deskewer.period else math.inf
        cov = self.last.covariance.copy()
        cov[0, 0] += stretch**2 * self.variance_translation
        cov[1, 1] += stretch**2 * self.variance_translation
        cov[2, 2] += stretch**2 * self.variance_turn
        motion = repeated = UncertainPose(self.last.pose, cov)
        is_missed, is_measured = self._is_missed(odometry_pose), False
        if odometry_pose is not None and not is_missed:
            motion = UncertainPose(self.last.pose.copy(), cov.copy())
            is_measured = self._measure(*motion, odometry_pose)
        return Prediction(
            motion=motion,
            repeated=repeated,
            is_measured=is_measured,
            deskewer=deskewer,
            odometry_pose=odometry_pose,
            config=self.config,
            seconds=seconds,
            stretch=stretch,
            is_missed=is_missed,
        )

    def advanced(self, prediction: Prediction) -> MotionModel:
        """Return the model after a scan that says nothing of the motion, the first."""
        return self._replace(odometry_pose=prediction.odometry_pose, moved=None, deskewer=prediction.deskewer)

    def updated(self, prediction: Prediction, motion: UncertainPose, *, is_fully_observed: bool) -> MotionModel:
        """Return the model after a scan whose motion was measured."""
        variances = self._after_change(motion.pose - self.last.pose) if is_fully_observed else self._inflated()
        wheels = self.wheels if is_fully_observed else self.wheels.interrupted()
        if is_fully_observed and prediction.is_measured:
            wheels = wheels.learned(prediction.motion, motion.pose, self.config)
        return self._replace(
            last=motion,
            variance_translation=variances[0],
            variance_turn=variances[1],
            wheels=wheels,
            odometry_pose=prediction.odometry_pose,
            moved=self._moved(prediction, motion),
            deskewer=prediction.deskewer,
            n_failures=0,
        )

    def updated_without_match(self, prediction: Prediction, motion: UncertainPose) -> MotionModel:
        """Return the model after a scan that nothing matches, and for which `motion` was taken."""
        model = self.updated(prediction, motion, is_fully_observed=False)
        return model._replace(n_failures=self.n_failures + 1)

    def held(self, expected: UncertainPose) -> UncertainPose:
        """Return no motion in place of an expected one: since matches failed the sensor may have gone on as before."""
        on = (2 * self.n_failures + 1) * np.outer(expected.pose, expected.pose)  # over as many scans the way, squared
        return UncertainPose(np.zeros(3), expected.covariance + on)

    def is_exhausted(self, prediction: Prediction) -> bool:
        """Return whether the last motion has been repeated so often that one more failure ends it."""
        return self.n_failures >= self.config.max_repeats and not prediction.is_measured

    def _is_missed(self, odometry_pose: Pose | None) -> bool:
        """Return whether another odometry stands still to the bit while matches show that the sensor moves."""
        before = self.odometry_pose
        if odometry_pose is None or before is None or self.n_failures > _MOST_MISSED:
            return False
        x, y, theta = self.last.pose.tolist()
        is_moving = max(math.hypot(x, y), abs(theta)) > _MOVING * self.config.least_sigma_m
        return is_moving and bool((odometry_pose == before).all())

    def _moved(self, prediction: Prediction, motion: UncertainPose) -> Pose | None:
        """Return how the sensor moved since another odometry was updated; None where that came with this scan."""
        if not prediction.is_missed:
            return None
        return motion.pose if self.moved is None else se2.compose(self.moved, motion.pose)

    def _measure(self, pose: Pose, cov: Cov, odometry_pose: Pose) -> bool:
        """Write into an expected motion what another odometry measured of it; return whether the translation was."""
        config, before = self.config, self.odometry_pose
        if before is None:
            return False
        by_wheels = se2.between(before, odometry_pose)
        by_wheels[:2] *= self.wheels.scale
        turn = float(se2.wrap(odometry_pose[2] - before[2]))  # known where the place is not
        path = math.hypot(by_wheels[0], by_wheels[1])
        share = config.wheel_turn_share * turn
        if self.moved is not None:  # several steps at once; the others were found, or repeated
            by_wheels = se2.between(self.moved, by_wheels)
            turn = float(se2.wrap(turn - self.moved[2]))
        is_measured = path < _LONGEST_STEP  # not where it is NaN
        if is_measured:
            pose[:2] = by_wheels[:2]
            cov[:2, :] = cov[:, :2] = 0.0
            variance = _WHEEL_FLOOR**2 + (config.wheel_share * path) ** 2
            cov[0, 0] = cov[1, 1] = self.wheels.noise[0] * variance
        if math.isfinite(turn):
            pose[2] = turn
            drift = config.wheel_share * path if is_measured else 0.0
            cov[2, :] = cov[:, 2] = 0.0
            variance = _WHEEL_FLOOR**2 + share**2 + drift**2
            cov[2, 2] = self.wheels.noise[1] * variance
        return is_measured

    def _after_change(self, change: Pose) -> tuple[float, float]:
        """Return the variances of translation and turn after one more change of the motion was seen."""
        x, y, theta = change.tolist()
        translation = self._averaged(self.variance_translation, 0.5 * (x * x + y * y))
        return translation, self._averaged(self.variance_turn, wrap_angle(theta) ** 2)

    def _inflated(self) -> tuple[float, float]:
        """Return variances that expect again, bit by bit, such turns as before any was seen.

        A robot starts to turn at once, not to drive.
        """
        wide = max(self.config.sigma_m**2, self.variance_turn)
        return self.variance_translation, self.variance_turn + (wide - self.variance_turn) / self.config.memory

    def _averaged(self, variance: float, square: float) -> float:
        square = min(square, self.config.motion_gate_chi2 * variance)  # one leap is not a habit
        return max(variance + (square - variance) / self.config.memory, self.config.least_sigma_m**2)
