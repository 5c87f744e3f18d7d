"""Gating: one match of the odometry compared with what was expected, and which of two is preferred."""

from __future__ import annotations

from typing import NamedTuple

from curvescan.matchers import MatchResult
from curvescan.odometry.config import MotionConfig
from curvescan.odometry.measurement import as_measurement
from curvescan.se2.uncertain import UncertainPose, fuse

SURE = 0.8
"""Least confidence of a match that explains little of the scans, or bridges a gap: in an unseen room such ones come
about by chance."""


class GatedMatch(NamedTuple):
    """A match of the current scan with one reference."""

    result: MatchResult  # how it went
    # the scan seen from the reference: the match fused with what was expected; what was expected where the match failed
    pose_keyframe_scan: UncertainPose
    is_plausible: bool  # whether the match is about where it was expected
    # whether the match is about where the last motion leads, and another odometry, which says otherwise, was left out
    is_prior_rejected: bool = False
    measured: UncertainPose | None = None  # what was fused with what was expected; None where the match failed
    # whether it was fused with the last motion repeated, although another odometry expected something
    is_by_last_motion: bool = False

    def made_without(self, expected: UncertainPose, config: MotionConfig) -> GatedMatch:
        """Return a match that another odometry had no part in, and whether it contradicts that odometry."""
        distance = 0.0 if self.measured is None else fuse(expected, self.measured)[1]
        is_rejected = self.is_plausible and distance > config.motion_gate_chi2
        return self._replace(is_prior_rejected=is_rejected, is_by_last_motion=True)

    @property
    def is_fully_observed(self) -> bool:
        """Whether the match measures all of the motion, with no direction left open."""
        return self.result.ok and self.result.degenerate_direction is None

    def is_confident(self, min_score: float) -> bool:
        """Return whether nothing speaks against the match. A matcher without a score is trusted."""
        return self.is_fully_observed and self.is_plausible and not self.result.score < min_score

    def is_accepted(self, least_score: float) -> bool:
        """Return whether the match may decide: one that explains little must lie where expected, and be sure."""
        result = self.result
        if not result.ok or not result.score < least_score:
            return result.ok
        return self.is_plausible and not result.confidence < SURE

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


def gate(
    result: MatchResult,
    expected: UncertainPose,
    config: MotionConfig,
    repeated: UncertainPose | None = None,
    measured: UncertainPose | None = None,
) -> GatedMatch:
    """Return a match compared with what was expected.

    The two are fused: along a corridor, which the match leaves open, the expected motion decides. Where they
    contradict each other, what was expected counts as little as after a failure.
    """
    if not result.ok:
        return GatedMatch(result, expected, False)
    if not config.is_fused:
        found = UncertainPose(result.pose, result.covariance)
        return GatedMatch(result, found, True, measured=found)
    found = as_measurement(result)
    if measured is not None and fuse(expected, measured)[1] <= config.motion_gate_chi2:
        found = measured
    fused, distance = fuse(expected, found)
    is_plausible = distance <= config.motion_gate_chi2
    if repeated is not None and (result.degenerate_direction is None or not is_plausible):
        by_last, last_distance = fuse(repeated, found)
        if last_distance <= config.motion_gate_chi2:
            return GatedMatch(result, by_last, True, not is_plausible, found, True)
    if not is_plausible:
        fused, _ = fuse(UncertainPose(expected.pose, expected.cov + config.recovery_covariance), found)
    return GatedMatch(result, fused, is_plausible, measured=found)
