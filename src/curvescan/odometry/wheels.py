"""Wheels: what matches tell of another odometry, its noise, its scale, and how much it slips.

All three are learned from the drive itself, where a match measures the whole of a motion that the other odometry was
asked for: real wheels slip by 2 to 5 % of the way, and no one figure serves them.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from curvescan import se2
from curvescan.odometry.config import MotionConfig
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Pose

_LEAST_NOISE = 0.1
"""Least variance of another odometry, in those of the configuration."""

_MOST_ERROR = 4.0
"""The most that the square of one error counts, in the variance: a slip is not a habit, nor is one that people who walk
along feign."""

_STRETCH = 2.0
"""Slips are measured over stretches of the way this long, metres: over shorter ones the noise of matches is more."""


class Wheels(NamedTuple):
    """What is known of another odometry."""

    slip: float  # what it errs by along the way, beside its scale, as a share of it: a standard deviation, an axis
    # variance of its translation and turn, as multiples of what the configuration says: the mean over the last steps
    noise: tuple[float, float] = (1.0, 1.0)
    # metres driven, one to begin with, by the matches, and meanwhile by the other odometry: wheels of a wrong size err
    # by the same share all the way
    ways: tuple[float, float] = (1.0, 1.0)
    # of the stretch under way: metres, and by how much the other odometry is behind, seen from the sensor
    stretch: float = 0.0
    behind: tuple[float, float] = (0.0, 0.0)

    @property
    def scale(self) -> float:
        """Metres driven for each that it tells."""
        return self.ways[0] / self.ways[1]

    def interrupted(self) -> Wheels:
        """Return what is known after a motion that nothing else measured."""
        return self._replace(stretch=0.0, behind=(0.0, 0.0))

    def learned(self, expected: UncertainPose, motion: Pose, config: MotionConfig) -> Wheels:
        """Return what is known after one more motion, (3,), and where it was expected."""
        path, off = math.hypot(expected.pose[0], expected.pose[1]), motion[:2] - expected.pose[:2]
        told = self._replace(noise=self._learned_noise(expected, motion, config.memory))
        if 0.5 * float(off @ off) > config.motion_gate_chi2 * expected.covariance[0, 0]:
            return told.interrupted()  # it leapt
        if path > 0.0:
            along = float(expected.pose[:2] @ motion[:2]) / path
            told = told._replace(ways=(self.ways[0] + along, self.ways[1] + path / self.scale))
        (x, y), c, s = off + self.behind, math.cos(motion[2]), math.sin(motion[2])
        told = told._replace(stretch=self.stretch + path, behind=(c * x + s * y, c * y - s * x))
        if told.stretch < _STRETCH:
            return told
        error = 0.5 * (x * x + y * y) / (self.slip * told.stretch) ** 2
        slip = max(self.slip * math.sqrt(_factor(error, config.memory)), 1e-6)
        return told.interrupted()._replace(slip=slip)

    def _learned_noise(self, expected: UncertainPose, motion: Pose, memory: float) -> tuple[float, float]:
        """Return the noise after one more error."""
        x, y, theta = se2.between(expected.pose, motion).tolist()
        of_translation = 0.5 * (x * x + y * y) / expected.covariance[0, 0]
        of_turn = theta * theta / expected.covariance[2, 2]
        factors = _factor(of_translation, memory), _factor(of_turn, memory)
        return max(self.noise[0] * factors[0], _LEAST_NOISE), max(self.noise[1] * factors[1], _LEAST_NOISE)


def _factor(error: float, memory: float) -> float:
    """Return what a variance changes by after one more error, whose square is so many times as large."""
    return 1.0 + (min(error, _MOST_ERROR) - 1.0) / memory
