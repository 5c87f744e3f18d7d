"""The records that pass through one ``Odometry.add``: state, observation, placement."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

from curvescan.matchers import MatchResult, PreparedScan, prepare
from curvescan.matchers.registry import Matcher, MatcherConfig
from curvescan.odometry.config import OdometryConfig
from curvescan.odometry.deskewing import Deskewer
from curvescan.odometry.gating import GatedMatch, gate
from curvescan.odometry.keyframes import Keyframe, Localization
from curvescan.odometry.measurement import (
    decided_by_expectation,
    has_unguided_pose,
    is_vague_along,
    unguided_measurement,
)
from curvescan.odometry.motion_model import MotionModel, Prediction
from curvescan.odometry.step import StepOutcome
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose, compose, identity
from curvescan.types import Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class Matching:
    """A matcher with its configuration, as the odometry uses it."""

    method: str  # name of the matcher
    matcher_config: MatcherConfig | None  # the matcher's configuration as it was given; None for its defaults
    matcher: Matcher  # the matcher
    config: OdometryConfig  # the odometry's configuration

    def prepare(self, scan: LaserScan) -> PreparedScan:
        """Return a scan ready to be matched."""
        return prepare(scan, method=self.method, config=self.matcher_config)

    def match(
        self, reference: PreparedScan, current: PreparedScan, origin: UncertainPose, prediction: Prediction
    ) -> GatedMatch:
        """Return a match compared with what is expected of it, the last scan being at `origin` of the reference.

        Another odometry is asked where the laser alone leaves a doubt: where the match fails, contradicts the last
        motion or leaves a direction open, or where the guess decided it and the other odometry contradicts it. A match
        that is sure is the same with and without it.
        """
        motion, min_score = self.config.motion, self.config.keyframes.min_score
        expected = compose(origin, prediction.motion)
        if not (prediction.is_measured and motion.is_fused):
            return self._gated(reference, current, expected)
        repeated = compose(origin, prediction.repeated)
        alone = self._gated(reference, current, repeated).made_without(expected, motion)
        is_sure = alone.is_fully_observed and alone.is_plausible
        if is_sure and not (alone.is_prior_rejected and alone.result.is_guess_decisive):
            return alone
        guided = self._gated(reference, current, expected, repeated)
        if is_sure:
            # only the guess decided it: another one that is expected, too, must explain more
            is_better = guided.is_better_than(alone, 1.0) and not guided.is_prior_rejected
            return guided if is_better else alone
        return alone if alone.is_better_than(guided, min_score) else guided

    def _gated(
        self,
        reference: PreparedScan,
        current: PreparedScan,
        expected: UncertainPose,
        repeated: UncertainPose | None = None,
    ) -> GatedMatch:
        """Return a match made from what is expected, compared with that or, where given, the last motion repeated."""
        motion = self.config.motion
        result = self.matcher.match(reference.features, current.features, expected)
        measured = None
        if motion.is_fused:
            result = decided_by_expectation(result, expected, motion)
            if result.ok and is_vague_along(expected, result):
                measured = self._unguided(reference, current, result)
        return gate(result, expected, motion, repeated, measured)

    def _unguided(self, reference: PreparedScan, current: PreparedScan, result: MatchResult) -> UncertainPose | None:
        """Return what two scans say without a guess, whose match with one leaves a direction open."""
        if not has_unguided_pose(result):
            result = self.matcher.match(reference.features, current.features, None)
        return unguided_measurement(result)

    def as_reference(self, scan: PreparedScan) -> PreparedScan | None:
        """Return a scan that others can be matched with, else None."""
        return scan if self.matcher.can_be_reference(scan.features) else None


@dataclass(frozen=True, eq=False, kw_only=True)
class Gap:
    """Scans since the last one that was placed by a match with what was known before."""

    # the references from before the gap: the last scan, where it can be one, and the keyframe that was in use
    before: tuple[Keyframe, ...]
    n_scans: int  # scans in the gap that have readings enough to be matched
    first: int  # number of the first scan in the gap
    log_odds: float = 0.0  # that the sensor is still near, by the matches since


@dataclass(frozen=True, eq=False, kw_only=True)
class State:
    """All that an odometry remembers from scan to scan."""

    motion: MotionModel  # what is expected of the next scan
    n_scans: int = 0  # scans so far
    localization: Localization | None = None  # where the last scan is; None before the first
    previous: PreparedScan | None = None  # the last scan, if it can be a reference
    older: Keyframe | None = None  # the keyframe that was in use before the one in use
    deskewer: Deskewer = field(default_factory=Deskewer)  # the clock of the sweeps
    # the first scan, until the second shows the velocity with which its sweep is deskewed
    first: LaserScan | None = None
    gap: Gap | None = None  # a failure that no match has bridged yet
    score: float = math.nan  # of the match that placed the last scan; NaN where none did


@dataclass(frozen=True, eq=False, kw_only=True)
class Attempt:
    """The better of the matches with the keyframe in use and with the previous scan."""

    last: Localization  # where the previous scan is
    gated: GatedMatch  # the match
    outcome: StepOutcome  # MATCHED with the keyframe, CHAINED with the previous scan
    reference: PreparedScan  # the one it was matched with
    origin: UncertainPose  # the last scan seen from it


@dataclass(frozen=True, eq=False, kw_only=True)
class Observation:
    """A scan with all that is known before it is placed."""

    scan: LaserScan  # as it came
    prediction: Prediction  # what is expected of it
    deskewer: Deskewer  # at the time of the scan
    state: State  # after the last scan
    matching: Matching  # the matcher

    @property
    def config(self) -> OdometryConfig:
        """The odometry's configuration."""
        return self.matching.config

    @property
    def index(self) -> int:
        """Number of the scan in the stream."""
        return self.state.n_scans

    @cached_property
    def current(self) -> PreparedScan:
        """The scan deskewed with the expected motion, and ready to be matched."""
        return self.prepared(self.expected.pose)

    def prepared(self, motion: Pose) -> PreparedScan:
        """Return the scan ready to be matched, deskewed with a motion since the last one."""
        is_deskewed = self.config.deskew
        return self.matching.prepare(self.deskewer.deskewed(self.scan, motion) if is_deskewed else self.scan)

    @property
    def expected(self) -> UncertainPose:
        """The expected motion since the last scan."""
        return self.prediction.motion


@dataclass(frozen=True, eq=False, kw_only=True)
class Placement:
    """Where a scan is, how that was found, and what is to be remembered of it."""

    outcome: StepOutcome  # how it was found
    localization: Localization  # where it is
    current: PreparedScan  # the scan as it was matched last
    motion: MotionModel  # the motion model after it
    step_motion: UncertainPose  # the scan seen from the previous one, without any leap
    gap: Gap | None = None  # a failure that is not bridged yet
    match: MatchResult | None = None  # the match behind it
    is_prior_rejected: bool = False  # whether another odometry was left out because the match contradicts it
    reference: int | None = None  # number of the scan it was matched with
    is_reference: bool = True  # whether the next scan may be matched with this one


def try_references(observation: Observation, last: Localization) -> Attempt:
    """Return the match with the keyframe in use or, where that leaves doubt and it does better, the previous scan."""
    matching, previous = observation.matching, observation.state.previous
    current, prediction = observation.current, observation.prediction
    min_score = matching.config.keyframes.min_score
    attempt = Attempt(
        last=last,
        gated=matching.match(last.keyframe.scan, current, last.pose_keyframe_scan, prediction),
        outcome=StepOutcome.MATCHED,
        reference=last.keyframe.scan,
        origin=last.pose_keyframe_scan,
    )
    if previous is None or previous is attempt.reference or attempt.gated.is_confident(min_score):
        return attempt
    second = matching.match(previous, current, identity(), prediction)
    if not second.is_better_than(attempt.gated, min_score):
        return attempt
    return Attempt(last=last, gated=second, outcome=StepOutcome.CHAINED, reference=previous, origin=identity())
