"""What can be set about the odometry."""

from __future__ import annotations

from dataclasses import dataclass, field

from curvescan.configs import require_parts
from curvescan.errors import require
from curvescan.matchers import DEFAULT_METHOD

MATCHER_HINT = "the configuration of the matcher is given as matcher="


@dataclass(frozen=True, kw_only=True)
class KeyframesConfig:
    """Keyframes: how long one is kept."""

    distance: float = 0.8
    """A new keyframe is due this far from the one in use, metres; 0 makes each scan one."""
    turn: float = 0.5
    """A new keyframe is due when the sensor has turned by this much, radians; 0 makes each scan one."""
    min_score: float = 0.4
    """A new keyframe is due when the match with the one in use has a lower score, in [0, 1]."""
    variance_retained: float = 0.4
    """Share of the variance of a match that stays when the scan becomes a keyframe: the rest cancels along the chain,
    for a keyframe's noise moves the scan before it and the one after it opposite ways. Measured in simulation."""
    max_gap: int = 3
    """Scans after one without a sure match that match each other; if they do not show what was in use before it, the
    track is lost and starts anew. 0: never."""

    def __post_init__(self) -> None:
        for name in ("distance", "turn"):
            require(getattr(self, name) >= 0.0, f"{name} must be >= 0", getattr(self, name))
        require(0.0 <= self.min_score <= 1.0, "min_score must lie in [0, 1]", self.min_score)
        require(self.max_gap >= 0, "max_gap must be >= 0", self.max_gap)
        require(0.0 < self.variance_retained <= 1.0, "variance_retained must lie in (0, 1]", self.variance_retained)


@dataclass(frozen=True, kw_only=True)
class MotionConfig:
    """Motion: what is expected of the next scan before it is matched, and how well that is known."""

    sigma_m: float = 0.1
    """How much the motion is taken to change from a step to the next before any has been seen: metres an axis, and as
    many radians."""
    least_sigma_m: float = 0.02
    """What is seen of such changes replaces `sigma_m`, but never goes below this: metres an axis, and as many
    radians."""
    memory: float = 20.0
    """Changes are averaged over about this many steps."""
    is_fused: bool = True
    """The expected motion takes part in each pose, weighed by the covariances; else the matches alone decide."""
    recovery_sigma_m: float = 0.5
    """How far the sensor may be from where it was expected once a match failed or contradicts, metres and axis: so far
    half a second after the last match and later, before that in proportion, and the expected motion besides."""
    recovery_sigma_rad: float = 1.0
    """The same of its direction, radians."""
    max_repeats: int = 5
    """Failures in a row after which the last motion is no longer repeated and the pose is held."""
    wheel_share: float = 0.1
    """Wheel odometry errs by this share of the distance driven, and turns by itself by as many radians a metre."""
    wheel_turn_share: float = 0.25
    """Wheel odometry errs by this share of the angle turned: mostly for want of a common clock with the laser."""
    wheel_slip: float = 0.03
    """Wheels slip by this share of the way, to begin with: what matches tell of it takes its place."""
    motion_gate_chi2: float = 20.0
    """A match this far from the prediction is not accepted alone: squared Mahalanobis distance."""
    expected_score: float = 0.3
    """A match that would be in doubt without a guess counts where it is expected from this score on, in [0, 1]: of
    scans of places that share nothing less than 1 in 1,000 reach it there, of scans a metre apart nearly all."""

    def __post_init__(self) -> None:
        for name in ("least_sigma_m", "recovery_sigma_m", "recovery_sigma_rad", "wheel_slip", "motion_gate_chi2"):
            require(getattr(self, name) > 0.0, f"{name} must be > 0", getattr(self, name))
        for name in ("wheel_share", "wheel_turn_share"):
            require(getattr(self, name) >= 0.0, f"{name} must be >= 0", getattr(self, name))
        require(self.sigma_m >= self.least_sigma_m, "sigma_m must not be less than least_sigma_m", self.sigma_m)
        require(self.memory >= 1.0, "memory must be at least 1 step", self.memory)
        require(self.max_repeats >= 0, "max_repeats must be >= 0", self.max_repeats)


@dataclass(frozen=True, kw_only=True)
class OdometryConfig:
    """The whole of it."""

    keyframes: KeyframesConfig = field(default_factory=KeyframesConfig)
    """Keyframes: how long one is kept."""
    motion: MotionConfig = field(default_factory=MotionConfig)
    """Motion: what is expected of the next scan before it is matched."""

    deskew: bool = True
    """Where a scan gives the times of its beams, the motion during the sweep is taken out of it."""

    def __post_init__(self) -> None:
        require_parts(self)

    @classmethod
    def scan_to_scan(cls) -> OdometryConfig:
        """Return the plain chain of eq. 1: each scan matched with the one before it, and nothing else."""
        return cls(
            keyframes=KeyframesConfig(distance=0.0, turn=0.0, max_gap=0, variance_retained=1.0),
            motion=MotionConfig(is_fused=False),
        )

    @classmethod
    def of_method(cls, method: str) -> OdometryConfig:
        """Return the configuration that suits a matcher: scan to scan for all but the default one."""
        # which finds its way from far and says how sure it is, as keyframes need
        return cls() if method == DEFAULT_METHOD else cls.scan_to_scan()
