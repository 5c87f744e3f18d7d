"""OpenDrive: what the sensor may have driven besides, along directions that its matches left open.

Along a bare corridor the matches fix heading and distance to the walls; of the way along it they say nothing, and the
odometry may stand still while the sensor drives on. How far it drives as a rule is known from the scans before. The
difference of both is how uncertain the way is.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan.odometry.step import Step, StepOutcome
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Floats, Pose

_MEMORY = 10
"""Scans over which the usual motion is averaged."""

_FLOOR = 0.1
"""Standard deviation of a way that no match saw, at the least, metres."""

_MOST_TURN = 0.3**2
"""Greatest variance of a turn that no match saw, square radians."""


class OpenDrive:
    """The way that open directions hide since the last keyframe.

    Attributes
    ----------
    usual : (2,) float64
        Motion from a scan to the next as a rule, frame of the sensor, metres.
    hidden : (2,) float64
        What the odometry may have left out since :meth:`begin`, frame of the sensor then, metres.
    """

    def __init__(self) -> None:
        self.usual: Floats = np.zeros(2)
        self.hidden: Floats = np.zeros(2)
        self._before: Floats = np.zeros(2)  # hidden before the keyframe, since a match measured all of the motion
        self._since: Floats = np.zeros(2)  # the same since the keyframe
        self._n_measured = 0  # scans that measured all of the motion: before the first nothing is usual
        self._turned = 0.0  # since the keyframe, radians
        self._is_lost = False  # since then: it may have been carried anywhere
        self._n_open = self._n_blind = 0  # scans since then that left a direction open, or everything

    def begin(self) -> None:
        """Begin at a keyframe."""
        self._before = _turned(self._before + self._since, -self._turned)
        self.hidden = self._since = np.zeros(2)
        self._turned, self._is_lost = 0.0, False
        self._n_open = self._n_blind = 0

    def add(self, step: Step) -> None:
        """Take up a step of the odometry."""
        motion = step.motion
        self._is_lost |= step.outcome is StepOutcome.LOST
        direction = _open_direction(step)
        if direction is None:
            self._n_measured += step.is_matched
            self.usual = self.usual + (motion[:2] - self.usual) / min(max(self._n_measured, 1), _MEMORY)
            self._before = self._since = np.zeros(2)
        else:
            self._n_open += 1
            self._n_blind += not step.is_matched
            if not step.is_driven:
                hidden = _turned(direction @ (self.usual - motion[:2]), self._turned)
                self.hidden, self._since = self.hidden + hidden, self._since + hidden
        self._turned += float(motion[2])

    def known(self, motion: UncertainPose) -> UncertainPose:
        """Return the motion since the keyframe as well as it is known: along what is open by what may be hidden."""
        if self._is_lost or not (self._n_open and self._n_measured):
            return motion
        across = min(float(np.linalg.eigvalsh(motion.cov[:2, :2])[0]), self._most_across())
        cov = np.zeros((3, 3))
        # slips in a row have half of their error in common: of a + b the variance is a^2 + (b^2 + a b)
        share = 1.0 + max(float(self._before @ self.hidden), 0.0) / max(float(self.hidden @ self.hidden), 1e-12)
        cov[:2, :2] = across * np.eye(2) + share * np.outer(self.hidden, self.hidden)
        cov[2, 2] = min(float(motion.cov[2, 2]), _MOST_TURN)
        return UncertainPose(motion.pose, cov)

    def _most_across(self) -> float:
        """Return the greatest variance of a way that no match saw, square metres: that of going on or standing."""
        return _FLOOR**2 + float(self.usual @ self.usual) * self._n_blind**2


def _turned(vector: Floats, angle: float) -> Floats:
    c, s = math.cos(angle), math.sin(angle)
    x, y = vector.tolist()
    return np.array([c * x - s * y, s * x + c * y])


def _open_direction(step: Step) -> Floats | None:
    """Return the (2, 2) projection on what a step left open, frame of the sensor before; None where it measured all."""
    if not step.is_matched:
        return None if step.outcome is StepOutcome.STARTED else np.eye(2)
    if step.match is None or step.match.degenerate_direction is None:
        return None
    x, y, turn = _seen_before(step, step.match.degenerate_direction).tolist()
    way = math.hypot(x, y)
    if way <= abs(turn):
        return None
    along = np.array([x, y]) / way
    return np.outer(along, along)


def _seen_before(step: Step, direction: Pose) -> Pose:
    """Return a direction in the frame of the keyframe of a match as the sensor saw it a scan before."""
    assert step.match is not None
    turn = float(step.motion[2] - step.match.pose[2])
    return np.array([*_turned(direction[:2], turn), direction[2]])
