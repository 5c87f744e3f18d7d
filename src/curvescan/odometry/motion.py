"""Motion: what is expected of the next scan before it is matched.

The speed goes on, and changes as much as it has been seen to change; wheels measure it. Wheels err in proportion to what
they measure (Thrun, Burgard and Fox, Probabilistic Robotics, 2005, section 5.4).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan.odometry.config import MotionConfig
from curvescan.odometry.track import Track
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Cov, Floats, Pose

_LEAST_CHANGE = 0.3
"""Share of the changes that are expected at first below which those that are learned never go."""

_LONGEST_STEP = 1_000.0
"""Metres from a scan to the next that wheels can measure; beyond, it is no measurement."""

_MOST_NOISE = 100.0
"""Limit of the variance of the wheels, in those of the configuration; its inverse squared root is the lower one."""

_MOVING = 0.06
"""Wheels that report the very pose of the scan before, after a longer motion than this, were not updated: metres, radians."""


class Wheels(NamedTuple):
    """The motion since the last scan by the wheels: (3,) pose, NaN where it is unknown, and the (3,) variances."""

    motion: Pose
    variances: Floats

    @property
    def is_complete(self) -> bool:
        """Whether they know the translation, and not the turn alone as a gyroscope does."""
        return bool(np.isfinite(self.motion).all())

    def on(self, track: Track, seconds: float) -> Track:
        """Return a track whose speed they have measured."""
        known = np.isfinite(self.motion)
        information = np.diag(np.where(known, seconds**2 / self.variances, 0.0))
        return track.at_speed(np.where(known, self.motion / seconds, track.speed), information)


@dataclass(frozen=True, eq=False, kw_only=True)
class MotionModel:
    """What has been learned of the changes of speed and of the wheels.

    Immutable: each scan makes a new one.

    Attributes
    ----------
    config : MotionConfig
        How well each is known at first.
    variances : tuple of float
        Of the change of speed and of the rate of turn, per second.
    noise : tuple of float
        Variances of the wheels' translation and turn, as multiples of the configuration's.
    wheels : (3,) float64 or None
        Their pose when they were last updated.
    since : (3,) float64
        Motion of the sensor from then to the last scan.
    """

    config: MotionConfig
    variances: tuple[float, float]
    noise: tuple[float, float] = (1.0, 1.0)
    wheels: Pose | None = None
    since: Pose

    @classmethod
    def at_start(cls, config: MotionConfig) -> MotionModel:
        """Return the model before the first scan."""
        return cls(config=config, variances=(config.speed_change**2, config.turn_change**2), since=np.zeros(3))

    @property
    def unknown_speed(self) -> Cov:
        """(3, 3) covariance of the speed of a sensor that nothing has measured, or that has just contradicted it."""
        return np.diag(np.square([self.config.speed_change, self.config.speed_change, self.config.turn_change]))

    def accelerated(self, track: Track, seconds: float) -> Track:
        """Return a track once its speed may have changed."""
        along, turn = self.variances
        return track.accelerated(seconds * np.array([along, along, turn]))

    def measured(self, wheels: Pose | None, last_motion: Pose) -> Wheels | None:
        """Return the motion since the last scan by the wheels; None where they do not tell."""
        before, config = self.wheels, self.config
        if wheels is None or before is None:
            return None
        is_moving = bool(np.abs(last_motion).max() > _MOVING)
        if is_moving and bool((wheels == before).all()):
            return None
        turn = float(se2.wrap(wheels[2] - before[2])) - float(self.since[2])
        motion = np.array([math.nan, math.nan, turn])
        if np.isfinite(wheels).all() and np.isfinite(before).all():
            motion = se2.between(self.since, se2.between(before, wheels))
        path = math.hypot(motion[0], motion[1])
        if path > _LONGEST_STEP:
            return None
        path = 0.0 if math.isnan(path) else path
        along = self.noise[0] * (config.wheel_floor_m**2 + (config.wheel_share * path) ** 2)
        turned = (config.wheel_turn_share * turn) ** 2 + (config.wheel_drift * path) ** 2
        return Wheels(motion, np.array([along, along, self.noise[1] * (config.wheel_floor_rad**2 + turned)]))

    def advanced(self, wheels: Pose | None, is_updated: bool, motion: Pose) -> MotionModel:
        """Return the model after a scan: wheels that were not updated go on to count from their last update."""
        if wheels is not None and (is_updated or self.wheels is None):
            return replace(self, wheels=wheels, since=np.zeros(3))
        return replace(self, since=se2.compose(self.since, motion))

    def learned(self, before: Track, after: Track, wheels: Wheels | None, seconds: float) -> MotionModel:
        """Return the model after a scan whose motion was measured in full."""
        config = self.config
        change = np.square(after.speed - before.speed) / seconds
        seen = (0.5 * float(change[0] + change[1]), float(change[2]))
        firsts = (config.speed_change**2, config.turn_change**2)
        variances = [
            max(self._averaged(old, new), _LEAST_CHANGE**2 * first)
            for old, new, first in zip(self.variances, seen, firsts, strict=True)
        ]
        noise = self.noise
        if wheels is not None and wheels.is_complete:
            error = np.square(se2.between(wheels.motion, after.speed * seconds)) / wheels.variances
            ratios = (0.5 * float(error[0] + error[1]), float(error[2]))
            least = _MOST_NOISE**-0.5
            noise = tuple(
                min(max(self._averaged(old, old * ratio), least), _MOST_NOISE)
                for old, ratio in zip(noise, ratios, strict=True)
            )
        return replace(self, variances=(variances[0], variances[1]), noise=noise)

    def _averaged(self, old: float, new: float) -> float:
        new = min(new, self.config.gate_chi2 * old)  # one leap is not a habit
        return old + (new - old) / self.config.memory

    def reach(self, pose: Pose, seconds: float) -> UncertainPose:
        """Return where a sensor may be that nothing has tracked for some time, about where it is taken to be."""
        far = self.config.speed_change + self.config.max_speed * seconds
        turned = min(self.config.turn_change + self.config.max_speed * seconds, math.pi)
        return UncertainPose(pose, np.diag(np.square([far, far, turned])))
