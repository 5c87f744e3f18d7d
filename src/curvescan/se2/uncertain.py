"""A pose with its covariance, what is done with it, compose, between, inverse, fuse, and what those are made of.

To first order, as in Smith, Self and Cheeseman, "Estimating uncertain spatial relationships in robotics" (1990). One
pose at a time, in kernels: the odometry does this a dozen times a scan. They are written out element by element, as
expressions of whole arrays take seconds to compile.
"""

import math

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.se2 import LEAST_VARIANCE
from curvescan.types import Cov, Floats, Pose
from curvescan.types import UncertainPose as UncertainPose

_N_SWEEPS = 8  # of Jacobi rotations: four reach rounding, the rest is for matrices of any scale
_ROUNDING = 1e-15  # of the diagonal: what is left of the other elements is nothing


@inlined
def wrap_angle(angle: float) -> float:
    """Return an angle brought into (-pi, pi], radians; what lies inside keeps all its digits."""
    wrapped = angle - 2.0 * math.pi * math.floor((angle + math.pi) / (2.0 * math.pi))
    return math.pi if wrapped == -math.pi else wrapped


def identity() -> UncertainPose:
    """Return the pose of a frame in itself: the identity, known exactly."""
    return UncertainPose(np.zeros(3), np.zeros((3, 3)))


def compose(a_b: UncertainPose, b_c: UncertainPose) -> UncertainPose:
    """Return the pose of c in a from two independent ones."""
    return UncertainPose(*composed(a_b.pose, a_b.covariance, b_c.pose, b_c.covariance))


def between(a_b: UncertainPose, a_c: UncertainPose) -> UncertainPose:
    """Return c in b, where a_c was chained to a_b: the inverse of :func:`compose`, what they share cancels."""
    return UncertainPose(*_between(a_b.pose, a_b.covariance, a_c.pose, a_c.covariance))


def inverse(a_b: UncertainPose) -> UncertainPose:
    """Return the pose of a in b."""
    return UncertainPose(*_inverse(a_b.pose, a_b.covariance))


def fuse(one: UncertainPose, other: UncertainPose) -> tuple[UncertainPose, float]:
    """Return the mean of two independent estimates of one pose, weighed by their covariances, and their distance."""
    pose, cov, distance = _fuse(one.pose, one.covariance, other.pose, other.covariance)
    return UncertainPose(pose, cov), distance


@kernel
def add_sandwich(left: Floats, cov: Cov, total: Cov) -> None:
    """Add left @ cov @ left.T to `total`, cov being symmetric."""
    for i in range(3):
        a, b, c = left[i, 0], left[i, 1], left[i, 2]
        x = a * cov[0, 0] + b * cov[1, 0] + c * cov[2, 0]
        y = a * cov[0, 1] + b * cov[1, 1] + c * cov[2, 1]
        z = a * cov[0, 2] + b * cov[1, 2] + c * cov[2, 2]
        for j in range(i, 3):  # symmetric to the last bit
            product = x * left[j, 0] + y * left[j, 1] + z * left[j, 2]
            total[i, j] += product
            if i != j:
                total[j, i] += product


@inlined
def affine(c: float, s: float, x: float, y: float) -> Floats:
    """Return the (3, 3) matrix of a rotation by an angle of cosine c and sine s, and a third column (x, y, 1)."""
    matrix = np.zeros((3, 3))
    matrix[0, 0], matrix[0, 1], matrix[0, 2] = c, -s, x
    matrix[1, 0], matrix[1, 1], matrix[1, 2] = s, c, y
    matrix[2, 2] = 1.0
    return matrix


@kernel
def composed(pose_ab: Pose, cov_ab: Cov, pose_bc: Pose, cov_bc: Cov) -> tuple[Pose, Cov]:
    """Return what :func:`compose` does, in kernels."""
    c, s = math.cos(pose_ab[2]), math.sin(pose_ab[2])
    x, y = pose_bc[0], pose_bc[1]
    pose, cov = np.empty(3), np.zeros((3, 3))
    pose[0] = pose_ab[0] + c * x + -s * y
    pose[1] = pose_ab[1] + s * x + c * y
    pose[2] = wrap_angle(pose_ab[2] + pose_bc[2])
    add_sandwich(affine(1.0, 0.0, -s * x - c * y, c * x - s * y), cov_ab, cov)
    add_sandwich(affine(c, s, 0.0, 0.0), cov_bc, cov)
    return pose, cov


@kernel
def _between(pose_ab: Pose, cov_ab: Cov, pose_ac: Pose, cov_ac: Cov) -> tuple[Pose, Cov]:
    c, s = math.cos(pose_ab[2]), math.sin(pose_ab[2])
    dx, dy = pose_ac[0] - pose_ab[0], pose_ac[1] - pose_ab[1]
    x, y = c * dx + s * dy, -s * dx + c * dy
    pose, rest, cov = np.empty(3), np.zeros((3, 3)), np.zeros((3, 3))
    pose[0], pose[1], pose[2] = x, y, wrap_angle(pose_ac[2] - pose_ab[2])
    add_sandwich(affine(1.0, 0.0, -s * x - c * y, c * x - s * y), cov_ab, rest)
    for i in range(3):
        for j in range(3):
            rest[i, j] = cov_ac[i, j] - rest[i, j]
    add_sandwich(affine(c, -s, 0.0, 0.0), rest, cov)
    return pose, cov


@kernel
def _inverse(pose_ab: Pose, cov_ab: Cov) -> tuple[Pose, Cov]:
    c, s = math.cos(pose_ab[2]), math.sin(pose_ab[2])
    x, y = pose_ab[0], pose_ab[1]
    pose, cov = np.empty(3), np.zeros((3, 3))
    pose[0], pose[1], pose[2] = -c * x - s * y, s * x - c * y, wrap_angle(-pose_ab[2])
    jacobian = affine(-c, s, s * x - c * y, c * x + s * y)
    jacobian[1, 0], jacobian[0, 1], jacobian[2, 2] = s, -s, -1.0
    add_sandwich(jacobian, cov_ab, cov)
    return pose, cov


@kernel
def inverse3(m: Cov) -> Cov:
    """Return the inverse of a symmetric positive definite matrix, by cofactors of it scaled to a unit diagonal."""
    # a matcher's covariance may not be positive where its fit is degenerate: no square root of that
    x = 1.0 / math.sqrt(max(m[0, 0], LEAST_VARIANCE))
    y = 1.0 / math.sqrt(max(m[1, 1], LEAST_VARIANCE))
    z = 1.0 / math.sqrt(max(m[2, 2], LEAST_VARIANCE))
    a, b, c = m[0, 1] * x * y, m[0, 2] * x * z, m[1, 2] * y * z
    determinant = 1.0 + 2.0 * a * b * c - a * a - b * b - c * c
    inverse = np.empty((3, 3))
    inverse[0, 0] = (1.0 - c * c) * (x * x / determinant)
    inverse[1, 1] = (1.0 - b * b) * (y * y / determinant)
    inverse[2, 2] = (1.0 - a * a) * (z * z / determinant)
    inverse[0, 1] = inverse[1, 0] = (b * c - a) * (x * y / determinant)
    inverse[0, 2] = inverse[2, 0] = (a * c - b) * (x * z / determinant)
    inverse[1, 2] = inverse[2, 1] = (a * b - c) * (y * z / determinant)
    return inverse


@kernel
def eigen3(matrix: Floats) -> tuple[Floats, Floats]:
    """Return ascending eigenvalues, and eigenvectors (columns), of a symmetric 3 x 3 matrix, by Jacobi rotations."""
    a = np.empty((3, 3))
    v = np.zeros((3, 3))
    for i in range(3):
        v[i, i] = 1.0
        for k in range(3):
            a[i, k] = matrix[i, k]
    for _ in range(_N_SWEEPS):
        off = abs(a[0, 1]) + abs(a[0, 2]) + abs(a[1, 2])
        if off <= _ROUNDING * (abs(a[0, 0]) + abs(a[1, 1]) + abs(a[2, 2])):
            break
        for p in range(2):
            for q in range(p + 1, 3):
                if a[p, q] == 0.0:
                    continue
                ratio = 0.5 * (a[q, q] - a[p, p]) / a[p, q]
                t = 1.0 / (abs(ratio) + math.sqrt(1.0 + ratio * ratio))
                t = -t if ratio < 0.0 else t
                c = 1.0 / math.sqrt(1.0 + t * t)
                s = t * c
                for k in range(3):
                    akp, akq = a[k, p], a[k, q]
                    a[k, p], a[k, q] = c * akp - s * akq, s * akp + c * akq
                for k in range(3):
                    apk, aqk = a[p, k], a[q, k]
                    a[p, k], a[q, k] = c * apk - s * aqk, s * apk + c * aqk
                    vkp, vkq = v[k, p], v[k, q]
                    v[k, p], v[k, q] = c * vkp - s * vkq, s * vkp + c * vkq
    values = np.empty(3)
    for k in range(3):
        values[k] = a[k, k]
    for i in range(2):
        for k in range(2 - i):
            if values[k] > values[k + 1]:
                values[k], values[k + 1] = values[k + 1], values[k]
                for row in range(3):
                    v[row, k], v[row, k + 1] = v[row, k + 1], v[row, k]
    return values, v


@kernel
def _fuse(pose_1: Pose, cov_1: Cov, pose_2: Pose, cov_2: Cov) -> tuple[Pose, Cov, float]:
    both = np.empty((3, 3))
    for i in range(3):
        for j in range(3):
            both[i, j] = cov_1[i, j] + cov_2[i, j]
    weight = inverse3(both)
    apart, pull, pose = np.empty(3), np.zeros(3), np.empty(3)
    for i in range(3):
        pose[i] = pose_1[i]
        apart[i] = pose_2[i] - pose_1[i]
    apart[2] = wrap_angle(apart[2])
    gain_1, gain_2, cov = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros((3, 3))
    for i in range(3):
        for j in range(3):
            pull[i] += weight[i, j] * apart[j]
            for k in range(3):
                gain_1[i, j] += cov_2[i, k] * weight[k, j]
                gain_2[i, j] += cov_1[i, k] * weight[k, j]
    distance = 0.0
    for i in range(3):
        distance += apart[i] * pull[i]
        for j in range(3):
            pose[i] += cov_1[i, j] * pull[j]
    pose[2] = wrap_angle(pose[2])
    # symmetric and positive whatever rounds: cov_1 W cov_2 W cov_1 + cov_2 W cov_1 W cov_2 (Joseph's form)
    add_sandwich(gain_1, cov_1, cov)
    add_sandwich(gain_2, cov_2, cov)
    return pose, cov, distance
