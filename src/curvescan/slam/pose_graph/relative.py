"""How a scan lies to an earlier one by the odometry."""

from __future__ import annotations

import numpy as np

from curvescan.odometry.step import Step, StepOutcome
from curvescan.se2.uncertain import UncertainPose, between

UNMEASURED = (StepOutcome.PREDICTED, StepOutcome.HELD, StepOutcome.LOST)
"""Outcomes of steps whose motion no match measured."""


def between_steps(origin: Step, step: Step) -> UncertainPose:
    """Return the pose of a step in the frame of an earlier one, with what was added to the covariance since."""
    found = between(UncertainPose(origin.pose, origin.covariance), UncertainPose(step.pose, step.covariance))
    values, vectors = np.linalg.eigh(found.cov)
    if values[0] > 0.0:
        return found
    # the two hang on one keyframe, or a stretch was settled since: the poses then differ by what was put right
    return UncertainPose(found.pose, (vectors * np.abs(values)) @ vectors.T)
