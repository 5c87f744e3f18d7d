"""The filter: where the sensor is relative to its keyframe, how fast it moves, and how these errors go together.

An extended Kalman filter (Thrun, Burgard and Fox, Probabilistic Robotics, 2005, chapter 3) of nine numbers: the keyframe
in the map, the sensor seen from the keyframe, and its motion a second. What a match says of the speed after a stretch
that showed none corrects the whole stretch, through the covariance. Matches come as information matrices: a direction
that they leave open has none, and the motion goes on along it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from curvescan import se2
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Cov, Floats, Pose

_KEY, _HERE, _SPEED = slice(0, 3), slice(3, 6), slice(6, 9)

_JITTER = 0.005
"""Error of an expected motion that the speed does not explain, metres and radians a step: matches with one keyframe err
alike, and are not averaged below it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Track:
    """The state of the filter.

    Attributes
    ----------
    keyframe : (3,) float64
        Pose of the keyframe in the map.
    here : (3,) float64
        Pose of the sensor seen from the keyframe.
    speed : (3,) float64
        Motion of the sensor a second, in its own frame: m, m, rad.
    cov : (9, 9) float64
        Covariance of the three, in this order.
    log_weight : float
        Logarithm of how likely this hypothesis is, up to a constant.
    """

    keyframe: Pose
    here: Pose
    speed: Floats
    cov: Cov
    log_weight: float = 0.0

    @classmethod
    def at(cls, keyframe: UncertainPose, here: UncertainPose, speed: Floats, speed_cov: Cov) -> Track:
        """Return a track whose parts err independently."""
        cov = np.zeros((9, 9))
        cov[_KEY, _KEY], cov[_HERE, _HERE], cov[_SPEED, _SPEED] = keyframe.covariance, here.covariance, speed_cov
        return cls(keyframe=keyframe.pose, here=here.pose, speed=speed, cov=cov)

    @property
    def seen(self) -> UncertainPose:
        """The sensor seen from its keyframe."""
        return UncertainPose(self.here, self.cov[_HERE, _HERE])

    @property
    def pose_map_keyframe(self) -> UncertainPose:
        """The keyframe in the map."""
        return UncertainPose(self.keyframe, self.cov[_KEY, _KEY])

    @property
    def pose_map_scan(self) -> UncertainPose:
        """The sensor in the map."""
        by_key, by_here = _jacobians(self.keyframe, self.here)
        jacobian = np.hstack([by_key, by_here])
        cov = jacobian @ self.cov[:6, :6] @ jacobian.T
        return UncertainPose(se2.compose(self.keyframe, self.here), 0.5 * (cov + cov.T))

    @property
    def speed_cov(self) -> Cov:
        """(3, 3) covariance of the speed."""
        return self.cov[_SPEED, _SPEED]

    def motion(self, seconds: float) -> UncertainPose:
        """Return the motion within some time at this speed."""
        return UncertainPose(self.speed * seconds, seconds**2 * self.speed_cov + np.eye(3) * _JITTER**2)

    def stopped(self, speed_cov: Cov) -> Track:
        """Return the track of a sensor whose speed is not known: at rest, or any other."""
        cov = self.cov.copy()
        cov[_SPEED, :] = cov[:, _SPEED] = 0.0
        cov[_SPEED, _SPEED] = speed_cov
        return replace(self, speed=np.zeros(3), cov=cov)

    def accelerated(self, variances: Floats) -> Track:
        """Return the track once its speed may have changed; variances (3,)."""
        cov = self.cov.copy()
        cov[_SPEED, _SPEED] += np.diag(variances)
        return replace(self, cov=cov)

    def moved(self, seconds: float) -> Track:
        """Return the track some time on."""
        motion = self.speed * seconds
        by_here, by_motion = _jacobians(self.here, motion)
        cov = self.cov.copy()
        cov[_HERE] = by_here @ self.cov[_HERE] + seconds * by_motion @ self.cov[_SPEED]
        left = cov[:, _HERE].copy()
        cov[:, _HERE] = left @ by_here.T + seconds * cov[:, _SPEED] @ by_motion.T
        cov[_HERE, _HERE] += np.eye(3) * _JITTER**2
        return replace(self, here=se2.compose(self.here, motion), cov=0.5 * (cov + cov.T))

    def loosened(self, variances: Floats, seconds: float) -> Track:
        """Return the track if its speed may have changed by more before the last move; variances (3,)."""
        c, s = math.cos(self.here[2]), math.sin(self.here[2])
        turn = seconds * np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
        both = np.vstack([turn, np.eye(3)])
        cov = self.cov.copy()
        cov[3:, 3:] += (both * variances) @ both.T
        return replace(self, cov=cov)

    def with_keyframe(self) -> Track:
        """Return the track seen from where the sensor is: its keyframe from now on."""
        by_key, by_here = _jacobians(self.keyframe, self.here)
        step = np.zeros((9, 9))
        step[_KEY, _KEY], step[_KEY, _HERE], step[_SPEED, _SPEED] = by_key, by_here, np.eye(3)
        here = self.pose_map_scan.pose
        return replace(self, keyframe=here, here=np.zeros(3), cov=step @ self.cov @ step.T)

    def displaced(self, cov: Cov) -> Track:
        """Return the track whose place in the map is known less by a covariance."""
        total = self.cov.copy()
        total[_KEY, _KEY] += cov
        return replace(self, cov=total)

    def at_speed(self, speed: Floats, information: Cov) -> Track:
        """Return the track after a measurement of its speed."""
        return self._updated(_SPEED, speed - self.speed, information)[0]

    def at_pose(self, pose: Pose, information: Cov) -> tuple[Track, float]:
        """Return the track after a measurement of the sensor seen from the keyframe, and its squared Mahalanobis distance."""
        error = pose - self.here
        error[2] = math.remainder(error[2], 2.0 * math.pi)
        return self._updated(_HERE, error, information)

    def _updated(self, part: slice, error: Floats, information: Cov) -> tuple[Track, float]:
        known = self.cov[part, part]
        # (known + information^-1)^-1, where the information may be singular
        weight = np.linalg.solve(np.eye(3) + information @ known, information)
        weight = 0.5 * (weight + weight.T)
        gain = self.cov[:, part] @ weight
        change, distance = gain @ error, float(error @ weight @ error)
        cov = self.cov - gain @ self.cov[part, :]
        sign, log_volume = np.linalg.slogdet(np.eye(3) + information @ known)
        here = self.here + change[_HERE]
        keyframe = self.keyframe + change[_KEY]
        here[2], keyframe[2] = (math.remainder(angle, 2.0 * math.pi) for angle in (here[2], keyframe[2]))
        updated = replace(
            self,
            keyframe=keyframe,
            here=here,
            speed=self.speed + change[_SPEED],
            cov=0.5 * (cov + cov.T),
            log_weight=self.log_weight - 0.5 * (distance + (log_volume if sign > 0.0 else 0.0)),
        )
        return updated, distance


def _jacobians(a_b: Pose, b_c: Pose) -> tuple[Floats, Floats]:
    """Return the (3, 3) derivatives of compose(a_b, b_c) by either."""
    c, s = math.cos(a_b[2]), math.sin(a_b[2])
    x, y = float(b_c[0]), float(b_c[1])
    first = np.array([[1.0, 0.0, -s * x - c * y], [0.0, 1.0, c * x - s * y], [0.0, 0.0, 1.0]])
    return first, np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
