"""How a scan lies to an earlier one by the odometry."""

from __future__ import annotations

import math

import numpy as np

from curvescan.odometry.config import MotionConfig
from curvescan.odometry.step import Step
from curvescan.se2.uncertain import UncertainPose, between
from curvescan.types import Cov, Pose


def between_steps(origin: Step, step: Step) -> UncertainPose:
    """Return the pose of a step in the frame of an earlier one, with what was added to the covariance since."""
    found = between(UncertainPose(origin.pose, origin.covariance), UncertainPose(step.pose, step.covariance))
    if _is_positive(found.cov):
        return found
    # the two may hang on one keyframe of the odometry, whose error they share
    values, vectors = np.linalg.eigh(found.cov)
    return UncertainPose(found.pose, (vectors * np.maximum(values, 0.0)) @ vectors.T)


def _is_positive(cov: Cov) -> bool:
    """Return whether all leading minors of a symmetric matrix are positive."""
    (a, b, c), (_, d, e), (_, _, f) = cov.tolist()
    minor = a * d - b * b
    return bool(a > 0.0 and minor > 0.0 and f * minor - a * e * e + 2.0 * b * c * e - d * c * c > 0.0)


def wheel_motion(moved: Pose, config: MotionConfig) -> UncertainPose:
    """Return a motion measured by wheels with its covariance (Thrun, Burgard and Fox 2005, section 5.4)."""
    path, turn = math.hypot(moved[0], moved[1]), abs(float(moved[2]))
    sigma_rad = config.wheel_floor_rad + config.wheel_turn_share * turn + config.wheel_drift * path
    # a sensor ahead of the wheels moves when they turn
    sigma_m = config.wheel_floor_m + config.wheel_share * path + 0.5 * sigma_rad
    return UncertainPose(moved, np.diag(np.square([sigma_m, sigma_m, sigma_rad])))
