"""What can be set about the odometry."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from curvescan.errors import require
from curvescan.matchers import DEFAULT_METHOD
from curvescan.types import Cov


@dataclass(frozen=True, kw_only=True)
class KeyframesConfig:
    """Keyframes: how long one is kept, and how earlier ones are come back to."""

    distance: float = 0.8
    """A new keyframe is due this far from the one in use, metres; 0 makes each scan one."""
    turn: float = 0.5
    """A new keyframe is due when the sensor has turned by this much, radians; 0 makes each scan one."""
    min_score: float = 0.4
    """A new keyframe is due when the match with the one in use has a lower score, in [0, 1]."""
    max_keyframes: int = 2000
    """Keyframes held in memory; beyond it the one not used for longest is forgotten. 1: no earlier one is come back to."""
    least_score: float = 0.25
    """A match far from where it was expected is rejected below this score, in [0, 1]; nor, after a failure, are two with
    earlier keyframes that agree."""
    variance_retained: float = 0.4
    """Share of the variance of a match that stays when the scan becomes a keyframe: the rest cancels along the chain,
    for a keyframe's noise moves the scan before it and the one after it opposite ways. Measured in simulation."""
    max_searches: int = 20
    """After a failure, scans for which earlier keyframes are searched at once, and not only when one is left behind."""
    max_gap: int = 3
    """Scans in a row that the expected motion may carry; if then still none matches what was known before the failure,
    the track is lost and starts anew. 0: never."""
    max_tries: int = 3
    """Earlier keyframes tried for a scan, at most."""
    closes_loops: bool = True
    """Whether they are tried also for scans that match the keyframe in use; else only after a failure. SLAM leaves loops to its graph."""
    drift: float = 2.0
    """Standard deviations of the chain are taken to be this many times too small when deciding whether two places
    are the same: matches that follow each other err together."""
    drift_floor_m: float = 0.03
    """Error of the chain that is added for the same question, metres."""
    drift_floor_rad: float = 0.01
    """Error of the chain that is added for the same question, radians."""
    max_reach: float = 2.5
    """An earlier keyframe is tried if it may lie this near, metres."""
    confident_score: float = 0.45
    """Least score of a match with an earlier keyframe, in [0, 1], unless the sensor is lost."""
    closure_gate_chi2: float = 16.0
    """Two estimates may be of one place up to this squared Mahalanobis distance: 99.9 % of those that are."""
    agreeing_gate_chi2: float = 8.0
    """The same for two matches that agree and score less than `confident_score`: 95 % of those that are."""
    disputed_gate_chi2: float = 40.0
    """Beyond `closure_gate_chi2` and up to this, places that ask for one correction are counted: see `min_disputes`."""
    disputed_confidence: float = 0.9
    """Least confidence of a match that counts against the chain."""
    min_disputes: int = 3
    """So many places, two earlier keyframes at each, that ask for the same correction beat the chain."""
    certain_m: float = 0.1
    """Where the chain knows the place of an earlier keyframe better than this, metres, one match is enough; else two
    earlier keyframes must agree."""
    certain_rad: float = 0.05
    """The same for its direction, radians."""

    def __post_init__(self) -> None:
        for name in ("distance", "turn", "drift_floor_m", "drift_floor_rad", "max_reach"):
            require(getattr(self, name) >= 0.0, f"{name} must be >= 0", getattr(self, name))
        for name in ("min_score", "least_score", "confident_score", "disputed_confidence"):
            score = getattr(self, name)
            require(0.0 <= score <= 1.0, f"{name} must lie in [0, 1]", score)
        require(self.max_keyframes >= 1, "max_keyframes must be at least 1", self.max_keyframes)
        for name in ("max_searches", "max_gap", "max_tries"):
            require(getattr(self, name) >= 0, f"{name} must be >= 0", getattr(self, name))
        require(0.0 < self.variance_retained <= 1.0, "kept must lie in (0, 1]", self.variance_retained)
        require(self.drift >= 1.0, "drift must be at least 1", self.drift)
        require(self.min_disputes >= 1, "min_disputes must be at least 1", self.min_disputes)
        for name in ("closure_gate_chi2", "agreeing_gate_chi2", "disputed_gate_chi2", "certain_m", "certain_rad"):
            require(getattr(self, name) > 0.0, f"{name} must be > 0", getattr(self, name))


@dataclass(frozen=True, kw_only=True)
class MotionConfig:
    """Motion: what is expected of the next scan before it is matched, and how well that is known."""

    sigma_m: float = 0.1
    """How much the motion is taken to change from a step to the next before any has been seen, metres and axis."""
    sigma_rad: float = 0.1
    """The same of its turn, radians."""
    least_sigma_m: float = 0.02
    """What is seen of such changes replaces the two above, but never goes below this, metres."""
    least_sigma_rad: float = 0.02
    """The same of its turn, radians."""
    memory: float = 20.0
    """Changes are averaged over about this many steps."""
    is_fused: bool = True
    """The expected motion takes part in each pose, weighed by the covariances; else the matches alone decide."""
    recovery_sigma_m: float = 0.5
    """How far the sensor may be from where it was expected once a match failed or contradicts, metres and axis."""
    recovery_sigma_rad: float = 1.0
    """The same of its direction, radians."""
    max_repeats: int = 5
    """Failures in a row after which the last motion is no longer repeated and the pose is held."""
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
    motion_gate_chi2: float = 20.0
    """A match this far from the prediction is not accepted alone: squared Mahalanobis distance."""
    expected_score: float = 0.3
    """A match that would be in doubt without a guess counts where it is expected from this score on, in [0, 1]: of scans of
    places that share nothing less than 1 in 1,000 reach it there, of scans a metre apart nearly all."""

    def __post_init__(self) -> None:
        sigmas = ("least_sigma_m", "least_sigma_rad", "recovery_sigma_m", "recovery_sigma_rad")
        for name in (*sigmas, "wheel_floor_m", "wheel_floor_rad", "motion_gate_chi2"):
            require(getattr(self, name) > 0.0, f"{name} must be > 0", getattr(self, name))
        for name in ("wheel_share", "wheel_turn_share", "wheel_drift"):
            require(getattr(self, name) >= 0.0, f"{name} must be >= 0", getattr(self, name))
        require(
            self.sigma_m >= self.least_sigma_m and self.sigma_rad >= self.least_sigma_rad,
            "sigma_m and sigma_rad must not be less than least_sigma_m and least_sigma_rad",
            (self.sigma_m, self.sigma_rad),
        )
        require(self.memory >= 1.0, "memory must be at least 1 step", self.memory)
        require(self.max_repeats >= 0, "max_repeats must be >= 0", self.max_repeats)

    @property
    def recovery_covariance(self) -> Cov:
        """(3, 3) covariance of where the sensor is once a match failed or contradicts what was expected."""
        sigmas = np.array([self.recovery_sigma_m, self.recovery_sigma_m, self.recovery_sigma_rad])
        return np.diag(sigmas**2)


@dataclass(frozen=True, kw_only=True)
class OdometryConfig:
    """The whole of it."""

    keyframes: KeyframesConfig = field(default_factory=KeyframesConfig)
    """Keyframes: how long one is kept, and how earlier ones are come back to."""
    motion: MotionConfig = field(default_factory=MotionConfig)
    """Motion: what is expected of the next scan before it is matched."""

    deskew: bool = True
    """Where a scan gives the times of its beams, the motion during the sweep is taken out of it."""

    @classmethod
    def scan_to_scan(cls) -> OdometryConfig:
        """Return the plain chain of eq. 1: each scan matched with the one before it, and nothing else."""
        return cls(
            keyframes=KeyframesConfig(
                distance=0.0, turn=0.0, max_keyframes=1, max_gap=0, max_tries=0, variance_retained=1.0
            ),
            motion=MotionConfig(is_fused=False),
        )

    @classmethod
    def of_method(cls, method: str) -> OdometryConfig:
        """Return the configuration that suits a matcher: scan to scan for all but the default one."""
        return cls() if cls.keys_suit(method) else cls.scan_to_scan()

    @staticmethod
    def keys_suit(method: str) -> bool:
        """Return whether a matcher is fit for keyframes: the default one alone.

        Keyframes and returns to earlier ones need a matcher that finds its way from far and says how sure it is.
        """
        return method == DEFAULT_METHOD
