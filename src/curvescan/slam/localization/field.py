"""DistanceField: the map as cells that know how far the next wall is, made of its keyframes.

What a scan says of any pose in the map is looked up here: readings that end on a wall, readings that end in space that
was seen to be free, and beams that pass through a wall (the likelihood field of Thrun, Burgard and Fox, "Probabilistic
Robotics", 2005, section 6.4, with the free space that it leaves out).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from curvescan._jit import kernel
from curvescan.errors import MapTooLargeError
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.occupancy import OccupancyBuilder, OccupancyGrid
from curvescan.slam.map import SlamMap
from curvescan.types import Bools, Floats, Points

ON_WALL_M = 0.12
"""A reading that ends this near to a wall of the map shows it, metres."""

_OFF_WALL_M = 0.25
"""A reading that ends in free space farther from any wall shows something new, metres."""

_BEFORE_M = 0.4
"""A beam passes through a wall that stands this far before its end, metres."""

_WORN = 0.45
"""A reading shows a wall until about four keyframes look through it for each that sees it there: legs, rims and rough
clutter are hit by some beams and missed by others. What an occupancy map still shows, where fewer look through, is
solid."""

_FREE = 0.48
"""One look through a cell where nothing ends shows it free."""

N_EVIDENCE = 3
"""Columns of the evidence of a pose: shares of the readings that end on walls, end in free space, and pass through
walls."""


class Agreement(NamedTuple):
    """What the readings of a scan say of a pose in the map, shares of all of them."""

    on_wall: float
    new: float
    through: float

    @property
    def against(self) -> float:
        """Share that the map contradicts."""
        return self.new + self.through

    @property
    def score(self) -> float:
        """What speaks for the pose less what speaks against it, in [-2, 1]."""
        return self.on_wall - self.against


@dataclass(frozen=True, eq=False, kw_only=True)
class DistanceField:
    """Cells of a map."""

    distance: NDArray[np.float32]  # (n_rows, n_columns): distance from the nearest cell where readings end, metres
    is_free: Bools  # (n_rows, n_columns): whether a cell was seen to be empty
    is_solid: Bools  # (n_rows, n_columns): whether a cell stops the beams that come to it
    origin: Floats  # (2,): lower left corner, metres
    resolution: float  # side of a cell, metres

    def places(self, step: float, clearance: float) -> Points:
        """Return (n, 2) places where a sensor can be: free, on a grid, clear of walls."""
        stride = max(round(step / self.resolution), 1)
        half = stride // 2
        free = self.is_free[half::stride, half::stride]
        clear = self.distance[half::stride, half::stride] >= clearance
        rows, columns = np.nonzero(free & clear)
        cells = np.column_stack((columns, rows)) * stride + half
        return self.origin + self.resolution * (cells + 0.5)

    def agreement(self, points: Points, pose: Floats) -> Agreement:
        """Return what the valid readings of a scan, (n, 2) in its own frame, say of a pose."""
        parts = (self.distance, self.is_free, self.is_solid, self.origin, self.resolution)
        return Agreement(*_agreement(*parts, points, pose).tolist())


def field_of(slam_map: SlamMap) -> DistanceField:
    """Return the field of a map, from its keyframes."""
    resolution = OccupancyConfig().resolution
    while True:
        try:
            worn, solid = (_grid(slam_map, resolution, miss) for miss in (_WORN, None))
            return field_of_grid(worn, solid.is_occupied)
        except MapTooLargeError:
            resolution *= 2.0


def field_of_grid(grid: OccupancyGrid, is_solid: Bools | bool = True) -> DistanceField:
    """Return the field of cells: what they call occupied and free, and which occupied ones stop a beam."""
    from scipy.ndimage import distance_transform_edt  # loads for a good part of a second

    occupied = grid.is_occupied
    distance = (
        distance_transform_edt(~occupied) * grid.resolution if occupied.any() else np.full(occupied.shape, np.inf)
    )
    return DistanceField(
        distance=distance.astype(np.float32),
        is_free=np.ascontiguousarray(grid.is_free),
        is_solid=np.ascontiguousarray(occupied & is_solid),
        origin=np.asarray(grid.origin, dtype=np.float64),
        resolution=grid.resolution,
    )


def _grid(slam_map: SlamMap, resolution: float, miss: float | None) -> OccupancyGrid:
    """Return the map as cells, the usual ones or with another probability of those that are passed.

    Beams of which nothing came back clear nothing: black and glass walls swallow them as well as open space.
    """
    given: dict[str, Any] = {"resolution": resolution, "clear_no_return": False}
    builder = OccupancyBuilder(given if miss is None else given | {"miss": miss, "free_to": _FREE})
    for scan, pose in zip(slam_map.scans, slam_map.poses, strict=True):
        builder.add(scan, pose)
    return builder.grid()


@kernel
def _agreement(
    distance: NDArray[np.float32],
    is_free: Bools,
    is_solid: Bools,
    origin: Floats,
    resolution: float,
    points: Points,
    pose: Floats,
) -> Floats:
    """Return (N_EVIDENCE,) shares; a beam is looked at every cell and a half."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    n_rows, n_columns = distance.shape
    n_on = n_new = n_through = 0
    for k in range(len(points)):
        px, py = points[k, 0], points[k, 1]
        reach = math.sqrt(px * px + py * py)
        dx, dy = (c * px - s * py) / reach, (s * px + c * py) / reach
        column = math.floor((pose[0] + reach * dx - origin[0]) / resolution)
        row = math.floor((pose[1] + reach * dy - origin[1]) / resolution)
        if 0 <= row < n_rows and 0 <= column < n_columns:
            if distance[row, column] <= ON_WALL_M:
                n_on += 1
            elif is_free[row, column] and distance[row, column] > _OFF_WALL_M:
                n_new += 1
        along = 0.0
        while along < reach - _BEFORE_M:
            column = math.floor((pose[0] + along * dx - origin[0]) / resolution)
            row = math.floor((pose[1] + along * dy - origin[1]) / resolution)
            if not (0 <= row < n_rows and 0 <= column < n_columns):
                break
            if is_solid[row, column]:
                n_through += 1
                break
            along += max(float(distance[row, column]) - 0.5 * resolution, 0.7 * resolution)
    shares = np.zeros(N_EVIDENCE)
    n = max(len(points), 1)
    shares[0], shares[1], shares[2] = n_on / n, n_new / n, n_through / n
    return shares
