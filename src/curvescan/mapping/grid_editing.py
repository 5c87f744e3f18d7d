"""Plain maps changed: moved to other cells, leveled, cropped, rubbed out, laid over each other; pure functions."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan.errors import InvalidArgumentError
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.occupancy import OccupancyGrid, check_map_size, log_odds_of
from curvescan.types import Bools, Floats, Points, Pose

Box = tuple[float, float, float, float]
"""Least x and y, largest x and y, metres."""

_ANGLES_DEG = (np.arange(-45.0, 45.0, 0.5), np.arange(-0.5, 0.5, 0.02))
"""Directions of walls that are tried, and then around the best of them."""

_AS_GOOD = 0.97
"""Directions along which so large a share of the most piles up are as good: walls are as thick as cells."""


def moved(grid: OccupancyGrid, pose: ArrayLike = (0.0, 0.0, 0.0), resolution: float | None = None) -> OccupancyGrid:
    """Return a map moved to a pose in the new frame, in cells whose corners are multiples of their side."""
    config = grid.config if resolution is None else replace(grid.config, resolution=resolution)
    pose = np.asarray(pose, dtype=np.float64)
    return _sampled(grid, pose, config, *_box(grid, pose, config.resolution))


def wall_angle(points: Points, cell: float = 0.05) -> float:
    """Return the angle in (-pi/4, pi/4] of most of the walls against the axes: seen along them, readings pile up."""
    if not len(points):
        raise InvalidArgumentError("the map shows no walls to level: it has no readings or occupied cells")
    cells = np.unique(np.round(points / cell), axis=0)
    coarse, fine = (np.radians(angles) for angles in _ANGLES_DEG)
    peak = coarse[np.argmax([_piled_up(cells, angle) for angle in coarse])]
    piled_up = np.array([_piled_up(cells, peak + angle) for angle in fine])
    best = peak + fine[piled_up >= _AS_GOOD * piled_up.max()].mean()
    return float(best - 0.5 * np.pi * np.ceil(best / (0.5 * np.pi) - 0.5))


def _piled_up(cells: Points, angle: float) -> float:
    """Return the sum of the squares of how many cells lie in each row and column, turned by an angle."""
    along = cells @ se2.rotation(angle)
    counts = [np.bincount(np.round(axis - axis.min()).astype(np.int64)) for axis in along.T]
    return float(sum(np.square(n, dtype=np.float64).sum() for n in counts))


def turned(grid: OccupancyGrid, angle: float) -> OccupancyGrid:
    """Return a map turned about the origin of its frame, radians."""
    return moved(grid, (0.0, 0.0, angle))


def leveled(grid: OccupancyGrid) -> OccupancyGrid:
    """Return a map turned so that most of its walls are level."""
    return turned(grid, -wall_angle(grid.occupied_centres, grid.resolution))


def resampled(grid: OccupancyGrid, resolution: float) -> OccupancyGrid:
    """Return a map in other cells, metres."""
    return moved(grid, resolution=resolution)


def cropped(grid: OccupancyGrid, box: Box) -> OccupancyGrid:
    """Return the cells whose centres lie within a box."""
    rows, columns = (np.flatnonzero(inside) for inside in _inside(grid, box))
    if not (rows.size and columns.size):
        (x0, y0), (x1, y1) = grid.origin, grid.origin + grid.resolution * np.array(grid.log_odds.shape[::-1])
        raise InvalidArgumentError(f"no cell lies within {box}: the map's are from {x0:g} {y0:g} to {x1:g} {y1:g}")
    log_odds = grid.log_odds[rows[0] : rows[-1] + 1, columns[0] : columns[-1] + 1]
    return replace(grid, log_odds=log_odds, origin=grid.origin + grid.resolution * np.array([columns[0], rows[0]]))


def rubbed_out(grid: OccupancyGrid, box: Box) -> OccupancyGrid:
    """Return a map in which the occupied cells of a box are free."""
    rows, columns = _inside(grid, box)
    gone = grid.is_occupied & rows[:, np.newaxis] & columns
    return replace(grid, log_odds=np.where(gone, np.float32(log_odds_of(grid.config.lowest)), grid.log_odds))


def overlaid(one: OccupancyGrid, other: OccupancyGrid) -> tuple[OccupancyGrid, OccupancyGrid]:
    """Return two maps of one frame with the same cells, of the first one's size; unknown where a map says nothing."""
    (low, high), (other_low, other_high) = (_box(grid, np.zeros(3), one.resolution) for grid in (one, other))
    low, high = np.minimum(low, other_low), np.maximum(high, other_high)
    return _sampled(one, np.zeros(3), one.config, low, high), _sampled(other, np.zeros(3), one.config, low, high)


def joined(one: OccupancyGrid, other: OccupancyGrid) -> OccupancyGrid:
    """Return two maps of one frame as one: occupied where either map is, else free where either map is."""
    one, other = overlaid(one, other)
    is_known = other.is_occupied | ((one.log_odds == 0.0) & other.is_free)
    return replace(one, log_odds=np.where(is_known & ~one.is_occupied, other.log_odds, one.log_odds))


def _box(grid: OccupancyGrid, pose: Pose, side: float) -> tuple[Floats, Floats]:
    """Return the lowest and highest corner of a map that lies at a pose, in cells of another size."""
    n_rows, n_columns = grid.log_odds.shape
    corners = grid.origin + grid.resolution * np.array([[0, 0], [n_columns, 0], [0, n_rows], [n_columns, n_rows]])
    there = se2.transform(pose, corners) / side
    # a corner that is a multiple but for rounding begins no new cell
    return np.floor(there.min(axis=0) + 1e-6), np.ceil(there.max(axis=0) - 1e-6)


def _sampled(grid: OccupancyGrid, pose: Pose, config: OccupancyConfig, low: Floats, high: Floats) -> OccupancyGrid:
    """Return the cells of a box, each as the old cell at its centre; one that holds an occupied centre is occupied."""
    side = config.resolution
    check_map_size(high - low, side)
    n_columns, n_rows = (high - low).astype(np.int64).tolist()
    log_odds, back = np.zeros((n_rows, n_columns), dtype=np.float32), se2.inverse(pose)
    xs, beyond = side * (low[0] + np.arange(n_columns) + 0.5), grid.log_odds.shape[::-1]
    for row, y in enumerate(side * (low[1] + np.arange(n_rows) + 0.5)):
        centres = se2.transform(back, np.column_stack((xs, np.full(n_columns, y))))
        cells = np.floor((centres - grid.origin) / grid.resolution).astype(np.int64)
        inside = ((cells >= 0) & (cells < beyond)).all(axis=1)
        columns, rows = cells[inside].T
        log_odds[row, inside] = grid.log_odds[rows, columns]
    cells = np.floor(se2.transform(pose, grid.occupied_centres) / side - low).astype(np.int64)
    columns, rows = cells.clip(0, (n_columns - 1, n_rows - 1)).T
    np.maximum.at(log_odds, (rows, columns), grid.log_odds[grid.is_occupied])
    return OccupancyGrid(log_odds=log_odds, origin=side * low, config=config)


def _inside(grid: OccupancyGrid, box: Box) -> list[Bools]:
    """Return which rows and which columns have their centres within a box."""
    check_box(box)
    return [
        (centres >= box[axis]) & (centres <= box[axis + 2])
        for axis in (1, 0)
        for centres in [grid.origin[axis] + grid.resolution * (np.arange(grid.log_odds.shape[1 - axis]) + 0.5)]
    ]


def check_box(box: Box) -> None:
    """Raise InvalidArgumentError where a box is none."""
    if not (np.isfinite(box).all() and box[0] < box[2] and box[1] < box[3]):
        raise InvalidArgumentError(f"a box is X0 Y0 X1 Y1 with X0 < X1 and Y0 < Y1, got {box}")
