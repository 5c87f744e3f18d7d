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
"""The same where a pose is only compared with the expectation, metres: one far along an open direction was compared
where the sensor is not."""

_VAGUE_SIGMA = 0.08
"""Standard deviation of what is expected along a degenerate direction from which on the scans are matched without a
guess, metres: below it they say nothing new, and what they say again and again of one keyframe errs alike."""

_NOTHING = 1e-9  # information, and share of it, that is rounding
_MAX_LOG_ODDS = 60  # beyond it a probability is 0 or 1


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
    along = result.degenerate_direction[:2]
    return bool(along @ expected.cov[:2, :2] @ along > _VAGUE_SIGMA**2 * (along @ along))


def has_unguided_pose(result: MatchResult) -> bool:
    """Return whether a degenerate match shows by itself where the scans agree best along its degenerate direction."""
    return bool(result.candidates) and not result.is_guess_decisive and _is_placed(result.candidates[0])


def unguided_measurement(result: MatchResult) -> UncertainPose | None:
    """Return what a match says along its degenerate direction too, None where it does not."""
    if result.ok and result.degenerate_direction is None:
        return UncertainPose(result.pose, result.covariance)
    return _measured(result.candidates[0]) if result.ok and _is_placed(result.candidates[0]) else None


def decided_by_expectation(result: MatchResult, expected: UncertainPose, config: MotionConfig) -> MatchResult:
    """Return a match that failed as a good one where its best pose explains the scans and lies where expected.

    Without a guess such a pose would be one of several, or chance. Of scans of one place in a row it is right.
    """
    if result.ok or not result.candidates or not result.score >= config.expected_score:
        return result
    best, *others = result.candidates
    known = np.linalg.eigvalsh(best.information) > _NOTHING * np.trace(best.information)
    if known.sum() < (3 if best.degenerate_direction is None else 2):
        return result
    if fuse(expected, _measured(best, _NEAR))[1] > config.motion_gate_chi2:
        return result
    decided = _measured(best)
    odds = [-best.log_odds, *(other.log_odds - best.log_odds for other in others)]
    return replace(
        result,
        outcome=Outcome.MATCHED,
        pose=decided.pose,
        covariance=decided.cov,
        n_matched=best.n_matched,
        degenerate_direction=best.degenerate_direction,
        confidence=1.0 / (1.0 + sum(math.exp(min(value, _MAX_LOG_ODDS)) for value in odds)),
    )


def _is_placed(best: Candidate) -> bool:
    """Return whether a candidate is known along all directions, along a degenerate one by its best place."""
    direction = best.degenerate_direction
    return direction is None or bool(direction @ best.information @ direction > _NOTHING)


def _measured(best: Candidate, sigma: float = 1.0) -> UncertainPose:
    """Return the pose that the scans agree on best, with so many metres along a direction that they leave open."""
    information, direction = best.information, best.degenerate_direction
    if direction is not None and not _is_placed(best):
        along = direction / (sigma * (direction @ direction))
        information = information + np.outer(along, along)
    cov = np.linalg.inv(information)
    return UncertainPose(best.pose, 0.5 * (cov + cov.T))
