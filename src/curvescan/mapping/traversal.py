"""The cells that beams pass: exact traversal of a square grid.

Amanatides and Woo, "A fast voxel traversal algorithm for ray tracing", Eurographics 1987. A beam goes from cell to cell
through the side it meets first. How many columns and rows it has to cross is known beforehand, so that rounding can
neither miss its last cell nor run past it.
"""

import numpy as np
from numpy.typing import NDArray

from curvescan._jit import kernel
from curvescan.types import Bools, Floats


@kernel
def mark_scan(
    log_odds: NDArray[np.float32],
    marks: NDArray[np.uint8],
    mark: int,
    start: Floats,
    ends: Floats,
    is_hit: Bools,
    is_fully_observed: Bools,
    steps: Floats,
) -> None:
    """Enter one scan into a grid, in place; each cell is changed once at most.

    A cell in which a reading ended is a hit, whatever other beams of the scan pass it: a wall seen at a grazing angle
    is not worn away by the beams that go on along it.

    log_odds, marks (n_rows, n_columns): row j holds the cells of y in [j, j + 1), and the mark of the scan that changed
    a cell last; start (2,), ends (n, 2): of the beams, in cells from the corner of the grid, all inside; is_hit,
    is_fully_observed (n,): whether the last cell of a beam is a hit, and whether the beam passed it, else that stays as
    it is; steps (4,): log-odds to add for a hit and for a miss, the lowest and the highest.
    """
    hit, miss, lowest, highest = steps
    for k in range(ends.shape[0]):
        if is_hit[k]:
            i, j = int(np.floor(ends[k, 0])), int(np.floor(ends[k, 1]))
            if marks[j, i] != mark:
                marks[j, i] = mark
                log_odds[j, i] = min(log_odds[j, i] + hit, highest)
    for k in range(ends.shape[0]):
        i, j = int(np.floor(start[0])), int(np.floor(start[1]))
        dx, dy = ends[k, 0] - start[0], ends[k, 1] - start[1]
        n_columns = abs(int(np.floor(ends[k, 0])) - i)
        n_rows = abs(int(np.floor(ends[k, 1])) - j)
        step_x, step_y = (1 if dx > 0.0 else -1), (1 if dy > 0.0 else -1)
        # part of the way at which the next column and the next row begin
        next_x = (i + (dx > 0.0) - start[0]) / dx if n_columns else np.inf
        next_y = (j + (dy > 0.0) - start[1]) / dy if n_rows else np.inf
        n_left = n_columns + n_rows + is_fully_observed[k]
        while n_left > 0:
            if marks[j, i] != mark:
                marks[j, i] = mark
                log_odds[j, i] = max(log_odds[j, i] + miss, lowest)
            if n_columns > 0 and (n_rows == 0 or next_x < next_y):
                i += step_x
                n_columns -= 1
                next_x += step_x / dx
            elif n_rows > 0:
                j += step_y
                n_rows -= 1
                next_y += step_y / dy
            n_left -= 1
