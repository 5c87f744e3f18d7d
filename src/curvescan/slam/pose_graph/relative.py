"""How a scan lies to an earlier one by the odometry."""

from __future__ import annotations

import math

import numpy as np

from curvescan import se2
from curvescan.odometry.config import MotionConfig
from curvescan.odometry.step import OdometryStep
from curvescan.se2.uncertain import UncertainPose
from curvescan.types import Pose


def between_steps(origin: OdometryStep, step: OdometryStep) -> UncertainPose:
    """Return the pose of a step in the frame of an earlier one, with what was added to the covariance since."""
    pose = se2.between(origin.pose, step.pose)
    c, s = math.cos(origin.pose[2]), math.sin(origin.pose[2])
    back = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
    dx, dy = step.pose[:2] - origin.pose[:2]
    by_origin = np.eye(3)
    by_origin[0, 2], by_origin[1, 2] = -dy, dx
    rest = back @ (step.covariance - by_origin @ origin.covariance @ by_origin.T) @ back.T
    # the two may hang on one keyframe of the odometry, whose error they share
    values, vectors = np.linalg.eigh(0.5 * (rest + rest.T))
    return UncertainPose(pose, (vectors * np.maximum(values, 0.0)) @ vectors.T)


def wheel_motion(moved: Pose, config: MotionConfig) -> UncertainPose:
    """Return a motion measured by wheels with its covariance (Thrun, Burgard and Fox 2005, section 5.4)."""
    path, turn = math.hypot(moved[0], moved[1]), abs(float(moved[2]))
    sigma_rad = config.wheel_floor_rad + config.wheel_turn_share * turn + config.wheel_drift * path
    # a sensor ahead of the wheels moves when they turn
    sigma_m = config.wheel_floor_m + config.wheel_share * path + 0.5 * sigma_rad
    return UncertainPose(moved, np.diag(np.square([sigma_m, sigma_m, sigma_rad])))
