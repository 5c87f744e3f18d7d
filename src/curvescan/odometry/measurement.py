"""What a match measures where the scans leave a doubt: along a flat direction, or between poses.

The odometry knows the covariance of what it expects. What the scans alone say stands in the candidates of a match, and
is weighed here.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from curvescan.matchers import Candidate, MatchResult
from curvescan.matchers.result import Outcome
from curvescan.odometry.config import MotionConfig
from curvescan.se2.uncertain import UncertainPose, fuse

_OPEN = 100.0
"""Standard deviation of what is not measured, metres: more than any prediction errs."""

_NEAR = 0.3
"""Metres along an open direction from which on a pose was compared where the sensor is not: so far from there the
expectation may be."""

_VAGUE_SIGMA = 0.08
"""Standard deviation of what is expected along a degenerate direction from which on the scans are matched without a
guess, metres: below it they say nothing new, and what they say again and again of one keyframe errs alike."""


def as_measurement(result: MatchResult) -> UncertainPose:
    """Return the pose of a match as it may be fused: what the scans leave open is not measured at all."""
    cov = result.covariance
    if result.degenerate_direction is not None:
        # a matcher goes along there as its guess does: to count that as a measurement would count the guess twice
        cov = cov + _OPEN**2 * np.outer(result.degenerate_direction, result.degenerate_direction)
    return UncertainPose(result.pose, cov)


def is_vague_along(expected: UncertainPose, result: MatchResult) -> bool:
    """Return whether a match is degenerate along a direction in which the expectation is vague, too."""
    if result.degenerate_direction is None:
        return False
    x, y = result.degenerate_direction[:2]
    variance = np.array([x, y]) @ expected.cov[:2, :2] @ np.array([x, y])
    return bool(variance > _VAGUE_SIGMA**2 * (x * x + y * y))


def has_unguided_pose(result: MatchResult) -> bool:
    """Return whether a degenerate match shows by itself where the scans agree best along its degenerate direction."""
    return not result.is_guess_decisive and _is_placed(result.candidates[0])


def unguided_measurement(result: MatchResult) -> UncertainPose | None:
    """Return what a match says along its degenerate direction too, None where it does not."""
    if not result.ok:
        return None
    if result.degenerate_direction is None:
        return UncertainPose(result.pose, result.covariance)
    best = result.candidates[0]
    return UncertainPose(best.pose, best.covariance) if _is_placed(best) else None


def decided_by_expectation(result: MatchResult, expected: UncertainPose, config: MotionConfig) -> MatchResult:
    """Return a match that failed as a good one where its best pose explains the scans and lies where expected.

    Without a guess such a pose would be one of several, or chance. Of scans of one place in a row it is right.
    """
    if result.ok or not result.candidates or not result.score >= config.expected_score:
        return result
    best, *others = result.candidates
    direction, near = best.degenerate_direction, best.covariance
    if _n_known(best) < (3 if direction is None else 2):
        return result
    if direction is not None and not _is_placed(best):
        near = near - (1.0 - _NEAR**2) * np.outer(direction, direction)
    if fuse(expected, UncertainPose(best.pose, near))[1] > config.motion_gate_chi2:
        return result
    odds = (-best.log_odds, *(other.log_odds - best.log_odds for other in others))
    return replace(
        result,
        outcome=Outcome.MATCHED,
        pose=best.pose,
        covariance=best.covariance,
        n_matched=best.n_matched,
        degenerate_direction=direction,
        confidence=1.0 / (1.0 + sum(math.exp(value) for value in odds)),
    )


def _n_known(best: Candidate) -> int:
    """Return along how many directions the scans measure a candidate."""
    return int(np.linalg.matrix_rank(best.information, tol=_OPEN**-2, hermitian=True))


def _is_placed(best: Candidate) -> bool:
    """Return whether the scans measure all of a candidate: along a degenerate direction by its best place."""
    return _n_known(best) == len(best.pose)
