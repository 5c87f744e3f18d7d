"""The steps of a localizer."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from curvescan.odometry.step import Step, StepOutcome
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Cov

NOWHERE = UncertainPose(np.full(3, np.nan), np.full((3, 3), np.nan))
"""The pose of a sensor that is searched for."""


def as_step(step: Step, here: UncertainPose, covariance_global: Cov, outcome: StepOutcome, keyframe: int = -1) -> Step:
    """Return the step of a scan whose pose in the map is `here`, by its step of the odometry."""
    return replace(
        step,
        pose=here.pose,
        covariance=here.cov,
        outcome=outcome,
        keyframe=keyframe,
        covariance_global=covariance_global,
    )
