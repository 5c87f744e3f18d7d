"""What is known of a match before it: a pose with its covariance, checked where it enters the library."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import ArrayLike

from curvescan.errors import InvalidArgumentError
from curvescan.types import Pose, UncertainPose

GUESS_SIGMA = (0.3, 0.3, 0.2)  # standard deviations that a bare guess stands for: metres, metres, radians

WIDE_SIGMA = (2.0, 2.0, 1.5)
"""Standard deviations about standing still that hold where nothing is known: metres, metres, radians."""

WIDE_PRIOR = UncertainPose(np.zeros(3), np.diag(np.square(WIDE_SIGMA)))

_GUESS_COVARIANCE = np.diag(np.square(GUESS_SIGMA))
_GUESS_COVARIANCE.setflags(write=False)

_MAX = 1e6  # metres, radians: no laser sees as far
_ASYMMETRY = 1e-9  # of the greatest element: what rounding leaves


def prior_of(prior: UncertainPose | None, guess: ArrayLike | None, name: str = "") -> UncertainPose | None:
    """Return what two arguments say is known before a match, checked; None for nothing. Raises InvalidArgumentError."""
    if guess is not None:
        if prior is not None:
            raise InvalidArgumentError("prior and guess say the same: give one of them")
        return UncertainPose(_as_pose(guess, name or "guess"), _GUESS_COVARIANCE)
    if prior is None:
        return None
    name = name or "prior"
    if not isinstance(prior, UncertainPose):
        raise InvalidArgumentError(f"{name} must be an UncertainPose(pose, covariance), got {type(prior).__name__}")
    return _as_prior(prior, name)


def _as_prior(prior: UncertainPose, name: str) -> UncertainPose:
    pose = _as_pose(prior.pose, f"{name}.pose")
    try:
        cov = np.asarray(prior.covariance, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"{name}.covariance must be a (3, 3) matrix of numbers: {error}") from error
    if cov.shape != (3, 3) or not np.isfinite(cov).all():
        raise InvalidArgumentError(f"{name}.covariance must be (3, 3) and finite, got {prior.covariance!r}")
    if np.abs(cov - cov.T).max() > _ASYMMETRY * max(float(np.abs(cov).max()), _ASYMMETRY):
        raise InvalidArgumentError(f"{name}.covariance must be symmetric, got {prior.covariance!r}")
    least = float(np.linalg.eigvalsh(cov)[0])
    if not math.isfinite(least) or least <= 0.0:
        raise InvalidArgumentError(
            f"{name}.covariance must be positive definite, its least eigenvalue is {least:g}: "
            "where something is known exactly, give it a small variance"
        )
    return UncertainPose(pose, cov)


def _as_pose(value: ArrayLike, name: str) -> Pose:
    try:
        pose = np.asarray(value, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise InvalidArgumentError(f"{name} must be three numbers [x, y, theta]: {error}") from error
    if pose.shape != (3,) or not np.isfinite(pose).all():
        raise InvalidArgumentError(f"{name} must be three finite numbers [x, y, theta], got {value!r}")
    if np.abs(pose).max() > _MAX:
        raise InvalidArgumentError(
            f"{name} must lie within {_MAX:g} m, its angle within as many radians: leave it out where there is "
            f"none, got {value!r}"
        )
    return pose
