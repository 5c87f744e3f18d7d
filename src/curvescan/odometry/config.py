"""What can be set about the odometry."""

from __future__ import annotations

from dataclasses import dataclass, field

from curvescan.errors import require
from curvescan.matchers import DEFAULT_METHOD


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

    def __post_init__(self) -> None:
        for name in ("distance", "turn"):
            require(getattr(self, name) >= 0.0, f"{name} must be >= 0", getattr(self, name))
        require(0.0 <= self.min_score <= 1.0, "min_score must lie in [0, 1]", self.min_score)
        require(0.0 < self.variance_retained <= 1.0, "variance_retained must lie in (0, 1]", self.variance_retained)


@dataclass(frozen=True, kw_only=True)
class MotionConfig:
    """Motion: what is expected of the next scan before it is matched, and how well that is known."""

    speed_change: float = 0.5
    """How much the speed is taken to change within a second before any change has been seen, m/s and axis."""
    turn_change: float = 1.0
    """How much the rate of turn is taken to change within a second before any change has been seen, rad/s."""
    memory: float = 20.0
    """Changes of speed and errors of the wheels are averaged over about this many steps."""
    gate_chi2: float = 20.0
    """A match this far from the prediction is not accepted unless it is sure: squared Mahalanobis distance."""
    max_speed: float = 2.0
    """Greatest speed of a sensor that nothing tracks, m/s and rad/s: it bounds how far it may be after an outage."""
    wheel_share: float = 0.1
    """Wheel odometry errs by this share of the distance driven."""
    wheel_turn_share: float = 0.25
    """Wheel odometry errs by this share of the angle turned: mostly for want of a common clock with the laser."""
    wheel_drift: float = 0.1
    """Wheel odometry turns by this much by itself, radians for each metre driven."""
    wheel_floor_m: float = 0.003
    """Wheel odometry errs by this much at the least, metres a step."""
    wheel_floor_rad: float = 0.003
    """Wheel odometry errs by this much at the least, radians a step."""

    def __post_init__(self) -> None:
        for name in ("speed_change", "turn_change", "gate_chi2", "max_speed", "wheel_floor_m", "wheel_floor_rad"):
            require(getattr(self, name) > 0.0, f"{name} must be > 0", getattr(self, name))
        for name in ("wheel_share", "wheel_turn_share", "wheel_drift"):
            require(getattr(self, name) >= 0.0, f"{name} must be >= 0", getattr(self, name))
        require(self.memory >= 1.0, "memory must be at least 1 step", self.memory)


@dataclass(frozen=True, kw_only=True)
class OdometryConfig:
    """All settings of the odometry."""

    keyframes: KeyframesConfig = field(default_factory=KeyframesConfig)
    """Keyframes: how long one is kept."""
    motion: MotionConfig = field(default_factory=MotionConfig)
    """Motion: what is expected of the next scan before it is matched."""
    deskew: bool = True
    """Where a scan gives the times of its beams, the motion during the sweep is taken out of it."""
    is_filtered: bool = True
    """The expected motion takes part in each pose, weighed by the covariances, and a lost track is noticed; else the
    matches alone decide."""

    @classmethod
    def scan_to_scan(cls) -> OdometryConfig:
        """Return the plain chain of eq. 1: each scan matched with the one before it, and nothing else."""
        keyframes = KeyframesConfig(distance=0.0, turn=0.0, variance_retained=1.0)
        return cls(keyframes=keyframes, is_filtered=False)

    @classmethod
    def of_method(cls, method: str) -> OdometryConfig:
        """Return the configuration that suits a matcher: scan to scan for all but the default one."""
        return cls() if cls.keys_suit(method) else cls.scan_to_scan()

    @staticmethod
    def keys_suit(method: str) -> bool:
        """Return whether a matcher is fit for keyframes: the default one alone.

        Keyframes need a matcher that finds its way from far and says how sure it is.
        """
        return method == DEFAULT_METHOD
