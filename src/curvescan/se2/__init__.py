"""Poses in the plane: the group SE(2).

A pose is ``[x, y, theta]``; ``pose_a_b`` is the pose of frame b in frame a, so that a point moves by ``p_a = R(theta)
p_b + t`` and ``compose(pose_a_b, pose_b_c)`` is ``pose_a_c``: inner letters cancel. All functions broadcast over
leading dimensions and return new float64 arrays. A single pose goes by plain numbers, in a tenth of the time.
"""

import math
from typing import cast

import numpy as np
from numpy.typing import ArrayLike

from curvescan.errors import InvalidArgumentError
from curvescan.types import Cov, Floats, Points, Pose

LEAST_VARIANCE = 1e-18  # square metres and radians: a nanometre and a nanoradian
_LEAST_DETERMINANT = 1e-13  # of correlations: below it rounding decides


def wrap(angle: ArrayLike) -> Floats:
    """Return angles brought into (-pi, pi].

    Parameters
    ----------
    angle : (...) array_like
        Radians. NaN and infinities come back as NaN.

    Returns
    -------
    (...) float64
        Radians in (-pi, pi].
    """
    angle = np.asarray(angle, dtype=np.float64)
    if angle.ndim == 0:
        return np.array(_wrapped(float(angle)))
    with np.errstate(invalid="ignore"):
        remainder = np.remainder(angle + np.pi, 2.0 * np.pi)
    # the seam (remainder 0) belongs to +pi; what lies inside already keeps all its digits
    wrapped = np.where(remainder == 0.0, np.pi, remainder - np.pi)
    return cast(Floats, np.where((angle > -np.pi) & (angle <= np.pi), angle, wrapped))


def identity() -> Pose:
    """Return the pose of a frame in itself: zeros of shape (3,)."""
    return np.zeros(3)


def compose(pose_a_b: ArrayLike, pose_b_c: ArrayLike) -> Pose:
    """Return pose_a_c, the pose of frame c in frame a (eq. 1 for a pair of relative poses).

    Parameters
    ----------
    pose_a_b, pose_b_c : (..., 3) array_like
        [x, y, theta]; metres, metres, radians. NaN propagates.

    Returns
    -------
    (..., 3) float64
        [x, y, theta], theta in (-pi, pi].
    """
    first, second = _as_pose(pose_a_b, "pose_a_b"), _as_pose(pose_b_c, "pose_b_c")
    if first.ndim == second.ndim == 1:
        return np.array(_composed(first.tolist(), second.tolist()))
    cos, sin = np.cos(first[..., 2]), np.sin(first[..., 2])
    x = first[..., 0] + cos * second[..., 0] - sin * second[..., 1]
    y = first[..., 1] + sin * second[..., 0] + cos * second[..., 1]
    return np.stack([x, y, wrap(first[..., 2] + second[..., 2])], axis=-1)


def inverse(pose_a_b: ArrayLike) -> Pose:
    """Return pose_b_a, the pose of frame a in frame b.

    Parameters
    ----------
    pose_a_b : (..., 3) array_like
        [x, y, theta]; metres, metres, radians. NaN propagates.

    Returns
    -------
    (..., 3) float64
        [x, y, theta], theta in (-pi, pi].
    """
    pose = _as_pose(pose_a_b, "pose_a_b")
    if pose.ndim == 1:
        return np.array(_inverted(pose.tolist()))
    cos, sin = np.cos(pose[..., 2]), np.sin(pose[..., 2])
    x = -cos * pose[..., 0] - sin * pose[..., 1]
    y = sin * pose[..., 0] - cos * pose[..., 1]
    return np.stack([x, y, wrap(-pose[..., 2])], axis=-1)


def between(pose_w_a: ArrayLike, pose_w_b: ArrayLike) -> Pose:
    """Return pose_a_b from the poses of a and b in a common frame w.

    Parameters
    ----------
    pose_w_a, pose_w_b : (..., 3) array_like
        [x, y, theta]; metres, metres, radians. NaN propagates.

    Returns
    -------
    (..., 3) float64
        [x, y, theta], theta in (-pi, pi].
    """
    first, second = _as_pose(pose_w_a, "pose_w_a"), _as_pose(pose_w_b, "pose_w_b")
    if first.ndim == second.ndim == 1:
        return np.array(_composed(_inverted(first.tolist()), second.tolist()))
    return compose(inverse(first), second)


def exp(velocity: ArrayLike) -> Pose:
    """Return where a frame that moves at a constant velocity, as seen by itself, is after one second.

    The path is an arc of a circle: the exponential map of SE(2).

    Parameters
    ----------
    velocity : (..., 3) array_like
        [vx, vy, omega] in the moving frame, m/s, m/s, rad/s; or any velocity times its time.

    Returns
    -------
    (..., 3) float64
        Pose in the frame at the start, theta in (-pi, pi].
    """
    v = _as_pose(velocity, "velocity")
    half = 0.5 * v[..., 2]
    along, across = np.sinc(v[..., 2] / np.pi), np.sin(half) * np.sinc(half / np.pi)
    x = along * v[..., 0] - across * v[..., 1]
    y = across * v[..., 0] + along * v[..., 1]
    return np.stack([x, y, wrap(v[..., 2])], axis=-1)


def log(pose_a_b: ArrayLike) -> Floats:
    """Return the constant velocity, as seen by the moving frame, that leads from a to b in one second.

    The inverse of :func:`exp`, by the shorter way round.

    Parameters
    ----------
    pose_a_b : (..., 3) array_like
        [x, y, theta].

    Returns
    -------
    (..., 3) float64
        [vx, vy, omega], m/s, m/s, rad/s; omega in (-pi, pi].
    """
    pose = _as_pose(pose_a_b, "pose_a_b")
    found = []
    for x, y, theta in pose.reshape(-1, 3).tolist():
        half = 0.5 * _wrapped(theta)
        cos, sin = _cos_sin(half)
        along = cos if half == 0.0 else cos / (sin / half)
        found.append([along * x + half * y, along * y - half * x, 2.0 * half])
    return np.reshape(found, pose.shape)


def transform(pose_a_b: ArrayLike, points_b: ArrayLike) -> Points:
    """Return points of frame b expressed in frame a: R(theta) p + t.

    Parameters
    ----------
    pose_a_b : (3,) array_like
        Pose of frame b in frame a.
    points_b : (..., 2) array_like
        Metres, frame b. NaN rows stay NaN.

    Returns
    -------
    (..., 2) float64
        Metres, frame a.
    """
    pose = _as_pose(pose_a_b, "pose_a_b")
    points = np.asarray(points_b, dtype=np.float64)
    if points.ndim == 0 or points.shape[-1] != 2:
        raise InvalidArgumentError(f"points must have shape (..., 2), got {points.shape}")
    return points @ rotation(pose[2]).T + pose[:2]


def rotation(theta: float) -> Floats:
    """Return the (2, 2) rotation matrix of an angle in radians."""
    cos, sin = np.cos(theta), np.sin(theta)
    return np.array([[cos, -sin], [sin, cos]])


def _wrapped(angle: float) -> float:
    """Return one angle in (-pi, pi], as `wrap` does."""
    if -math.pi < angle <= math.pi:
        return angle
    remainder = (angle + math.pi) % (2.0 * math.pi)
    return math.pi if remainder == 0.0 else remainder - math.pi


def _composed(first: list[float], second: list[float]) -> list[float]:
    """Return the composition of two single poses."""
    (ax, ay, a), (bx, by, b) = first, second
    cos, sin = _cos_sin(a)
    return [ax + cos * bx - sin * by, ay + sin * bx + cos * by, _wrapped(a + b)]


def _inverted(pose: list[float]) -> list[float]:
    """Return the inverse of a single pose."""
    x, y, theta = pose
    cos, sin = _cos_sin(theta)
    return [-cos * x - sin * y, sin * x - cos * y, _wrapped(-theta)]


def is_positive_definite(cov: Cov) -> bool:
    """Return whether a symmetric (3, 3) matrix is positive definite by more than rounding, from its correlations."""
    (xx, xy, xt), (_, yy, yt), (_, _, tt) = cov.tolist()
    if not min(xx, yy, tt) >= LEAST_VARIANCE:
        return False
    x, y, t = math.sqrt(xx), math.sqrt(yy), math.sqrt(tt)
    a, b, c = xy / (x * y), xt / (x * t), yt / (y * t)
    return bool(abs(a) < 1.0 and 1.0 + 2.0 * a * b * c - a * a - b * b - c * c > _LEAST_DETERMINANT)


def _cos_sin(angle: float) -> tuple[float, float]:
    if not math.isfinite(angle):  # which the math module refuses
        return math.nan, math.nan
    return math.cos(angle), math.sin(angle)


def _as_pose(value: ArrayLike, name: str) -> Pose:
    pose = np.asarray(value, dtype=np.float64)
    if pose.ndim == 0 or pose.shape[-1] != 3:
        raise InvalidArgumentError(f"{name} must have shape (..., 3) [x, y, theta], got shape {pose.shape}")
    return pose
