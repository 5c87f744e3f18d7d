"""Operations on maps: turned, cropped, rubbed out, in other cells; what changed between two; pure functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from curvescan import se2
from curvescan.errors import InvalidArgumentError
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.grid_editing import Box, check_box, overlaid, wall_angle
from curvescan.mapping.occupancy import OccupancyGrid
from curvescan.scan import without_readings
from curvescan.slam.map import SlamMap
from curvescan.types import Bools, Ints, Points

_TOLERANCE_CELLS = 3
"""What lies within so many cells of an obstacle of the other map has not changed: maps differ by their noise."""

_LEAST_AREA = 0.02
"""Square metres: what is smaller is no change."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """One thing that changed between two maps."""

    kind: str  # "appeared" or "gone"
    box: Box  # where: least x and y, largest x and y, metres
    area: float  # of its cells, square metres


def remapped(slam_map: SlamMap, **fields: Any) -> SlamMap:
    """Return a map with other fields, its occupancy to be made anew of its keyframes in the same way."""
    grid = slam_map.grid
    if grid is not None:
        grid = replace(grid, log_odds=np.empty((0, 0), dtype=np.float32))
    return replace(slam_map, grid=grid, **fields)


def resampled(slam_map: SlamMap, resolution: float) -> SlamMap:
    """Return a map with the occupancy of its keyframes in other cells, metres."""
    config = OccupancyConfig() if slam_map.grid is None else slam_map.grid.config
    return replace(slam_map, grid=slam_map.occupancy(replace(config, resolution=resolution)))


def turned(slam_map: SlamMap, angle: float) -> SlamMap:
    """Return a map turned about the origin of its frame, radians; its occupancy comes of its keyframes."""
    turn = np.eye(3)
    turn[:2, :2] = se2.rotation(angle)
    poses = se2.compose(np.array([0.0, 0.0, angle]), slam_map.poses)
    return remapped(slam_map, poses=poses, covariances=turn @ slam_map.covariances @ turn.T)


def leveled(slam_map: SlamMap) -> SlamMap:
    """Return a map turned so that most of its walls are level."""
    return turned(slam_map, -wall_angle(map_points(slam_map)))


def cropped(slam_map: SlamMap, box: Box) -> SlamMap:
    """Return the keyframes within a box with what they see in it.

    Raises InvalidArgumentError when none is there.
    """
    check_box(box)
    rows = np.flatnonzero(_inside(slam_map.poses[:, :2], box))
    if not rows.size:
        (x0, y0), (x1, y1) = (f(slam_map.poses[:, :2], axis=0) for f in (np.min, np.max))
        raise InvalidArgumentError(
            f"no keyframe lies within {box}: the map's are from {x0:.1f} {y0:.1f} to {x1:.1f} {y1:.1f}"
        )
    return _without_readings(part_of(slam_map, rows), lambda points: ~_inside(points, box))


def rubbed_out(slam_map: SlamMap, box: Box) -> SlamMap:
    """Return a map without the readings that end within a box."""
    check_box(box)
    return _without_readings(slam_map, lambda points: _inside(points, box))


def part_of(slam_map: SlamMap, rows: Ints) -> SlamMap:
    """Return some keyframes, by rising rows, and the edges between them; the first may go with its exact pose."""
    graph, is_kept = slam_map.graph(), np.isin(np.arange(len(slam_map)), rows)
    graph.keep_edges(np.all(is_kept[graph.ends], axis=1))
    graph.keep_poses(is_kept)
    of_poses = {n: getattr(slam_map, n)[rows] for n in ("covariances", "indices", "sessions")}
    scans = tuple(slam_map.scans[k] for k in rows.tolist())
    return remapped(slam_map, scans=scans, **of_poses, **graph.arrays())


def _without_readings(slam_map: SlamMap, is_gone: Callable[[Points], Bools]) -> SlamMap:
    scans = []
    for scan, pose in zip(slam_map.scans, slam_map.poses, strict=True):
        gone = scan.valid & is_gone(se2.transform(pose, scan.points))
        scans.append(without_readings(scan, gone))
    return remapped(slam_map, scans=tuple(scans))


def map_points(slam_map: SlamMap) -> Points:
    """Return (m, 2) all readings of the keyframes, metres, frame of the map."""
    seen = [
        se2.transform(pose, scan.points)[scan.valid] for scan, pose in zip(slam_map.scans, slam_map.poses, strict=True)
    ]
    return np.concatenate([np.empty((0, 2)), *seen])


def changes(before: OccupancyGrid, after: OccupancyGrid) -> list[Change]:
    """Return what stands in one map where the other saw free space, largest first; both in one frame."""
    from scipy import ndimage

    before, after = overlaid(before, after)
    cell, low = before.resolution, np.rint(before.origin / before.resolution)
    stood, was_free, stands, is_free = before.is_occupied, before.is_free, after.is_occupied, after.is_free
    found = []
    for kind, there, other, free in (("appeared", stands, stood, was_free), ("gone", stood, stands, is_free)):
        changed = there & free & ~ndimage.binary_dilation(other, iterations=_TOLERANCE_CELLS)
        labels, _ = ndimage.label(ndimage.binary_dilation(changed), np.ones((3, 3)))
        labels[~changed] = 0
        areas = cell**2 * np.bincount(labels.ravel())
        for k, place in enumerate(ndimage.find_objects(labels), start=1):
            if place is not None and areas[k] >= _LEAST_AREA:
                rows, columns = place
                x0, y0, x1, y1 = columns.start, rows.start, columns.stop, rows.stop
                box = (np.array([x0, y0, x1, y1]) + np.tile(low, 2)) * cell
                found.append(Change(kind=kind, box=tuple(box.tolist()), area=float(areas[k])))
    return sorted(found, key=lambda change: -change.area)


def _inside(points: Points, box: Box) -> Bools:
    low, high = np.array(box[:2]), np.array(box[2:])
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))
