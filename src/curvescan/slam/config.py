"""The parameters of SLAM: one set for all logs."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from curvescan.configs import require_parts
from curvescan.errors import require
from curvescan.odometry.config import OdometryConfig
from curvescan.types import Cov, Pose, UncertainPose

GATE = 16.0
"""Squared Mahalanobis distance up to which two estimates may be of one pose: chi-square of 3 variables, 99.9 %."""

ANYWHERE_M = 10.0
"""Standard deviation of where a slip leads, and of where matches of other places lie, metres."""

KEPT = OdometryConfig().keyframes.variance_retained
"""Share of the variance of a match that belongs to the edge; the rest is common to all edges of a keyframe."""


@dataclass(frozen=True, kw_only=True)
class MapKeyframesConfig:
    """Keyframes: the scans that the map is made of."""

    distance: float = 0.5
    """A new keyframe is due this far from the last one, metres."""
    turn: float = 0.5
    """A new keyframe is due when the sensor has turned by this much, radians."""
    n_lost: int = 8
    """Scans in a row that nothing places, after which a localizer looks for the sensor anew."""

    def __post_init__(self) -> None:
        _require_positive(self, "distance", "turn", "n_lost")

    def is_far(self, motion: Pose, share: float = 1.0) -> bool:
        """Return whether a motion, (3,), is as long as makes a new keyframe due, or a share of it."""
        x, y, theta = motion.tolist()
        return math.hypot(x, y) >= share * self.distance or abs(theta) >= share * self.turn


@dataclass(frozen=True, kw_only=True)
class PlacesConfig:
    """Places: how many keyframes one holds. The oldest go, so that memory follows the area and not the time."""

    n_keyframes: int = 4
    """Newer keyframes of the same place from which on an older one goes."""
    radius: float = 0.4
    """Keyframes this near to each other, metres and radians, show the same place."""

    def __post_init__(self) -> None:
        _require_positive(self, "radius", "n_keyframes")


@dataclass(frozen=True, kw_only=True)
class NoiseConfig:
    """Noise: what the covariances of matches and motions leave out."""

    floor_m: float = 0.005
    """Error of a match besides its covariance, metres and axis."""
    floor_rad: float = 0.002
    """The same of its rotation, radians."""
    slip: float = 0.05
    """The odometry slips by this share of the way since a match of keyframes last measured all of the motion; with
    wheels by that which matches have found."""

    def __post_init__(self) -> None:
        _require_positive(self, "floor_m", "floor_rad", "slip")

    @cached_property
    def floor(self) -> Cov:
        """(3, 3) covariance that each match has besides its own."""
        return np.diag(np.square([self.floor_m, self.floor_m, self.floor_rad]))

    @cached_property
    def spread(self) -> Cov:
        """(3, 3) covariance that the difference of two estimates of one pose has besides theirs."""
        return 4.0 * self.floor

    def slipped(self, motion: UncertainPose, way: float, n_unseen: int, wheel_slip: float = math.nan) -> UncertainPose:
        """Return a motion of the odometry with what it may slip; way: metres since a match measured all of it.

        Slips go on: their standard deviation grows with the way and not with its root, and that of a turn which no
        match of keyframes saw with the scans in between, n_unseen.
        """
        step, cov = float(np.hypot(motion.pose[0], motion.pose[1])), motion.covariance + self.floor
        slip = wheel_slip if math.isfinite(wheel_slip) else self.slip
        variance = slip**2 * step * (2.0 * way + step)
        turn = n_unseen / cov[2, 2] * np.outer(cov[2], cov[2])
        return UncertainPose(motion.pose, cov + turn + np.diag([variance, variance, 0.0]))

    def doubled(self, pose: UncertainPose) -> UncertainPose:
        """Return a pose of twice its standard deviations and the floor's: motions in a row err together."""
        return UncertainPose(pose.pose, 4.0 * (pose.covariance + self.floor))

    def edge(self, covariance: Cov) -> Cov:
        """Return the covariance of an edge by that of its match."""
        return KEPT * covariance + self.floor


@dataclass(frozen=True, kw_only=True)
class ClosuresConfig:
    """Loop closures: where they are searched, and which are accepted."""

    reach: float = 2.5
    """Keyframes farther from each other than this are matched only where the graph knows their relative pose, metres:
    up to 6 m, where what they see should overlap."""
    certain_m: float = 0.8
    """Where the graph knows the relative pose of two keyframes better than this, metres, it guides their match."""
    min_overlap: float = 0.4
    """Least share of two scans that must be common for them to be matched, predicted from where the graph has them."""
    matches_per_scan: int = 3
    """Matches made for each scan that is added; the rest waits."""
    log_odds: float = 8.0
    """Least log odds of a set of closures that agree: of its matches, where the graph has it, less what contradicts."""

    def __post_init__(self) -> None:
        _require_positive(self, "reach", "certain_m", "log_odds", "matches_per_scan")
        require(0.0 <= self.min_overlap <= 1.0, "min_overlap must lie in [0, 1]", self.min_overlap)


@dataclass(frozen=True, kw_only=True)
class SlamConfig:
    """The whole of it."""

    keyframes: MapKeyframesConfig = field(default_factory=MapKeyframesConfig)
    """Keyframes: the scans that the map is made of."""
    places: PlacesConfig = field(default_factory=PlacesConfig)
    """Places: how many keyframes one holds."""
    noise: NoiseConfig = field(default_factory=NoiseConfig)
    """Noise: what the covariances of matches and motions leave out."""
    closures: ClosuresConfig = field(default_factory=ClosuresConfig)
    """Loop closures: where they are searched, and which are accepted."""
    odometry: OdometryConfig = field(default_factory=OdometryConfig)
    """The odometry in front."""

    def __post_init__(self) -> None:
        require_parts(self)


def _require_positive(config: object, *names: str) -> None:
    for name in names:
        value, is_count = getattr(config, name), isinstance(getattr(type(config), name), int)
        require(value >= 1 if is_count else value > 0.0, f"{name} must be {'at least 1' if is_count else '> 0'}", value)
