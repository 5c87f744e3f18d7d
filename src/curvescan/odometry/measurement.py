"""What a match measures, as an uncertain pose."""

from __future__ import annotations

import numpy as np

from curvescan.matchers import MatchResult
from curvescan.se2.uncertain import UncertainPose

_OPEN = 100.0
"""Standard deviation of what is not measured, metres: more than any prediction errs."""


def as_measurement(result: MatchResult) -> UncertainPose:
    """Return the pose of a match as it may be fused: what the scans leave open is not measured at all."""
    cov = result.covariance
    if result.degenerate_direction is not None:
        # a matcher goes along there as its guess does: to count that as a measurement would count the guess twice
        cov = cov + _OPEN**2 * np.outer(result.degenerate_direction, result.degenerate_direction)
    return UncertainPose(result.pose, cov)
