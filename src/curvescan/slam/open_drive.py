"""How a scan lies to an earlier one by the odometry, and what the sensor may have driven besides.

Along a bare corridor the matches fix heading and distance to the walls; of the way along it they say nothing, and the
odometry may stand still while the sensor drives on. How far it drives as a rule is known from the scans before. The
difference of both is how uncertain the way is.
"""

from __future__ import annotations

from contextlib import suppress
from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan.odometry.step import Step, StepOutcome
from curvescan.se2.uncertain import UncertainPose, between
from curvescan.slam.keyframes import is_turn
from curvescan.types import Floats

UNMEASURED = (StepOutcome.PREDICTED, StepOutcome.HELD, StepOutcome.LOST)
"""Outcomes of steps whose motion no match measured."""

_MEMORY = 10
"""Scans over which the usual motion is averaged."""


def between_steps(origin: Step, step: Step) -> UncertainPose:
    """Return the pose of a step in the frame of an earlier one, with what was added to the covariance since."""
    found = between(UncertainPose(origin.pose, origin.covariance), UncertainPose(step.pose, step.covariance))
    with suppress(np.linalg.LinAlgError):
        np.linalg.cholesky(found.cov)
        return found
    # the two hang on one keyframe, or a stretch was settled since: the poses then differ by what was put right
    values, vectors = np.linalg.eigh(found.cov)
    return UncertainPose(found.pose, (vectors * np.abs(values)) @ vectors.T)


class OpenDrive(NamedTuple):
    """The way that open directions hide since the last keyframe."""

    usual: Floats = np.zeros(2)  # (2,), metres: motion from a scan to the next as a rule, frame of the sensor
    hidden: Floats = np.zeros(2)  # what the odometry may have left out since the keyframe, frame of that
    n_measured: int = 0  # scans that measured all of the motion: before the first nothing is usual
    # since the keyframe
    turned: float = 0.0  # radians
    is_open: bool = False  # whether a scan left a direction open, or everything
    n_turns: int = 0  # scans that left a turn open

    def begun(self) -> OpenDrive:
        """Return what is hidden at a new keyframe."""
        return OpenDrive(usual=self.usual, n_measured=self.n_measured)

    def added(self, step: Step) -> OpenDrive:
        """Return what is hidden after a step of the odometry."""
        motion, turned = step.motion[:2], self.turned + float(step.motion[2])
        after = self._replace(turned=turned, n_turns=self.n_turns + _leaves_turn_open(step))
        direction = _open_direction(step)
        if direction is None:
            n_measured = self.n_measured + step.is_matched
            usual = self.usual + (motion - self.usual) / min(max(n_measured, 1), _MEMORY)
            return after._replace(n_measured=n_measured, usual=usual)
        after = after._replace(is_open=True)
        if step.is_driven:
            return after
        hidden = se2.rotation(self.turned) @ direction @ (self.usual - motion)
        return after._replace(hidden=self.hidden + hidden)

    def known(self, motion: UncertainPose) -> UncertainPose:
        """Return the motion since the keyframe as well as it is known: along what is open by what may be hidden.

        Of turns in a row that no match measures the standard deviations add up, and not the variances.
        """
        if self.n_turns > 1:
            added = np.diag([0.0, 0.0, (self.n_turns - 1) * motion.cov[2, 2]])
            motion = UncertainPose(motion.pose, motion.cov + added)
        if not (self.is_open and self.n_measured):
            return motion
        across = float(np.linalg.eigvalsh(motion.cov[:2, :2])[0])
        cov = np.diag([across, across, motion.cov[2, 2]])
        cov[:2, :2] += np.outer(self.hidden, self.hidden)
        return UncertainPose(motion.pose, cov)


def _leaves_turn_open(step: Step) -> bool:
    """Return whether a step measured all but a turn, in a round room."""
    direction = step.match.degenerate_direction if step.is_matched and step.match is not None else None
    return direction is not None and is_turn(direction)


def _open_direction(step: Step) -> Floats | None:
    """Return the (2, 2) projection on the way that a step left open, frame of the sensor before; None where none."""
    if not step.is_matched:
        return None if step.outcome is StepOutcome.STARTED else np.eye(2)
    if step.match is None or step.match.degenerate_direction is None or _leaves_turn_open(step):
        return None
    x, y, _ = step.match.degenerate_direction.tolist()  # frame of the keyframe that the match is with
    seen = se2.rotation(float(step.motion[2] - step.match.pose[2])) @ (x, y)
    way = np.linalg.norm(seen)
    return np.outer(seen / way, seen / way)
