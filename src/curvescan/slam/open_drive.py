"""OpenDrive: what the sensor may have driven besides, along directions that its matches left open.

Along a bare corridor the matches fix heading and distance to the walls; of the way along it they say nothing, and the
odometry may stand still while the sensor drives on. How far it drives as a rule is known from the scans before. The
difference of both is how uncertain the way is.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace

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


def _none() -> Floats:
    return np.zeros(2)


@dataclass(frozen=True, eq=False, kw_only=True)
class OpenDrive:
    """The way that open directions hide since the last keyframe."""

    usual: Floats = field(
        default_factory=_none
    )  # (2,): motion from a scan to the next as a rule, frame of the sensor, metres
    hidden: Floats = field(
        default_factory=_none
    )  # (2,): what the odometry may have left out since the keyframe, frame of that
    before: Floats = field(
        default_factory=_none
    )  # (2,): the same before the keyframe, since a match measured all of the motion
    since: Floats = field(default_factory=_none)  # (2,): the same since both
    n_measured: int = 0  # scans that measured all of the motion: before the first nothing is usual
    # since the keyframe
    turned: float = 0.0  # radians
    is_lost: bool = False  # it may have been carried anywhere
    n_open: int = 0  # scans that left a direction open, or everything
    n_blind: int = 0  # scans that left everything open

    def begun(self) -> OpenDrive:
        """Return what is hidden at a new keyframe."""
        before = _turned(self.before + self.since, -self.turned)
        return OpenDrive(usual=self.usual, n_measured=self.n_measured, before=before)

    def added(self, step: Step) -> OpenDrive:
        """Return what is hidden after a step of the odometry."""
        motion, turned = step.motion[:2], self.turned + float(step.motion[2])
        after = replace(self, turned=turned, is_lost=self.is_lost or step.outcome is StepOutcome.LOST)
        direction = _open_direction(step)
        if direction is None:
            n_measured = self.n_measured + step.is_matched
            usual = self.usual + (motion - self.usual) / min(max(n_measured, 1), _MEMORY)
            return replace(after, n_measured=n_measured, usual=usual, before=_none(), since=_none())
        after = replace(after, n_open=self.n_open + 1, n_blind=self.n_blind + (not step.is_matched))
        if step.is_driven:
            return after
        hidden = _turned(direction @ (self.usual - motion), self.turned)
        return replace(after, hidden=self.hidden + hidden, since=self.since + hidden)

    def known(self, motion: UncertainPose) -> UncertainPose:
        """Return the motion since the keyframe as well as it is known: along what is open by what may be hidden."""
        if self.is_lost or not (self.n_open and self.n_measured):
            return motion
        across = min(float(np.linalg.eigvalsh(motion.cov[:2, :2])[0]), self._most_across())
        cov = np.zeros((3, 3))
        # slips in a row have half of their error in common: of a + b the variance is a^2 + (b^2 + a b)
        share = 1.0 + max(float(self.before @ self.hidden), 0.0) / max(float(self.hidden @ self.hidden), 1e-12)
        cov[:2, :2] = across * np.eye(2) + share * np.outer(self.hidden, self.hidden)
        cov[2, 2] = min(float(motion.cov[2, 2]), _MOST_TURN)
        return UncertainPose(motion.pose, cov)

    def _most_across(self) -> float:
        """Return the greatest variance of a way that no match saw, square metres: that of going on or standing."""
        return _FLOOR**2 + float(self.usual @ self.usual) * self.n_blind**2


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
