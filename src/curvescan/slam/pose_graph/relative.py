"""How a scan lies to an earlier one by the odometry."""

from __future__ import annotations

import numpy as np

from curvescan.odometry.step import Step
from curvescan.se2.uncertain import UncertainPose, between
from curvescan.types import Cov


def between_steps(origin: Step, step: Step) -> UncertainPose:
    """Return the pose of a step in the frame of an earlier one, with what was added to the covariance since."""
    found = between(UncertainPose(origin.pose, origin.covariance), UncertainPose(step.pose, step.covariance))
    if _is_positive(found.cov):
        return found
    # the two hang on one keyframe, or a stretch was settled since: the poses then differ by what was put right
    values, vectors = np.linalg.eigh(found.cov)
    return UncertainPose(found.pose, (vectors * np.abs(values)) @ vectors.T)


def _is_positive(cov: Cov) -> bool:
    """Return whether all leading minors of a symmetric matrix are positive."""
    (a, b, c), (_, d, e), (_, _, f) = cov.tolist()
    minor = a * d - b * b
    return bool(a > 0.0 and minor > 0.0 and f * minor - a * e * e + 2.0 * b * c * e - d * c * c > 0.0)
