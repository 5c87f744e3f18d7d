"""Parameters of occupancy maps."""

import math
from dataclasses import dataclass

from curvescan.errors import require


@dataclass(frozen=True, kw_only=True)
class OccupancyConfig:
    """How scans become an occupancy map."""

    resolution: float = 0.05
    """Side of a cell, metres, > 0; map servers and planners expect 0.05."""
    hit: float = 0.7
    """Probability that a cell is occupied if a reading of one scan ends in it, 0.5 to 1 (Hornung et al. 2013)."""
    miss: float = 0.4
    """Probability that a cell is occupied if the beams of one scan pass it, 0 to 0.5 (Hornung et al. 2013)."""
    lowest: float = 0.12
    """Lowest probability of a cell, so that a thing that appears later enters the map in a few scans."""
    highest: float = 0.97
    """Highest probability of a cell, so that a thing that is taken away leaves the map in a few scans."""
    occupied_from: float = 0.65
    """A cell counts as occupied above this probability: with the other defaults, after one scan."""
    free_to: float = 0.45
    """A cell counts as free below this probability: with the other defaults, after one scan."""
    clear_no_return: bool = True
    """Whether a beam without a return (+inf, REP-117) clears the cells up to range_max."""

    def __post_init__(self) -> None:
        require(0.0 < self.resolution < math.inf, "resolution must be a positive number of metres", self.resolution)
        require(0.5 < self.hit < 1.0, "hit must lie between 0.5 and 1", self.hit)
        require(0.0 < self.miss < 0.5, "miss must lie between 0 and 0.5", self.miss)
        require(0.0 < self.lowest < 0.5, "lowest must lie between 0 and 0.5", self.lowest)
        require(0.5 < self.highest < 1.0, "highest must lie between 0.5 and 1", self.highest)
        lowest, highest = f"lowest ({self.lowest})", f"highest ({self.highest})"
        require(self.lowest < self.free_to <= 0.5, f"free_to must lie above {lowest}, 0.5 at most", self.free_to)
        is_likely = 0.5 <= self.occupied_from < self.highest
        require(is_likely, f"occupied_from must be 0.5 at least and lie below {highest}", self.occupied_from)
