"""The parameters of CF-SMA: the paper's seven, and the few it leaves unsaid.

Each class configures one stage. The paper's symbol, its value and how it was found (section 3.1) stand
beside each field; a field marked *open* has no number in the paper.
"""

import math
from dataclasses import dataclass, field

from curvescan.configs import require_parts
from curvescan.errors import require


@dataclass(frozen=True, kw_only=True)
class SegmentationConfig:
    """Adaptive breakpoint detector (eq. 2)."""

    range_sigma: float = 0.08
    """Range noise sigma_rho, metres, of which eq. 2 takes three as its margin. Paper: value lost; more than the 5 mm of
    a real LMS200, so that walls at a grazing angle stay whole (docs/cfsma.md)."""
    incidence_limit: float = math.radians(10.0)
    """Worst incidence angle lambda still trusted, radians in (0, pi/2). Paper: 10 degrees."""
    min_readings: int = 5
    """Open: segments with fewer readings are isolated groups and are dropped; at least 3."""
    max_gap: int = 2
    """Open: a run of at most this many missing readings does not end a segment by itself."""

    def __post_init__(self) -> None:
        require(self.range_sigma >= 0.0, "range_sigma must be >= 0 m", self.range_sigma)
        require(
            0.0 < self.incidence_limit < math.pi / 2, "incidence_limit must lie in (0, pi/2) rad", self.incidence_limit
        )
        require(self.min_readings >= 3, "min_readings must be at least 3", self.min_readings)
        require(self.max_gap >= 0, "max_gap must be >= 0 readings", self.max_gap)


@dataclass(frozen=True, kw_only=True)
class CurvatureConfig:
    """Adaptive curvature functions (eqs. 3-5)."""

    arc_tolerance: float = 0.08
    """Tolerance U_k of arc length minus chord, metres. Paper: 1.0 in a unit it does not name; 0.08 leaves no false
    peak on a plane 1 m away or farther, under the 5 mm of noise of a real LMS200 (docs/cfsma.md)."""

    def __post_init__(self) -> None:
        require(self.arc_tolerance > 0.0, "arc_tolerance must be > 0 m", self.arc_tolerance)


@dataclass(frozen=True, kw_only=True)
class FunctionsConfig:
    """Pairing of curvature functions in the Fourier domain (eq. 6)."""

    min_correlation: float = 0.4
    """Least normalised correlation U_c of two functions, in [0, 1]. Paper: 0.4."""
    length: int = 128
    """Open: common length 2^n that functions are brought to; the paper names 64, 128 and 256."""

    def __post_init__(self) -> None:
        require(0.0 <= self.min_correlation <= 1.0, "min_correlation must lie in [0, 1]", self.min_correlation)
        require(
            self.length >= 8 and self.length & (self.length - 1) == 0,
            "length must be a power of two, at least 8",
            self.length,
        )


@dataclass(frozen=True, kw_only=True)
class LandmarksConfig:
    """Characteristic points and their pairing (eqs. 7-9)."""

    min_curvature: float = 0.2
    """Least curvature U_p of a characteristic point, radians. Paper: 0.2."""
    n_neighbours: int = 30
    """Neighbours n taken on each side, in eqs. 8-9 and in the final pairs. Paper: 30."""
    min_similarity: float = 0.2
    """Least Pearson similarity S_min, in [0, 1]. Paper: 0.2."""
    max_ambiguity: float = 0.995
    """Open: a candidate whose runner-up reaches this share of its similarity is not distinct."""

    def __post_init__(self) -> None:
        require(0.0 < self.min_curvature < math.pi, "min_curvature must lie in (0, pi) rad", self.min_curvature)
        require(self.n_neighbours >= 1, "n_neighbours must be at least 1", self.n_neighbours)
        require(0.0 <= self.min_similarity <= 1.0, "min_similarity must lie in [0, 1]", self.min_similarity)
        require(0.0 < self.max_ambiguity <= 1.0, "max_ambiguity must lie in (0, 1]", self.max_ambiguity)


@dataclass(frozen=True, kw_only=True)
class CfSmaConfig:
    """All parameters of CF-SMA, grouped by stage."""

    segmentation: SegmentationConfig = field(default_factory=SegmentationConfig)
    """Adaptive breakpoint detector."""
    curvature: CurvatureConfig = field(default_factory=CurvatureConfig)
    """Adaptive curvature functions."""
    functions: FunctionsConfig = field(default_factory=FunctionsConfig)
    """Pairing of curvature functions."""
    landmarks: LandmarksConfig = field(default_factory=LandmarksConfig)
    """Characteristic points."""
    consistency: bool = False
    """Not in the paper: whether pairs that do not agree with the largest group of others are left out."""
    consistency_distance: float = 0.15
    """Root mean square distance up to which the readings around a pair agree with a pose, metres: readings are paired
    by index, and slip along a wall. Measured: 0.15 to 0.2 are best, on seeds of their own and on the Intel log."""

    def __post_init__(self) -> None:
        require_parts(self)
        require(self.consistency_distance > 0.0, "consistency_distance must be > 0 m", self.consistency_distance)
