"""Measurement: one match of the odometry, weighed against what was expected, and which of two is preferred.

The odometry knows the covariance of what it expects. What the scans alone say where they leave a doubt, along a flat
direction or between poses, stands in the candidates of a match.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan.matchers import Candidate, MatchResult, PreparedScan, prepared
from curvescan.matchers.registry import Matcher
from curvescan.matchers.result import Outcome, log_odds, slip_odds
from curvescan.odometry.config import MotionConfig, OdometryConfig
from curvescan.odometry.motion_model import Prediction
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose, compose, eigen3, fuse
from curvescan.types import Cov, Floats, with_fields

_OPEN = 100.0
"""Standard deviation of what is not measured, metres: more than any prediction errs."""

_NEAR = 0.3
"""Metres along an open direction from which on a pose was compared where the sensor is not: so far from there the
expectation may be."""

CERTAIN = 3.5
"""Log odds (0.97) at which one match closes a gap, the most that one gives, and by which a pose elsewhere must be
likelier than one where the motion leads."""

_VAGUE_SIGMA = 0.08
"""Standard deviation of what is expected along a degenerate direction from which on the scans are matched without a
guess, metres: below it they say nothing new, and what they say again and again of one keyframe errs alike."""

_SUDDEN = 3.0
"""Log odds against a sudden shift, for each squared distance of it by how far a sensor gets: that is up to 0.4 of right
matches on Intel, ACES and Killian, 1.3 to 2 of wrong ones. Turns begin at once, and nothing that moves feigns them."""


class GatedMatch(NamedTuple):
    """A match of the current scan with one reference."""

    result: MatchResult  # how it went
    # the scan seen from the reference: the match fused with what was expected; what was expected where the match failed
    pose_keyframe_scan: UncertainPose
    is_plausible: bool  # whether the match is about where it was expected
    measured: UncertainPose  # what was fused with what was expected; what was expected where the match failed
    leap: float = 0.0  # squared distance from where it was expected, by how far a sensor moves unseen
    is_opened: bool = False  # whether it counts for nothing along the way by which it contradicts what was expected
    # whether the match is about where the last motion leads, and another odometry, which says otherwise, was left out
    is_prior_rejected: bool = False
    # whether it was fused with the last motion repeated, although another odometry expected something
    is_by_last_motion: bool = False

    @property
    def is_fully_observed(self) -> bool:
        """Whether the match measures all of the motion, with no direction left open."""
        return self.result.ok and self.result.degenerate_direction is None

    def is_confident(self, min_score: float) -> bool:
        """Return whether nothing speaks against the match. A matcher without a score is trusted."""
        return self.is_fully_observed and self.is_plausible and not self.result.score < min_score

    @property
    def log_odds(self) -> float:
        """Log odds that the match is right, within +-CERTAIN, less for a leap; the most where a matcher gives none."""
        return max(min(log_odds(self.result.confidence, unknown=CERTAIN), CERTAIN), -CERTAIN) - 0.5 * self.leap

    @property
    def is_accepted(self) -> bool:
        """Whether the match may decide: not where a sensor hardly gets in the time."""
        return self.result.ok and self.log_odds >= -CERTAIN

    @property
    def standing(self) -> tuple[bool, bool, bool]:
        """What speaks for the match: of two of the same scans the greater one is to be preferred."""
        return self.result.ok, self.is_plausible, self.is_fully_observed

    def is_better_than(self, other: GatedMatch, min_score: float) -> bool:
        """Return whether this attempt is to be preferred to one with a reference that would rather be kept."""
        one, two = (min(m.result.score, min_score) if m.is_plausible else m.result.score for m in (self, other))
        return (*self.standing, one) > (*other.standing, two)


def gate(
    result: MatchResult,
    expected: UncertainPose,
    prediction: Prediction,
    config: MotionConfig,
    measured: UncertainPose | None = None,
) -> GatedMatch:
    """Return a match compared with what was expected.

    The two are fused: along a corridor, which the match leaves open, the expected motion decides. Where they
    contradict each other, what was expected counts as little as after a failure. But where it is likelier that the
    match is wrong than that the sensor moves so at once, or that wheels slip which go on as it did, it counts for
    nothing along there: in a corridor a door that is carried, or people who keep pace, may be all that shows the way.
    """
    if not result.ok:
        return GatedMatch(result, expected, False, expected)
    if not config.is_fused:
        found = UncertainPose(result.pose, result.covariance)
        return GatedMatch(result, found, True, found)
    found = as_measurement(result)
    if measured is not None and fuse(expected, measured)[1] <= config.motion_gate_chi2:
        found = measured
    fused, distance = fuse(expected, found)
    if distance <= config.motion_gate_chi2:
        return GatedMatch(result, fused, True, found)
    fused, leap = fuse(UncertainPose(expected.pose, expected.covariance + prediction.recovery), found)
    odds, off = log_odds(result.confidence, unknown=CERTAIN), found.pose[:2] - expected.pose[:2]
    if prediction.is_confirmed:
        against = min(slip_odds(off, distance), CERTAIN)
    else:
        against = _SUDDEN * _shift(expected, found, prediction)
    if against <= max(odds, 1.0):  # however doubtful, no small shift is sudden
        return GatedMatch(result, fused, False, found, leap)
    way = np.array([*off, 0.0]) / math.hypot(*off)
    wide = _OPEN**2 * np.outer(way, way)
    found, result = UncertainPose(found.pose, found.covariance + wide), _opened(result, way, wide)
    return GatedMatch(result, fuse(expected, found)[0], False, found, leap, is_opened=True)


def _opened(result: MatchResult, way: Floats, wide: Cov) -> MatchResult:
    """Return a match that measures nothing along a direction (3,), where its covariance is wider by (3, 3)."""
    pull = result.information @ way
    known = np.outer(pull, pull) / (way @ pull) if way @ pull > 0.0 else np.zeros((3, 3))
    covariance, information = result.covariance + wide, result.information - known
    return with_fields(result, degenerate_direction=way, covariance=covariance, information=information)


def _shift(expected: UncertainPose, found: UncertainPose, prediction: Prediction) -> float:
    """Return the squared distance from where a sensor was expected, by how far it gets if it moves at once."""
    off, heading = found.pose[:2] - expected.pose[:2], expected.pose[2] - prediction.motion.pose[2]
    onward = se2.compose(np.array([0.0, 0.0, heading]), prediction.onward)[:2]
    if onward.any():  # anywhere between is as likely
        off = off - np.clip(off @ onward / (onward @ onward), 0.0, 1.0) * onward
    cov = expected.covariance[:2, :2] + found.covariance[:2, :2] + prediction.reach**2 * np.eye(2)
    return float(off @ np.linalg.solve(cov, off))


@dataclass(frozen=True, eq=False, kw_only=True)
class Matching:
    """A matcher with its configuration, as the odometry uses it."""

    matcher: Matcher  # the matcher, with its configuration
    config: OdometryConfig  # the odometry's configuration

    def prepare(self, scan: LaserScan) -> PreparedScan:
        """Return a scan ready to be matched."""
        return prepared(scan, self.matcher, "scan")

    def match(
        self, reference: PreparedScan, current: PreparedScan, origin: UncertainPose, prediction: Prediction
    ) -> GatedMatch:
        """Return a match compared with what is expected of it, the last scan being at `origin` of the reference.

        Another odometry is asked where the laser alone leaves a doubt or contradicts it: people who walk along hide the
        motion. A match that is sure and does not contradict it is the same with and without it.
        """
        motion, min_score = self.config.motion, self.config.keyframes.min_score
        expected = compose(origin, prediction.motion)
        if not (prediction.is_measured and motion.is_fused):
            return self._gated(reference, current, expected, prediction)
        repeated = compose(origin, prediction.repeated)
        alone = self._gated(reference, current, repeated, prediction)
        is_rejected = alone.is_plausible and fuse(expected, alone.measured)[1] > motion.motion_gate_chi2
        alone = alone._replace(is_prior_rejected=is_rejected, is_by_last_motion=True)
        is_sure = alone.is_fully_observed and alone.is_plausible
        if is_sure and not is_rejected:
            return alone
        guided = self._gated(reference, current, expected, prediction)
        if guided.is_opened and guided.is_accepted:
            return guided
        if is_sure:
            return guided if guided.is_plausible else alone
        return alone if alone.is_better_than(guided, min_score) else guided

    def match_around(
        self, reference: PreparedScan, current: PreparedScan, origin: UncertainPose, prediction: Prediction
    ) -> GatedMatch:
        """Return a match made from where a sensor may be that moved unseen, compared with what is expected."""
        motion = self.config.motion
        around = compose(origin, UncertainPose(prediction.motion.pose, prediction.recovery))
        result = self.matcher.match(reference.features, current.features, around)
        result = decided_by_expectation(result, around, motion)
        return gate(result, compose(origin, prediction.motion), prediction, motion)

    def _gated(
        self, reference: PreparedScan, current: PreparedScan, expected: UncertainPose, prediction: Prediction
    ) -> GatedMatch:
        """Return a match made from what is expected, compared with that."""
        motion = self.config.motion
        result = self.matcher.match(reference.features, current.features, expected)
        measured = None
        if motion.is_fused:
            result = decided_by_expectation(result, expected, motion)
            way, cov = result.degenerate_direction, expected.covariance[:2, :2]
            if way is not None and way[:2] @ cov @ way[:2] > _VAGUE_SIGMA**2 * (way[:2] @ way[:2]):
                # without a guess, where the scans do not show by themselves the place along the open direction
                is_own = not result.is_guess_decisive and _n_known(result.candidates[0]) == 3
                own = result if is_own else self.matcher.match(reference.features, current.features, None)
                measured = unguided_measurement(own)
        return gate(result, expected, prediction, motion, measured)


def as_measurement(result: MatchResult) -> UncertainPose:
    """Return the pose of a match as it may be fused: what the scans leave open is not measured at all."""
    cov = result.covariance
    if result.degenerate_direction is not None:
        # a matcher goes along there as its guess does: to count that as a measurement would count the guess twice
        cov = cov + _OPEN**2 * np.outer(result.degenerate_direction, result.degenerate_direction)
    return UncertainPose(result.pose, cov)


def unguided_measurement(result: MatchResult) -> UncertainPose | None:
    """Return what a match without a guess says along its degenerate direction too, None where it does not."""
    best = result.candidates[0] if result.ok else None
    return None if best is None or _n_known(best) < 3 else UncertainPose(best.pose, best.covariance)


def decided_by_expectation(result: MatchResult, expected: UncertainPose, config: MotionConfig) -> MatchResult:
    """Return a failed match as one of its likeliest pose where expected, unless one elsewhere is far likelier.

    Without a guess it would be one of several, or chance. Of scans in a row it is right: what moves along with a
    sensor explains them elsewhere.
    """
    if result.ok or not result.candidates or not result.score >= config.expected_score:
        return result
    best = result.candidates[0]
    for one in result.candidates:
        if (one is best or one.log_odds > max(best.log_odds - CERTAIN, 0.0)) and _lies_near(one, expected, config):
            return with_fields(
                result,
                outcome=Outcome.MATCHED,
                pose=one.pose,
                covariance=one.covariance,
                n_matched=one.n_matched,
                degenerate_direction=one.degenerate_direction,
                score=result.score * min(one.n_matched / max(best.n_matched, 1), 1.0),
                confidence=1.0 / (1.0 + odds_against(one, result.candidates, CERTAIN)),
            )
    return result


def _lies_near(one: Candidate, expected: UncertainPose, config: MotionConfig) -> bool:
    """Return whether a pose that may be right lies where it was expected."""
    direction, near, n_known = one.degenerate_direction, one.covariance, _n_known(one)
    if direction is not None and n_known < 3:
        near, n_known = near - (1.0 - _NEAR**2) * np.outer(direction, direction), n_known + 1
    return n_known == 3 and fuse(expected, UncertainPose(one.pose, near))[1] <= config.motion_gate_chi2


def odds_against(one: Candidate, candidates: Sequence[Candidate], lead: float = 0.0) -> float:
    """Return the odds that another candidate is right, of which each must be likelier by a lead, or nothing is."""
    competing = sum(math.exp(other.log_odds - lead) for other in candidates if other is not one)
    return (1.0 + competing) * math.exp(-one.log_odds)


def _n_known(best: Candidate) -> int:
    """Return along how many directions the scans measure a candidate."""
    return sum(value > _OPEN**-2 for value in eigen3(best.information)[0].tolist())
