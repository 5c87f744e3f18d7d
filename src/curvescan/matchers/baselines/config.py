"""The parameters of the five methods: each with its unit, and where its value comes from.

*Measured* means tuned on simulated offices (pairs 0.1 m and 5 degrees to 0.6 m and 40 degrees apart, with and
without people), on other seeds than those the results are reported for.
"""

import math
from dataclasses import dataclass, field

from curvescan.errors import require


@dataclass(frozen=True, kw_only=True)
class ConvergenceConfig:
    """When an iterated method stops."""

    max_iterations: int = 80
    """Iterations after which a method that still moves has not converged."""
    min_translation: float = 2e-4
    """An iteration that moves less, metres, and turns less than min_rotation is the last."""
    min_rotation: float = 1e-4
    """An iteration that turns less, radians, and moves less than min_translation is the last."""

    def __post_init__(self) -> None:
        require(self.max_iterations >= 1, "max_iterations must be at least 1", self.max_iterations)
        require(self.min_translation > 0.0, "min_translation must be > 0 m", self.min_translation)
        require(self.min_rotation > 0.0, "min_rotation must be > 0 rad", self.min_rotation)


@dataclass(frozen=True, kw_only=True)
class ShrinkConfig:
    """A limit that shrinks exponentially from one value to another, iteration by iteration."""

    first: float
    """Limit of the first iteration."""
    last: float
    """Lowest limit."""
    decay: float
    """The limit of iteration t is first * exp(-decay * t)."""

    def __post_init__(self) -> None:
        require(0.0 < self.last <= self.first, "limits must satisfy 0 < last <= first", (self.last, self.first))
        require(self.decay > 0.0, "decay must be > 0", self.decay)

    def at(self, iteration: float) -> float:
        """Return the limit of an iteration, from 0; inf: the last."""
        return max(self.first * math.exp(-self.decay * iteration), self.last)

    @property
    def n_shrinking(self) -> int:
        """Iterations until the limit has reached its last value."""
        return math.ceil(math.log(self.first / self.last) / self.decay)


@dataclass(frozen=True, kw_only=True)
class LinesConfig:
    """Split-and-merge line extraction."""

    max_error: float = 0.04
    """A line is split where a reading lies farther from it, metres: four times the noise of an LMS200."""
    min_readings: int = 4
    """Least number of readings of a line; at least 3."""
    min_length: float = 0.1
    """Least length of a line, metres."""

    def __post_init__(self) -> None:
        require(self.max_error > 0.0, "max_error must be > 0 m", self.max_error)
        require(self.min_readings >= 3, "min_readings must be at least 3", self.min_readings)
        require(self.min_length > 0.0, "min_length must be > 0 m", self.min_length)


@dataclass(frozen=True, kw_only=True)
class IdcConfig:
    """Iterative dual correspondence (Lu and Milios 1997)."""

    convergence: ConvergenceConfig = field(default_factory=ConvergenceConfig)
    """When the iteration stops."""
    window: ShrinkConfig = field(
        default_factory=lambda: ShrinkConfig(first=math.radians(60.0), last=math.radians(2.0), decay=0.2)
    )
    """Half width of the rotation window B(t) = B(0) exp(-alpha t), radians. Measured."""
    gate: ShrinkConfig = field(default_factory=lambda: ShrinkConfig(first=4.0, last=0.15, decay=0.15))
    """Greatest distance of a pair, metres. Measured."""
    kept_share: float = 0.9
    """Share of the pairs that take part, closest first, in (0, 1]; the others count as outliers."""
    median_readings: int = 3
    """Width of the median filter in readings, odd; 1 for none. Gutmann's is 5, which rounds corners."""
    min_share: float = 0.3
    """Least share of the current readings that must take part, in (0, 1]."""

    def __post_init__(self) -> None:
        require(self.window.first <= math.pi, "window must be <= pi rad", self.window.first)
        require_share(self.kept_share, "kept_share")
        require_share(self.min_share, "min_share")
        require_odd(self.median_readings, "median_readings")


@dataclass(frozen=True, kw_only=True)
class CoxConfig:
    """Points to lines (Cox 1991)."""

    convergence: ConvergenceConfig = field(default_factory=ConvergenceConfig)
    """When the iteration stops."""
    lines: LinesConfig = field(default_factory=LinesConfig)
    """How lines are found in the reference."""
    gate: ShrinkConfig = field(default_factory=lambda: ShrinkConfig(first=2.0, last=0.05, decay=0.1))
    """Greatest distance of a point from its line, metres. Measured."""
    median_readings: int = 1
    """Width of the median filter in readings, odd; 1 for none. Gutmann's is 5, which rounds corners."""
    has_projection_filter: bool = False
    """Whether readings that the other viewpoint cannot see are left out."""
    min_share: float = 0.2
    """Least share of the current readings that must take part, in (0, 1]."""

    def __post_init__(self) -> None:
        require_share(self.min_share, "min_share")
        require_odd(self.median_readings, "median_readings")


@dataclass(frozen=True, kw_only=True)
class HistogramConfig:
    """Angle, x and y histograms (Weiss and v. Puttkamer 1995)."""

    lines: LinesConfig = field(default_factory=LinesConfig)
    """How lines are found; readings on no line are left out."""
    angle_bins: int = 360
    """Bins of the angle histogram, over the full circle."""
    max_rotation: float = math.radians(45.0)
    """Greatest rotation away from the guess that is tried, radians: a rectangular room repeats every 90 degrees."""
    smoothing: float = 0.03
    """Standard deviation by which the x and y histograms are smoothed, metres."""
    min_agreement: float = 0.3
    """Least correlation coefficient of the x and of the y histograms at the pose found, in (0, 1]."""

    def __post_init__(self) -> None:
        require(self.angle_bins >= 36, "angle_bins must be at least 36", self.angle_bins)
        require(0.0 < self.max_rotation <= math.pi, "max_rotation must lie in (0, pi] rad", self.max_rotation)
        require(self.smoothing > 0.0, "smoothing must be > 0 m", self.smoothing)
        require_share(self.min_agreement, "min_agreement")


@dataclass(frozen=True, kw_only=True)
class IcpConfig:
    """Point to point ICP (Besl and McKay 1992)."""

    convergence: ConvergenceConfig = field(default_factory=ConvergenceConfig)
    """When the iteration stops."""
    gate: ShrinkConfig = field(default_factory=lambda: ShrinkConfig(first=4.0, last=0.1, decay=0.15))
    """Greatest distance of a pair, metres. Measured."""
    kept_share: float = 0.95
    """Share of the pairs that take part, closest first, in (0, 1]."""
    min_share: float = 0.3
    """Least share of the current readings that must take part, in (0, 1]."""

    def __post_init__(self) -> None:
        require_share(self.kept_share, "kept_share")
        require_share(self.min_share, "min_share")


@dataclass(frozen=True, kw_only=True)
class PlIcpConfig:
    """Point to line ICP (Censi 2008)."""

    convergence: ConvergenceConfig = field(default_factory=ConvergenceConfig)
    """When the iteration stops."""
    gate: ShrinkConfig = field(default_factory=lambda: ShrinkConfig(first=2.0, last=0.1, decay=0.1))
    """Greatest distance of a pair, metres. Measured."""
    kept_share: float = 0.95
    """Share of the pairs that may take part, closest first, in (0, 1]. Censi's program: 0.95."""
    range_sigma: float = 0.01
    """Range noise of the sensor, metres, for the covariance; more where the pairs show more. Censi's program: 0.01."""
    min_share: float = 0.3
    """Least share of the current readings that must take part, in (0, 1]."""

    def __post_init__(self) -> None:
        require_share(self.kept_share, "kept_share")
        require(self.range_sigma > 0.0, "range_sigma must be > 0 m", self.range_sigma)
        require_share(self.min_share, "min_share")


def require_share(value: float, name: str) -> None:
    """Raise InvalidArgumentError unless a value lies in (0, 1]."""
    require(0.0 < value <= 1.0, f"{name} must lie in (0, 1]", value)


def require_odd(value: int, name: str) -> None:
    """Raise InvalidArgumentError unless a value is odd and at least 1."""
    require(value >= 1 and value % 2 == 1, f"{name} must be odd and at least 1", value)
