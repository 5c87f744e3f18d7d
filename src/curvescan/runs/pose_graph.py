"""PoseGraph: the matches of an odometry as edges between scans, gathered while it runs."""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan.odometry import OdometryStep, StepOutcome
from curvescan.types import Cov, Pose, PoseEdge

GUESS_SIGMAS = (0.1, 0.1, 0.1)
"""Standard deviations of a motion that no match measured: metres, metres, radians a step."""


class PoseGraph:
    """Edges from the steps of an odometry; ``on_step`` of run_odometry may be its ``add``.

    A step whose match failed joins its scan with the one before by the motion that was taken for it, wide in its
    covariance, so that the graph does not fall apart.

    Attributes
    ----------
    edges : list of PoseEdge
        One a step but the first.
    """

    def __init__(self) -> None:
        self.edges: list[PoseEdge] = []
        self._last: Pose | None = None

    def add(self, step: OdometryStep) -> None:
        """Take up a step."""
        if step.match is not None and step.match.ok and step.reference is not None:
            self._join(step.reference, step, step.match.pose, step.match.covariance)
        elif step.outcome is StepOutcome.LOST:
            self._join(step.index - 1, step, step.motion, step.motion_covariance)
        elif self._last is not None:
            moved = se2.between(self._last, step.pose)
            self._join(step.index - 1, step, moved, np.diag(np.square(GUESS_SIGMAS)))
        self._last = step.pose

    def _join(self, i: int, step: OdometryStep, pose: Pose, covariance: Cov) -> None:
        self.edges.append(PoseEdge(i=i, j=step.index, pose=pose, covariance=covariance))
