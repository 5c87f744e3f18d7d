"""A pose with its covariance, and the four things the odometry does with it: compose, between, inverse, fuse.

To first order, as in Smith, Self and Cheeseman, "Estimating uncertain spatial relationships in robotics" (1990). One
pose at a time, in kernels: the odometry does this a dozen times a scan.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan._jit import kernel
from curvescan.se2.angles import wrap_angle
from curvescan.types import Cov, Floats, Pose


class UncertainPose(NamedTuple):
    """Pose of a frame b in a frame a, and how well it is known.

    Attributes
    ----------
    pose : (3,) float64
        [x, y, theta]; metres, metres, radians in (-pi, pi].
    cov : (3, 3) float64
        Its covariance in the order x, y, theta, in frame a; zero where b is known exactly.
    """

    pose: Pose
    cov: Cov


def identity() -> UncertainPose:
    """Return the pose of a frame in itself: the identity, known exactly."""
    return UncertainPose(np.zeros(3), np.zeros((3, 3)))


def compose(a_b: UncertainPose, b_c: UncertainPose) -> UncertainPose:
    """Return the pose of c in a from two independent ones."""
    return UncertainPose(*_compose(a_b.pose, a_b.cov, b_c.pose, b_c.cov))


def between(a_b: UncertainPose, a_c: UncertainPose) -> UncertainPose:
    """Return the pose of c in b, where a_c was made by chaining something to a_b.

    The inverse of :func:`compose` in its second argument: what the two have in common cancels.
    """
    return UncertainPose(*_between(a_b.pose, a_b.cov, a_c.pose, a_c.cov))


def inverse(a_b: UncertainPose) -> UncertainPose:
    """Return the pose of a in b."""
    return UncertainPose(*_inverse(a_b.pose, a_b.cov))


def fuse(one: UncertainPose, other: UncertainPose) -> tuple[UncertainPose, float]:
    """Return the mean of two independent estimates of one pose, weighed by their covariances, and their distance.

    Parameters
    ----------
    one, other : UncertainPose
        The sum of their covariances must be positive definite.

    Returns
    -------
    UncertainPose
        The Kalman update of `one` by `other`: in a direction that one of them leaves open, the other decides.
    float
        The squared Mahalanobis distance of the two, chi-square of 3 degrees of freedom where both are right.
    """
    pose, cov, distance = _fuse(one.pose, one.cov, other.pose, other.cov)
    return UncertainPose(pose, cov), distance


@kernel
def _sandwich(left: Floats, cov: Cov) -> Cov:
    """Return left @ cov @ left.T, cov being symmetric."""
    half = np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                half[i, j] += left[i, k] * cov[k, j]
    whole = np.zeros((3, 3))
    for i in range(3):
        for j in range(i, 3):  # symmetric to the last bit
            for k in range(3):
                whole[i, j] += half[i, k] * left[j, k]
            whole[j, i] = whole[i, j]
    return whole


@kernel
def _jacobians(pose_ab: Pose, pose_bc: Pose) -> tuple[Floats, Floats]:
    """Return the derivatives of compose(pose_ab, pose_bc) by either."""
    c, s = math.cos(pose_ab[2]), math.sin(pose_ab[2])
    by_first, by_second = np.eye(3), np.eye(3)
    by_first[0, 2] = -s * pose_bc[0] - c * pose_bc[1]
    by_first[1, 2] = c * pose_bc[0] - s * pose_bc[1]
    by_second[0, 0], by_second[0, 1] = c, -s
    by_second[1, 0], by_second[1, 1] = s, c
    return by_first, by_second


@kernel
def _compose(pose_ab: Pose, cov_ab: Cov, pose_bc: Pose, cov_bc: Cov) -> tuple[Pose, Cov]:
    by_first, by_second = _jacobians(pose_ab, pose_bc)
    pose = np.empty(3)
    pose[0] = pose_ab[0] + by_second[0, 0] * pose_bc[0] + by_second[0, 1] * pose_bc[1]
    pose[1] = pose_ab[1] + by_second[1, 0] * pose_bc[0] + by_second[1, 1] * pose_bc[1]
    pose[2] = wrap_angle(pose_ab[2] + pose_bc[2])
    return pose, _sandwich(by_first, cov_ab) + _sandwich(by_second, cov_bc)


@kernel
def _between(pose_ab: Pose, cov_ab: Cov, pose_ac: Pose, cov_ac: Cov) -> tuple[Pose, Cov]:
    c, s = math.cos(pose_ab[2]), math.sin(pose_ab[2])
    x, y = pose_ac[0] - pose_ab[0], pose_ac[1] - pose_ab[1]
    pose = np.array([c * x + s * y, -s * x + c * y, wrap_angle(pose_ac[2] - pose_ab[2])])
    by_first, by_second = _jacobians(pose_ab, pose)
    rest = cov_ac - _sandwich(by_first, cov_ab)
    return pose, _sandwich(by_second.T, rest)  # by_second is a rotation


@kernel
def _inverse(pose_ab: Pose, cov_ab: Cov) -> tuple[Pose, Cov]:
    c, s = math.cos(pose_ab[2]), math.sin(pose_ab[2])
    x, y = pose_ab[0], pose_ab[1]
    pose = np.array([-c * x - s * y, s * x - c * y, wrap_angle(-pose_ab[2])])
    jacobian = np.array([[-c, -s, s * x - c * y], [s, -c, c * x + s * y], [0.0, 0.0, -1.0]])
    return pose, _sandwich(jacobian, cov_ab)


@kernel
def _inverse3(m: Cov) -> Cov:
    """Return the inverse of a symmetric positive definite matrix, by cofactors of it scaled to a unit diagonal."""
    scale = np.empty(3)
    for i in range(3):
        scale[i] = 1.0 / math.sqrt(m[i, i])
    a, b, c = (
        m[0, 1] * scale[0] * scale[1],
        m[0, 2] * scale[0] * scale[2],
        m[1, 2] * scale[1] * scale[2],
    )
    determinant = 1.0 + 2.0 * a * b * c - a * a - b * b - c * c
    inverse = np.empty((3, 3))
    inverse[0, 0], inverse[1, 1], inverse[2, 2] = 1.0 - c * c, 1.0 - b * b, 1.0 - a * a
    inverse[0, 1] = inverse[1, 0] = b * c - a
    inverse[0, 2] = inverse[2, 0] = a * c - b
    inverse[1, 2] = inverse[2, 1] = a * b - c
    for i in range(3):
        for j in range(3):
            inverse[i, j] *= scale[i] * scale[j] / determinant
    return inverse


@kernel
def _fuse(pose_1: Pose, cov_1: Cov, pose_2: Pose, cov_2: Cov) -> tuple[Pose, Cov, float]:
    weight = _inverse3(cov_1 + cov_2)
    apart = pose_2 - pose_1
    apart[2] = wrap_angle(apart[2])
    pull = np.zeros(3)
    for i in range(3):
        for j in range(3):
            pull[i] += weight[i, j] * apart[j]
    distance = 0.0
    pose = pose_1.copy()
    for i in range(3):
        distance += apart[i] * pull[i]
        for j in range(3):
            pose[i] += cov_1[i, j] * pull[j]
    pose[2] = wrap_angle(pose[2])
    # symmetric and positive whatever rounds: cov_1 W cov_2 W cov_1 + cov_2 W cov_1 W cov_2 (Joseph's form)
    gain_1, gain_2 = np.zeros((3, 3)), np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            for k in range(3):
                gain_1[i, j] += cov_2[i, k] * weight[k, j]
                gain_2[i, j] += cov_1[i, k] * weight[k, j]
    return pose, _sandwich(gain_1, cov_1) + _sandwich(gain_2, cov_2), distance
