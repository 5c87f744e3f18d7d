"""DistanceField: the map as cells that know how far the next wall is, made of its keyframes.

What a scan says of any pose in the map is looked up here: readings that end on a wall, readings that end in space that
was seen to be free, and beams that pass through a wall (the likelihood field of Thrun, Burgard and Fox, "Probabilistic
Robotics", 2005, section 6.4, with the free space that it leaves out).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from itertools import islice, pairwise
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from curvescan._jit import kernel
from curvescan.errors import MapTooLargeError
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.occupancy import OccupancyBuilder, OccupancyGrid, distances_from
from curvescan.scan import LaserScan
from curvescan.slam.map import SlamMap
from curvescan.types import Bools, Floats, Points

ON_WALL_M = 0.12
"""A reading this near to a wall of the map shows it, metres; one in free space, twice as far off, something new."""

REACH_M = 0.4
"""A beam passes through a wall that stands this far before its end, metres; while places are searched for, readings
that end farther from a wall than this say nothing. So far apart, neighbouring readings are of two things."""

FAR_M = 1.0
"""Farther from a wall than this is far from it, metres."""

_WORN = 0.45
"""A reading shows a wall until about four keyframes look through it for each that sees it there: legs, rims and rough
clutter are hit by some beams and missed by others. What an occupancy map still shows, where fewer look through, is
solid."""

_FREE = 0.5 * (_WORN + 0.5)
"""One look through a cell where nothing ends shows it free."""


class DistanceField(NamedTuple):
    """Cells of a map."""

    # (n_rows, n_columns): distance from the nearest cell where readings end, metres, FAR_M at most
    distance: NDArray[np.float32]
    is_free: Bools  # (n_rows, n_columns): whether a cell was seen to be empty
    is_solid: Bools  # (n_rows, n_columns): whether a cell stops the beams that come to it
    origin: Floats  # (2,): lower left corner, metres
    resolution: float  # side of a cell, metres

    def places(self, step: float, clearance: float) -> Points:
        """Return (n, 2) places where a sensor can be: free, on a grid, clear of walls."""
        stride = max(round(step / self.resolution), 1)
        half = stride // 2
        is_place = self.is_free[half::stride, half::stride] & (self.distance[half::stride, half::stride] >= clearance)
        cells = np.argwhere(is_place)[:, ::-1] * stride + half
        return self.origin + self.resolution * (cells + 0.5)

    def agreement(self, points: Points, pose: Floats) -> float:
        """Return what readings of a scan, (n, 2) in its own frame, say for a pose, less what against it, in [-2, 1]."""
        on_wall, new, through = (n / max(len(points), 1) for n in counts(self, points, pose))
        return on_wall - (new + through)


def lasting_points(scan: LaserScan) -> Points:
    """Return what a scan shows of a building: its readings, in its frame, without what comes and goes.

    That is what stands in front of what is seen on both sides, and is no wider than two people.
    """
    points = np.ascontiguousarray(scan.points[scan.valid])
    reach, cuts = np.hypot(*points.T), np.flatnonzero(np.hypot(*np.diff(points, axis=0).T) > REACH_M)
    if len(cuts) < 2:
        return points
    first, last = np.append(0, cuts + 1), np.append(cuts, len(points) - 1)
    before, after = np.append(0.0, reach[last[:-1]]), np.append(reach[first[1:]], 0.0)
    comes_and_goes = (reach[first] < before) & (reach[last] < after)
    comes_and_goes &= np.hypot(*(points[last] - points[first]).T) < 2 * REACH_M
    return np.ascontiguousarray(points[~np.repeat(comes_and_goes, last - first + 1)])


def field_of(slam_map: SlamMap) -> DistanceField:
    """Return the field of a map, from its keyframes."""
    return next(fields_of(slam_map, [len(slam_map)]))


def fields_of(slam_map: SlamMap, sizes: list[int], cell: float = OccupancyConfig.resolution) -> Iterator[DistanceField]:
    """Yield the field of so many first keyframes of a map, for each of some rising sizes."""
    # beams without a return clear no cell: black walls and glass swallow them as space does
    cells = partial(OccupancyConfig, clear_no_return=False, resolution=cell)
    worn, solid = OccupancyBuilder(cells(miss=_WORN, free_to=_FREE)), OccupancyBuilder(cells())
    keyframes = zip(slam_map.scans, slam_map.poses, strict=True)
    for k, (before, n) in enumerate(pairwise((0, *sizes))):
        try:
            for keyframe in islice(keyframes, n - before):
                worn.add(*keyframe)
                solid.add(*keyframe)
        except MapTooLargeError:
            yield from fields_of(slam_map, sizes[k:], 2.0 * cell)
            return
        yield field_of_grid(worn.grid(is_last=True), solid.grid(is_last=True).is_occupied)  # which keeps neither


def field_of_grid(grid: OccupancyGrid, is_solid: Bools | bool = True) -> DistanceField:
    """Return the field of cells: what they call occupied and free, and which occupied ones stop a beam."""
    occupied = grid.is_occupied
    return DistanceField(
        distance=distances_from(occupied, grid.resolution, FAR_M),
        is_free=np.ascontiguousarray(grid.is_free),
        is_solid=np.ascontiguousarray(occupied & is_solid),
        origin=np.asarray(grid.origin, dtype=np.float64),
        resolution=grid.resolution,
    )


@kernel
def counts(field: DistanceField, points: Points, pose: Floats) -> tuple[int, int, int]:
    """Return how many readings end on walls, end in free space, and pass walls; a look every cell and a half."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    n_rows, n_columns = field.distance.shape
    resolution = field.resolution
    n_on = n_new = n_through = 0
    for k in range(len(points)):
        px, py = points[k, 0], points[k, 1]
        reach = math.sqrt(px * px + py * py)
        dx, dy = (c * px - s * py) / reach, (s * px + c * py) / reach
        column = math.floor((pose[0] + reach * dx - field.origin[0]) / resolution)
        row = math.floor((pose[1] + reach * dy - field.origin[1]) / resolution)
        if 0 <= row < n_rows and 0 <= column < n_columns:
            if field.distance[row, column] <= ON_WALL_M:
                n_on += 1
            elif field.is_free[row, column] and field.distance[row, column] > 2.0 * ON_WALL_M:
                n_new += 1
        along = 0.0
        while along < reach - REACH_M:
            column = math.floor((pose[0] + along * dx - field.origin[0]) / resolution)
            row = math.floor((pose[1] + along * dy - field.origin[1]) / resolution)
            if not (0 <= row < n_rows and 0 <= column < n_columns):
                break
            if field.is_solid[row, column]:
                n_through += 1
                break
            along += max(float(field.distance[row, column]) - 0.5 * resolution, 0.7 * resolution)
    return n_on, n_new, n_through
