"""The occupancy map as a picture: white free, dark occupied, grey unknown, and the path of the sensor."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from numpy.typing import NDArray

from curvescan.mapping.occupancy import OccupancyGrid
from curvescan.plots.canvas import DARK, PATH, as_place, drawing_places
from curvescan.types import Pose

_COLOURS = {"unknown": "#c4c7cc", "free": "#ffffff", "occupied": DARK}
"""From what gives way to what shows, where many cells are drawn as one."""

_SHARE = 0.8  # share of the pixels along the axes that blocks of cells may take: axes are smaller than their place


def draw_occupancy(path: Path, grid: OccupancyGrid, poses: Pose, *, title: str) -> None:
    """Save an occupancy map as a picture, and the path of its poses (n, 3)."""
    low = grid.origin
    high = low + grid.resolution * np.array(grid.log_odds.shape[::-1])
    with drawing_places(path, np.stack([low, high])) as (figure, [axes]):
        as_place(axes, f"{title}, cells of {grid.resolution:g} m")
        draw_grid(axes, grid)
        axes.plot(*poses[:, :2].T, color=PATH, lw=0.7, label="path of the sensor")
        figure.legend(loc="outside lower center", ncols=4)


def draw_grid(axes: Axes, grid: OccupancyGrid) -> None:
    """Draw the cells of an occupancy map of at least one cell on axes, whose limits become the map's."""
    ranks, side = _merged_ranks(grid, int(_SHARE * max(axes.get_window_extent().size)))
    left, bottom = grid.origin
    right, top = grid.origin + side * np.array(ranks.shape[::-1])
    axes.grid(visible=False)
    axes.imshow(
        ranks,
        extent=(left, right, bottom, top),
        origin="lower",
        cmap=ListedColormap(list(_COLOURS.values())),
        vmin=0,
        vmax=2,
        interpolation="nearest",  # a block is a pixel or more: none is left out
    )
    axes.set(xlim=(left, right), ylim=(bottom, top))
    for label, colour in _COLOURS.items():
        axes.plot([], [], "s", color=colour, mec="black", mew=0.4, ms=6, label=label)


def _merged_ranks(grid: OccupancyGrid, n_pixels: int) -> tuple[NDArray[np.uint8], float]:
    """Return blocks of cells, 0 unknown, 1 free, 2 occupied as its darkest cell, and a block's side in metres."""
    ranks = grid.is_free.astype(np.uint8)
    ranks[grid.is_occupied] = 2
    n = -(-max(ranks.shape) // max(n_pixels, 1))
    if n > 1:
        n_rows, n_columns = (-(-size // n) for size in ranks.shape)
        missing = [(0, n * n_rows - ranks.shape[0]), (0, n * n_columns - ranks.shape[1])]
        blocks = np.pad(ranks, missing).reshape(n_rows, n, n_columns, n)
        ranks = blocks.max(axis=(1, 3))
    return ranks, n * grid.resolution
