"""The records that pass through one ``Odometry.add``: keyframes, state, observation, placement."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

from curvescan.matchers import MatchResult, PreparedScan
from curvescan.odometry.config import OdometryConfig
from curvescan.odometry.measurement import Matching
from curvescan.odometry.motion_model import MotionModel, Prediction
from curvescan.odometry.step import StepOutcome
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose, between, compose
from curvescan.types import Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class Keyframe:
    """One keyframe."""

    scan: PreparedScan  # the scan, ready to be matched with
    index: int  # number of the scan in the stream
    pose_map_keyframe: UncertainPose  # its sensor in the frame of the first scan


class Localization(NamedTuple):
    """Where a scan is, relative to a keyframe."""

    keyframe: Keyframe  # the keyframe
    pose_keyframe_scan: UncertainPose  # the scan seen from it
    is_measured: bool = False  # whether a match measured all of it, with no direction left to what was expected

    @property
    def pose_map_scan(self) -> UncertainPose:
        """The scan in the frame of the first one."""
        return compose(self.keyframe.pose_map_keyframe, self.pose_keyframe_scan)

    def relative_to(self, keyframe: Keyframe) -> UncertainPose:
        """Return the same place seen from another keyframe, an earlier one or the same."""
        if keyframe is self.keyframe:
            return self.pose_keyframe_scan
        return between(keyframe.pose_map_keyframe, self.pose_map_scan)

    def as_keyframe(self, scan: PreparedScan, index: int, variance_retained: float) -> Keyframe:
        """Return a keyframe at this place; of the variance that a match measured a share is retained."""
        share = variance_retained if self.is_measured else 1.0
        here = UncertainPose(self.pose_keyframe_scan.pose, share * self.pose_keyframe_scan.covariance)
        return Keyframe(scan=scan, index=index, pose_map_keyframe=compose(self.keyframe.pose_map_keyframe, here))


class Gap(NamedTuple):
    """Scans since the last one that was placed by a match with what was known before."""

    # the references from before the gap: the last scan and the keyframe in use, where they can be; else the one before
    before: tuple[Keyframe, ...]
    n_scans: int  # the scan that nothing showed surely, and those since that match the one before them
    log_odds: float = 0.0  # that the sensor is still near, by the matches since


class State(NamedTuple):
    """All that an odometry remembers from scan to scan."""

    motion: MotionModel  # what is expected of the next scan
    n_scans: int = 0  # scans so far
    localization: Localization | None = None  # where the last scan is; None before the first
    previous: PreparedScan | None = None  # the last scan, if it can be a reference
    older: Keyframe | None = None  # the keyframe that was in use before the one in use
    # the first scan, until the second shows the velocity with which its sweep is deskewed
    first: LaserScan | None = None
    gap: Gap | None = None  # a failure that no match has bridged yet
    score: float = math.nan  # of the match that placed the last scan; NaN where none did


@dataclass(frozen=True, eq=False, kw_only=True)
class Observation:
    """A scan with all that is known before it is placed."""

    scan: LaserScan  # as it came
    prediction: Prediction  # what is expected of it
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
        return self.prepared(self.prediction.motion.pose)

    @property
    def is_deskewed(self) -> bool:
        """Whether the motion during the sweep is taken out."""
        return self.config.deskew and self.scan.time_increment != 0.0

    def is_bent(self, expected: Pose, found: Pose) -> bool:
        """Return whether the sweep comes out otherwise by a motion since the last scan than by the expected one."""
        return self.is_deskewed and self.prediction.deskewer.is_worth_again(self.scan, expected, found)

    def prepared(self, motion: Pose) -> PreparedScan:
        """Return the scan ready to be matched, deskewed with a motion since the last one."""
        sweep = self.prediction.deskewer.deskewed(self.scan, motion) if self.is_deskewed else self.scan
        return self.matching.prepare(sweep)


class Placement(NamedTuple):
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
