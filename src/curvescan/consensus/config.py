"""The parameters of the matcher "curvescan": lengths and angles of places people live and work in, none of a log.

Each class configures one stage. The range noise is not among them: it is estimated from each scan.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field

from curvescan.errors import InvalidArgumentError


@dataclass(frozen=True, kw_only=True)
class SurfaceConfig:
    """Surfaces: where they break, which line runs through each reading."""

    range_sigma_min: float = 0.003
    """Least range noise assumed of any sensor, metres; also what a noise-free scan gets."""
    incidence_limit: float = math.radians(10.0)
    """Worst incidence angle at which two neighbouring readings are still one surface, radians in (0, pi/2)."""
    arm: float = 0.12
    """Readings within this distance decide the line through a reading, metres; two a side at least."""
    max_gap: int = 2
    """A run of at most this many missing readings does not end a surface by itself."""

    def __post_init__(self) -> None:
        require(self.range_sigma_min > 0.0, "range_sigma_min must be > 0 m", self.range_sigma_min)
        require(
            0.0 < self.incidence_limit < math.pi / 2,
            "incidence_limit must lie in (0, pi/2) rad",
            self.incidence_limit,
        )
        require(self.arm > 0.0, "arm must be > 0 m", self.arm)
        require(self.max_gap >= 0, "max_gap must be >= 0 readings", self.max_gap)


@dataclass(frozen=True, kw_only=True)
class ConsensusConfig:
    """All parameters of the matcher, grouped by stage."""

    surface: SurfaceConfig = field(default_factory=SurfaceConfig)
    """Surfaces."""


def require(holds: bool, rule: str, value: object) -> None:
    """Raise InvalidArgumentError with the rule and the value unless `holds`."""
    if not holds:
        raise InvalidArgumentError(f"{rule}, got {value!r}")
