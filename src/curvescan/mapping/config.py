"""What an occupancy map is made with."""

import math
from dataclasses import dataclass

from curvescan.errors import require


@dataclass(frozen=True, kw_only=True)
class OccupancyConfig:
    """How scans become an occupancy map."""

    resolution: float = 0.05
    """Side of a cell, metres, > 0; map servers and planners expect 0.05."""
    hit: float = 0.7
    """Probability that a cell is occupied where a reading of one scan ends, 0.5 to 1 (Hornung et al. 2013)."""
    miss: float = 0.4
    """Probability that a cell is occupied which the beams of one scan pass, 0 to 0.5 (Hornung et al. 2013)."""
    lowest: float = 0.12
    """Probability below which no cell falls, so that what appears later is taken up in a few scans."""
    highest: float = 0.97
    """Probability above which no cell rises, so that what is taken away goes in a few scans."""
    occupied_from: float = 0.65
    """A cell counts as occupied above this probability: with the other defaults, after one scan."""
    free_to: float = 0.45
    """A cell counts as free below this probability: with the other defaults, after one scan."""
    clear_no_return: bool = True
    """Whether a beam of which nothing came back (+inf, REP-117) clears its way to range_max."""

    def __post_init__(self) -> None:
        require(0.0 < self.resolution < math.inf, "resolution must be a positive number of metres", self.resolution)
        require(0.5 < self.hit < 1.0, "hit must lie between 0.5 and 1", self.hit)
        require(0.0 < self.miss < 0.5, "miss must lie between 0 and 0.5", self.miss)
        require(0.0 < self.lowest < 0.5, "lowest must lie between 0 and 0.5", self.lowest)
        require(0.5 < self.highest < 1.0, "highest must lie between 0.5 and 1", self.highest)
        require(
            self.lowest < self.free_to <= 0.5,
            f"free_to must lie above lowest ({self.lowest}) and be 0.5 at most",
            self.free_to,
        )
        require(
            0.5 <= self.occupied_from < self.highest,
            f"occupied_from must be 0.5 at least and lie below highest ({self.highest})",
            self.occupied_from,
        )
