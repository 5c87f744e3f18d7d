"""The matches of an odometry as edges between scans."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from curvescan import se2
from curvescan.odometry import Step, StepOutcome
from curvescan.types import Cov, Pose, PoseEdge

GUESS_SIGMAS = (0.1, 0.1, 0.1)
"""Standard deviations of a motion that no match measured: metres, metres, radians a step."""


def edges_of(steps: Iterable[Step]) -> list[PoseEdge]:
    """Return the edges of an odometry: one a step but the first, by its match.

    A step whose match failed joins its scan with the one before by the expected motion, so that the graph does not fall
    apart.
    """
    edges: list[PoseEdge] = []

    def join(i: int, step: Step, pose: Pose, covariance: Cov) -> None:
        edges.append(PoseEdge(i=i, j=step.index, pose=pose, covariance=covariance))

    last: Pose | None = None
    for step in steps:
        if step.match is not None and step.match.ok and step.reference is not None:
            join(step.reference, step, step.match.pose, step.match.covariance)
        elif step.outcome is StepOutcome.LOST:
            join(step.index - 1, step, step.motion, step.motion_covariance)
        elif last is not None:
            join(step.index - 1, step, se2.between(last, step.pose_odom), np.diag(np.square(GUESS_SIGMAS)))
        last = step.pose_odom
    return edges
