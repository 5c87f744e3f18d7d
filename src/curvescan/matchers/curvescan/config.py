"""The parameters of the matcher "curvescan": lengths and angles of the places that robots work in, none of one log.

Each class configures one stage. The range noise is not among them: it is estimated from each scan.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from curvescan.configs import require_parts
from curvescan.errors import require

LASER_ERROR = 0.01
"""Error that all readings of a wall share, metres: rounding to centimetres, angle of incidence."""

LIKELY_SIGMAS, SURE_SIGMAS = 2.0, 3.0
"""Standard deviations of noise within which 95 % and 99.7 % of the readings lie."""

REACH = 0.1
"""How far along its line a reading may lie from the line's centre: metres, and as many for each metre of range."""

PARALLEL = 0.9
"""Least cosine of the angle between two surfaces that run alike, 26 degrees."""

NEAR = 0.3
"""Metres plus radians within which two poses are one: a robot that stands still, a pose where the guess has it. In
metres, and half of it in radians, two hypotheses."""

SAME = 0.1
"""Metres, and half of it in radians, within which two refined poses are one."""

AS_GOOD = 0.98
"""A pose with this share of the best score is as good, where few readings, but sure ones, fix the best."""

ARM = 0.12
"""Half the length of the shortest line through readings, metres: so wide is a wall as well."""


@dataclass(frozen=True, kw_only=True)
class SegmentsConfig:
    """Surfaces: where they break, and the line through each reading."""

    incidence_limit: float = math.radians(10.0)
    """Worst incidence angle at which two neighbouring readings are still one surface, radians in (0, pi/2)."""
    arm: float = ARM
    """Readings within this distance decide the line through a reading, metres; two a side at least."""
    jump: float = 0.03
    """Besides what the incidence explains, neighbouring readings of one surface may lie apart by this, metres."""
    range_sigma_min: float = 0.003
    """Least range noise that a scan is taken to have, metres."""

    def __post_init__(self) -> None:
        require(
            0.0 < self.incidence_limit < math.pi / 2, "incidence_limit must lie in (0, pi/2) rad", self.incidence_limit
        )
        for name in ("arm", "jump", "range_sigma_min"):
            require(getattr(self, name) > 0.0, f"{name} must be > 0 m", getattr(self, name))


@dataclass(frozen=True, kw_only=True)
class HypothesesConfig:
    """Hypotheses: which poses are tried."""

    max_tried: int = 48
    """Places at which most walls and edges coincide that are tried."""
    n_rotations: int = 4
    """Rotations taken from the directions of all surfaces."""
    along_reach: float = 1.8
    """How far along a corridor places are tried, metres each way."""

    def __post_init__(self) -> None:
        require(self.along_reach > 0.0, "along_reach must be > 0 m", self.along_reach)
        for name in ("max_tried", "n_rotations"):
            require(getattr(self, name) >= 1, f"{name} must be at least 1", getattr(self, name))


@dataclass(frozen=True, kw_only=True)
class ScoringConfig:
    """Verification: what counts as agreement, and how much of it is enough."""

    n_samples: int = 36
    """Readings of each scan that stand for all of them."""
    margin: float = LASER_ERROR
    """Metres that two readings of one surface may lie apart besides three standard deviations of their noise, and all
    readings of a surface that did not move on the mean."""
    doubtful_score: float = 0.35
    """Below this score other places are tried, with the turn found."""
    min_confidence: float = 0.5
    """Least confidence of a match, by what the scans show."""
    min_inliers: int = 15
    """Least readings of the current scan that agree at a match, or a third of all where those are few."""

    def __post_init__(self) -> None:
        require(self.n_samples >= 6, "n_samples must be at least 6", self.n_samples)
        require(self.min_inliers >= 1, "min_inliers must be at least 1", self.min_inliers)
        require(self.margin >= 0.0, "margin must be >= 0 m", self.margin)
        require(-1.0 <= self.doubtful_score <= 1.0, "doubtful_score must lie in [-1, 1]", self.doubtful_score)
        require(0.0 <= self.min_confidence <= 1.0, "min_confidence must lie in [0, 1]", self.min_confidence)


@dataclass(frozen=True, kw_only=True)
class RefinementConfig:
    """Refinement: how wrong a pose may be at each iteration; in the last one, on all readings, not at all."""

    quick: tuple[float, ...] = (0.06, 0.02)
    """Sigma schedule: standard deviation added in each iteration on the samples, metres, for the few best poses."""
    closer: tuple[float, ...] = (LASER_ERROR,)
    """The same for the one or two that are left."""

    def __post_init__(self) -> None:
        for name in ("quick", "closer"):
            sigmas = getattr(self, name)
            is_right = len(sigmas) > 0 and all(s >= 0.0 for s in sigmas)
            require(is_right, f"{name} must be lengths >= 0 m, at least one", sigmas)


@dataclass(frozen=True, kw_only=True)
class InformationConfig:
    """Covariance: when a direction counts as open, and how wide it then is."""

    max_sigma: float = SAME
    """A direction known no better than this is open, metres at the typical reading; so well is the best place known
    along one in which the agreement of the scans is flat."""
    degenerate_sigma: float = 1.0
    """Standard deviation given to an open direction, metres at the typical reading."""
    degenerate_ratio: float = 0.1
    """A direction of which less than this share of the next one's information is known is searched along, and is open
    where the scans agree as well some way along it, or worse by this share at most if it is not known to a centimetre.
    Below twice this share other poses along it do not compete: the covariance holds them, and it is named."""

    def __post_init__(self) -> None:
        for name in ("max_sigma", "degenerate_sigma", "degenerate_ratio"):
            require(getattr(self, name) > 0.0, f"{name} must be > 0", getattr(self, name))


@dataclass(frozen=True, kw_only=True)
class CurvescanConfig:
    """All parameters of the matcher, grouped by stage."""

    segments: SegmentsConfig = field(default_factory=SegmentsConfig)
    """Surfaces and lines."""
    hypotheses: HypothesesConfig = field(default_factory=HypothesesConfig)
    """Poses to try."""
    scoring: ScoringConfig = field(default_factory=ScoringConfig)
    """Agreement of the scans."""
    refinement: RefinementConfig = field(default_factory=RefinementConfig)
    """Least squares."""
    information: InformationConfig = field(default_factory=InformationConfig)
    """Covariance."""

    def __post_init__(self) -> None:
        require_parts(self)
