"""The records that pass through one ``Odometry.add``, and the references that a scan is matched with."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan.matchers import PreparedScan, prepare
from curvescan.matchers.registry import Matcher, MatcherConfig
from curvescan.odometry.clock import Clock
from curvescan.odometry.config import OdometryConfig
from curvescan.odometry.deskewing import Deskewer
from curvescan.odometry.fits import Fit, fitted
from curvescan.odometry.motion import MotionModel, Wheels
from curvescan.odometry.outage import Outage
from curvescan.odometry.step import StepOutcome
from curvescan.odometry.track import Track
from curvescan.scan import LaserScan
from curvescan.types import Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class Matching:
    """A matcher with its configuration, as the odometry uses it.

    Attributes
    ----------
    method : str
        Name of the matcher.
    matcher_config : dataclass, mapping or None
        The matcher's configuration as it was given; None for its defaults.
    matcher : Matcher
        The matcher.
    config : OdometryConfig
        The odometry's configuration.
    """

    method: str
    matcher_config: MatcherConfig | None
    matcher: Matcher
    config: OdometryConfig

    def prepare(self, scan: LaserScan) -> PreparedScan:
        """Return a scan ready to be matched."""
        return prepare(scan, method=self.method, config=self.matcher_config)

    def is_reference(self, scan: PreparedScan) -> bool:
        """Return whether others can be matched with a scan."""
        return self.matcher.can_be_reference(scan.features)


class Reference(NamedTuple):
    """A scan that others are matched with, and its number."""

    scan: PreparedScan
    number: int


@dataclass(frozen=True, eq=False, kw_only=True)
class State:
    """All that an odometry remembers from scan to scan.

    Attributes
    ----------
    motion : MotionModel
        What has been learned of changes of speed and of the wheels.
    n_scans : int
        Scans so far.
    track : Track or None
        Where the last scan is; None before the first.
    as_keyframe : Track or None
        The same as it is to be taken if the last scan becomes a keyframe.
    keyframe, previous : Reference or None
        The keyframe in use, and the last scan if it can be a reference.
    clock : Clock
        The clock of the stream.
    deskewer : Deskewer
        The clock of the sweeps.
    first : LaserScan or None
        The first scan, until the second shows the velocity with which its sweep is deskewed.
    last_motion : (3,) float64
        The last motion.
    n_failed : int
        Scans without a match in a row.
    outage : Outage or None
        Doubts whether the sensor is still where it was tracked.
    """

    motion: MotionModel
    n_scans: int = 0
    track: Track | None = None
    as_keyframe: Track | None = None
    keyframe: Reference | None = None
    previous: Reference | None = None
    clock: Clock = field(default_factory=Clock)
    deskewer: Deskewer = field(default_factory=Deskewer)
    first: LaserScan | None = None
    last_motion: Pose = field(default_factory=lambda: np.zeros(3))
    n_failed: int = 0
    outage: Outage | None = None


@dataclass(frozen=True, eq=False, kw_only=True)
class Observation:
    """A scan with all that is known before it is placed.

    Attributes
    ----------
    scan : LaserScan
        As it came.
    state : State
        After the last scan.
    matching : Matching
        The matcher.
    seconds : float
        Time since the last scan.
    wheels : Wheels or None
        The motion since the last scan by the wheels.
    deskewer : Deskewer
        At the time of the scan.
    is_missed : bool
        Whether the wheels were not updated since the last scan.
    """

    scan: LaserScan
    state: State
    matching: Matching
    seconds: float
    wheels: Wheels | None
    deskewer: Deskewer
    is_missed: bool = False

    @property
    def config(self) -> OdometryConfig:
        """The odometry's configuration."""
        return self.matching.config

    @property
    def index(self) -> int:
        """Number of the scan in the stream."""
        return self.state.n_scans

    @property
    def is_wheeled(self) -> bool:
        """Whether wheels measure the whole motion."""
        return self.wheels is not None and self.wheels.is_complete

    @cached_property
    def current(self) -> PreparedScan:
        """The scan deskewed with the expected motion, and ready to be matched."""
        assert self.state.track is not None
        return self.prepared(self.motion_of(self.predicted(self.state.track)))

    def prepared(self, motion: Pose) -> PreparedScan:
        """Return the scan ready to be matched, deskewed with a motion since the last one."""
        return self.matching.prepare(self.deskewer.deskewed(self.scan, motion) if self.config.deskew else self.scan)

    def motion_of(self, track: Track) -> Pose:
        """Return the motion since the last scan of a track with its keyframe."""
        return track.speed * self.seconds

    def predicted(self, track: Track, *, by_wheels: bool = True) -> Track:
        """Return a track at the time of the scan: its speed goes on, or is what the wheels measured."""
        track = self.state.motion.accelerated(track, self.seconds)
        if by_wheels and self.wheels is not None:
            track = self.wheels.on(track, self.seconds)
        return track.moved(self.seconds)

    def fit(self, reference: Reference, before: Track, current: PreparedScan, *, by_wheels: bool = True) -> Fit:
        """Return the match of the scan with a reference, where `before` was the track at the last scan."""
        expected = self.predicted(before, by_wheels=by_wheels)
        result = self.matching.matcher.match(reference.scan.features, current.features, expected.seen)
        unknown = self.state.motion.unknown_speed
        fit = fitted(result, expected, self.config, unknown, self.seconds)
        if self.wheels is None or not by_wheels or (fit.is_accepted and not fit.is_surprising):
            return fit
        alone = fitted(result, self.predicted(before, by_wheels=False), self.config, unknown, self.seconds)
        if alone.is_accepted and not alone.is_surprising:
            return alone._replace(is_prior_rejected=True)
        return fit


class Placement(NamedTuple):
    """Where a scan is, and how that was found.

    Attributes
    ----------
    outcome : StepOutcome
        How it was found.
    track : Track
        Where it is.
    as_keyframe : Track
        The same if it becomes a keyframe.
    current : PreparedScan
        The scan as it was matched last.
    keyframe : Reference
        The keyframe in use from now on.
    motion : MotionModel
        The motion model after it.
    fit : Fit or None
        The match behind it, or that failed.
    reference : int or None
        Number of the scan it was matched with.
    n_failed : int
        Scans without a match in a row.
    outage : Outage or None
        Doubts that remain.
    is_reference : bool
        Whether the next scan may be matched with this one.
    """

    outcome: StepOutcome
    track: Track
    as_keyframe: Track
    current: PreparedScan
    keyframe: Reference
    motion: MotionModel
    fit: Fit | None = None
    reference: int | None = None
    n_failed: int = 0
    outage: Outage | None = None
    is_reference: bool = True


def step_motion(o: Observation, track: Track) -> Pose:
    """Return the motion since the last scan as the poses have it."""
    if o.state.track is None:
        return np.zeros(3)
    return se2.between(o.state.track.pose_map_scan.pose, track.pose_map_scan.pose)
