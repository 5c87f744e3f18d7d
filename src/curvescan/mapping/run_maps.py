"""The maps of a run from one pass over its scans: static cells, dynamic cells, free space."""

from collections.abc import Iterable
from contextlib import suppress
from copy import copy
from dataclasses import dataclass
from itertools import chain, tee

from curvescan import se2
from curvescan.errors import MapTooLargeError
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.dynamic import dynamic_along
from curvescan.mapping.occupancy import OccupancyBuilder, OccupancyGrid
from curvescan.mapping.occupied_cells import OccupiedCells
from curvescan.scan import LaserScan
from curvescan.types import Bools, Points, Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class RunMaps:
    """The maps of a run."""

    # centres of the cells in which a reading ended on what stands, and on what moved while the sensor passed; metres,
    # frame of the poses. A cell may be in both
    standing: Points
    moved: Points
    # the occupancy map, without dynamic readings; None where it was not requested or is left out
    grid: OccupancyGrid | None = None
    why_no_grid: str = ""  # why a requested occupancy map is left out, a sentence; else empty


def build_maps(
    scans: Iterable[LaserScan],
    poses: Pose,
    is_joined: Bools,
    *,
    cell: float | None = 0.05,
    occupancy: OccupancyConfig | None = None,
    about: Points | None = None,
    before: Iterable[tuple[LaserScan, Pose]] = (),
) -> RunMaps:
    """Return the maps of a run; one that would be too large is left out.

    poses (n, 3): of the sensor at each scan, none NaN; is_joined (n,); cell: side of the cells of `standing` and
    `moved`, metres, None for neither; occupancy: how to make the occupancy map, None for none; about: where it lies;
    before: scans of earlier sessions that it shows as well, and where each was.
    """
    standing, moving = OccupiedCells(cell or 1.0), OccupiedCells(cell or 1.0)
    builder = OccupancyBuilder(occupancy) if occupancy else None
    if builder and about is not None:
        with suppress(MapTooLargeError):  # as is told where a scan is too far away
            builder.make_room(about)
    why_no_grid = ""
    kept, watched = tee(map(copy, scans))  # the points of a copy go with it
    now = zip(kept, poses, dynamic_along(watched, poses, is_joined), strict=False)
    for scan, pose, moved in chain(((*one, None) for one in before), now):
        if cell is not None and moved is not None:
            points = se2.transform(pose, scan.points)
            standing.add(points[scan.valid & ~moved])
            moving.add(points[moved])
        if builder:
            try:
                builder.add(scan, pose, ignored=moved)
            except MapTooLargeError as error:
                builder, why_no_grid = None, str(error)
    grid = builder.grid(is_last=True) if builder else None
    if grid is not None and not grid.log_odds.size:
        grid, why_no_grid = None, "no scan has a reading to map"
    return RunMaps(standing=standing.centres(), moved=moving.centres(), grid=grid, why_no_grid=why_no_grid)
