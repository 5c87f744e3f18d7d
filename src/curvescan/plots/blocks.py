"""What pictures of maps are made of, light enough to be drawn by another process; without Matplotlib."""

from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from curvescan import se2
from curvescan.mapping.occupancy import OccupancyGrid
from curvescan.types import Floats, Pose

_N_MOST = 800


class Blocks(NamedTuple):
    """Blocks of cells of an occupancy map."""

    ranks: NDArray[np.uint8]  # (n_rows, n_columns): 0 unknown, 1 free, 2 occupied, as its darkest cell
    # (2,): corners, metres
    low: Floats
    high: Floats


def blocks_of(grid: OccupancyGrid, n_most: int = _N_MOST) -> Blocks:
    """Return the cells of a map in so many rows and columns of blocks, at most."""
    n_rows, n_columns = grid.log_odds.shape
    n = -(-max(n_rows, n_columns) // max(n_most, 1))
    columns = np.arange(0, n_columns, n)
    ranks = np.empty((-(-n_rows // n), columns.size), dtype=np.uint8)
    for k in range(len(ranks)):  # a strip at a time: the map is large
        strip = replace(grid, log_odds=grid.log_odds[k * n : (k + 1) * n])
        ranks[k] = np.maximum.reduceat(np.maximum(strip.is_free, 2 * strip.is_occupied).max(axis=0), columns)
    return Blocks(ranks, grid.origin, grid.origin + n * grid.resolution * np.array(ranks.shape[::-1]))


def from_first(poses: Pose) -> Pose:
    """Return poses seen from the first one that is known."""
    known = np.flatnonzero(~np.isnan(poses[:, 2]))
    return se2.between(poses[known[0]], poses) if known.size else poses
