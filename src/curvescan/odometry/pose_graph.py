"""PoseGraph: the matches of an odometry as edges between scans, gathered while it runs."""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan.odometry import OdometryStep
from curvescan.types import Pose, PoseEdge

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
            edge = PoseEdge(
                i=step.reference,
                j=step.index,
                pose=step.match.pose,
                covariance=step.match.covariance,
            )
            self.edges.append(edge)
        elif self._last is not None:
            moved = se2.between(self._last, step.pose)
            guess = np.diag(np.square(GUESS_SIGMAS))
            self.edges.append(
                PoseEdge(i=step.index - 1, j=step.index, pose=moved, covariance=guess)
            )
        self._last = step.pose
