"""Ways through a world: a grid of clearances, and shortest walks on it that keep away from things."""

from __future__ import annotations

import heapq
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from curvescan.errors import InvalidArgumentError
from curvescan.simulation.buildings.world import World
from curvescan.types import Bools, Floats, Points

CELL = 0.1  # side of a grid cell, metres
_COMFORT = 0.8  # metres of clearance beyond which a walk gains nothing by keeping farther away
_SHY = 3.0  # how much longer a cell without clearance counts than one with `_COMFORT`
_MOVES = tuple((i, j, float(np.hypot(i, j))) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)


class Grid:
    """Clearance of a world on a square grid: 0 off the floor."""

    def __init__(self, world: World) -> None:
        self._origin = world.bounds[:2]
        n_columns, n_rows = np.ceil((world.bounds[2:] - self._origin) / CELL).astype(int) + 1
        rows, columns = np.mgrid[:n_rows, :n_columns]
        centres = self._centres(np.column_stack([rows.ravel(), columns.ravel()]))
        clearance = np.where(world.on_floor(centres), world.distance(centres), 0.0)
        self.clearance: Floats = clearance.reshape(n_rows, n_columns)

    def _centres(self, cells: ArrayLike) -> Points:
        rows_columns = np.asarray(cells, dtype=np.float64).reshape(-1, 2)
        return np.asarray(self._origin + CELL * rows_columns[:, ::-1])

    def reachable(self, start: ArrayLike, clearance: float) -> Points:
        """Return the (n, 2) cell centres that can be reached from a place with some clearance, metres."""
        from scipy.ndimage import label  # loaded when a robot wanders

        is_open = self.clearance >= clearance
        pieces, _ = label(is_open)  # cells that share a side belong together
        return self._centres(np.argwhere(pieces == pieces[self._nearest_open(start, is_open)]))

    def plan(self, start: ArrayLike, goal: ArrayLike, clearance: float) -> Points | None:
        """Return a walk from start to goal (A*; cells near things count as longer).

        start, goal (2,); result (n, 2): Cell centres, metres; None when there is no way.
        """
        is_open = self.clearance >= clearance
        first, last = (self._nearest_open(start, is_open), self._nearest_open(goal, is_open))
        weight = 1.0 + _SHY * np.maximum(1.0 - self.clearance / _COMFORT, 0.0)
        n_rows, n_columns = is_open.shape
        weights, opens = weight.ravel().tolist(), is_open.ravel().tolist()
        start_id, goal_id = first[0] * n_columns + first[1], last[0] * n_columns + last[1]
        cost = {start_id: 0.0}
        parent: dict[int, int] = {}
        done: set[int] = set()
        queue = [(0.0, start_id)]
        while queue:
            _, here = heapq.heappop(queue)
            if here == goal_id:
                return self._centres(_trace(parent, here, n_columns))
            if here in done:
                continue
            done.add(here)
            row, column = divmod(here, n_columns)
            for d_row, d_column, length in _MOVES:
                r, c = row + d_row, column + d_column
                there = r * n_columns + c
                if not (0 <= r < n_rows and 0 <= c < n_columns and opens[there]):
                    continue
                whole = cost[here] + length * weights[there]
                if whole < cost.get(there, np.inf):
                    cost[there] = whole
                    parent[there] = here
                    ahead = np.hypot(r - last[0], c - last[1])
                    heapq.heappush(queue, (whole + float(ahead), there))
        return None

    def _nearest_open(self, place: ArrayLike, is_open: Bools) -> tuple[int, int]:
        cells = np.argwhere(is_open)
        if not len(cells):
            raise InvalidArgumentError("the world has no free place for a robot: it is too small or too full")
        offsets = self._centres(cells) - np.asarray(place, dtype=np.float64)
        row, column = cells[int(np.argmin(np.sum(offsets**2, axis=1)))]
        return int(row), int(column)


@lru_cache(maxsize=8)
def grid_of(world: World) -> Grid:
    """Return the grid of a world; the last few are kept."""
    return Grid(world)


def _trace(parent: dict[int, int], here: int, n_columns: int) -> list[tuple[int, int]]:
    cells = [divmod(here, n_columns)]
    while here in parent:
        here = parent[here]
        cells.append(divmod(here, n_columns))
    return cells[::-1]
