"""Attempts: one match of the odometry, held against what was expected, and which of two is to be believed."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from curvescan.matchers import MatchResult
from curvescan.odometry.config import MotionConfig
from curvescan.se2.uncertain import UncertainPose, fuse

_OPEN = 100.0
"""Standard deviation of what is not measured, metres: more than any prediction errs."""


class GatedMatch(NamedTuple):
    """A match of the current scan with one reference.

    Attributes
    ----------
    result : MatchResult
        How it went.
    seen : UncertainPose
        The scan seen from the reference: the match fused with what was expected; what was expected where the match
        failed.
    is_plausible : bool
        Whether the match is about where it was expected.
    """

    result: MatchResult
    pose_keyframe_scan: UncertainPose
    is_plausible: bool

    @property
    def is_fully_observed(self) -> bool:
        """Whether the match tells all of the motion, with no direction left open."""
        return self.result.ok and self.result.degenerate_direction is None

    def is_confident(self, min_score: float) -> bool:
        """Return whether nothing speaks against the match. A matcher that tells no score is taken at its word."""
        return self.is_fully_observed and self.is_plausible and not self.result.score < min_score

    def is_accepted(self, least_score: float) -> bool:
        """Return whether the match may decide: one in an unexpected place must at least explain some of the scans."""
        return self.result.ok and (self.is_plausible or not self.result.score < least_score)

    def is_better_than(self, other: GatedMatch, min_score: float) -> bool:
        """Return whether this attempt is to be preferred to one with a reference that would rather be kept."""
        return self._rank(min_score) > other._rank(min_score)

    def is_as_good_as(self, other: GatedMatch) -> bool:
        """Return whether nothing speaks against this match that does not speak against another of the same scans."""
        return self._standing >= other._standing

    @property
    def _standing(self) -> tuple[bool, bool, bool]:
        return self.result.ok, self.is_plausible, self.is_fully_observed

    def _rank(self, min_score: float) -> tuple[bool, bool, bool, float]:
        score = self.result.score
        return *self._standing, min(score, min_score) if self.is_plausible else score


def as_measurement(result: MatchResult) -> UncertainPose:
    """Return the pose of a match as it may be fused: what the scans leave open is not measured at all."""
    cov = result.covariance
    if result.degenerate_direction is not None:
        # a matcher goes along there as its guess does: to count that as a measurement would count the guess twice
        cov = cov + _OPEN**2 * np.outer(result.degenerate_direction, result.degenerate_direction)
    return UncertainPose(result.pose, cov)


def gate(result: MatchResult, expected: UncertainPose, config: MotionConfig) -> GatedMatch:
    """Return a match held against what was expected.

    The two are fused: along a corridor, which the match leaves open, the expected motion decides. Where they contradict
    each other, what was expected is believed as little as after a failure.
    """
    if not result.ok:
        return GatedMatch(result, expected, False)
    if not config.is_fused:
        return GatedMatch(result, UncertainPose(result.pose, result.covariance), True)
    found = as_measurement(result)
    fused, distance = fuse(expected, found)
    is_plausible = distance <= config.motion_gate_chi2
    if not is_plausible:
        fused, _ = fuse(
            UncertainPose(expected.pose, expected.cov + config.recovery_covariance), found
        )
    return GatedMatch(result, fused, is_plausible)
