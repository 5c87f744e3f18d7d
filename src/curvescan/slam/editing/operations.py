"""Operations on maps: turned, cropped, rubbed out, in other cells; what changed between two; pure functions."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from curvescan import se2
from curvescan.errors import InvalidArgumentError
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.occupancy import OccupancyGrid
from curvescan.slam.map import SlamMap
from curvescan.types import Bools, Floats, Points

Box = tuple[float, float, float, float]
"""Least x and y, largest x and y, metres."""

_LONGEST_CHORD_M = 0.5
"""Readings beside each other that lie farther apart are not of one wall, metres."""

_N_BINS, _NEARBY_RAD = 720, 0.035
"""Bins of the directions of walls over a quarter turn, and how far from the fullest one they count, radians."""

_TOLERANCE_CELLS = 3
"""What lies within so many cells of an obstacle of the other map has not changed: maps differ by their noise."""


@dataclass(frozen=True, kw_only=True)
class Change:
    """One thing that changed between two maps.

    Attributes
    ----------
    kind : str
        "appeared" or "gone".
    box : tuple of float
        Where: least x and y, largest x and y, metres.
    area : float
        Of its cells, square metres.
    """

    kind: str
    box: Box
    area: float


def resampled(slam_map: SlamMap, resolution: float) -> SlamMap:
    """Return a map with the occupancy of its keyframes in other cells, metres."""
    return replace(slam_map, grid=replace(slam_map, grid=None).occupancy(OccupancyConfig(resolution=resolution)))


def turned(slam_map: SlamMap, angle: float) -> SlamMap:
    """Return a map turned about the origin of its frame, radians; its occupancy comes of its keyframes."""
    turn = np.eye(3)
    turn[:2, :2] = se2.rotation(angle)
    poses = se2.compose(np.array([0.0, 0.0, angle]), slam_map.poses)
    return replace(slam_map, poses=poses, covariances=turn @ slam_map.covariances @ turn.T, grid=None)


def wall_angle(slam_map: SlamMap) -> float:
    """Return the angle in (-pi/4, pi/4] of most of the walls against the axes, by length of wall."""
    directions, lengths = [], []
    for scan, pose in zip(slam_map.scans, slam_map.poses, strict=True):
        chords = np.diff(se2.transform(pose, scan.points), axis=0)
        length = np.hypot(*chords.T)
        is_wall = scan.valid[1:] & scan.valid[:-1] & (length < _LONGEST_CHORD_M) & (length > 0.0)
        directions.append(np.arctan2(chords[is_wall, 1], chords[is_wall, 0]))
        lengths.append(length[is_wall])
    angles, weights = np.concatenate([np.empty(0), *directions]), np.concatenate([np.empty(0), *lengths])
    if not angles.size:
        raise InvalidArgumentError("the map shows no walls to level: its keyframes have no readings beside each other")
    quarter = np.remainder(angles, 0.5 * np.pi)
    counts, edges = np.histogram(quarter, _N_BINS, (0.0, 0.5 * np.pi), weights=weights)
    peak = edges[np.argmax(counts)] + 0.25 * np.pi / _N_BINS
    off = np.remainder(quarter - peak + 0.25 * np.pi, 0.5 * np.pi) - 0.25 * np.pi
    near = np.abs(off) < _NEARBY_RAD
    angle = peak + float(np.average(off[near], weights=weights[near]))
    return float(angle - 0.5 * np.pi * np.ceil(angle / (0.5 * np.pi) - 0.5))


def leveled(slam_map: SlamMap) -> SlamMap:
    """Return a map turned so that most of its walls are level."""
    return turned(slam_map, -wall_angle(slam_map))


def cropped(slam_map: SlamMap, box: Box) -> SlamMap:
    """Return the keyframes within a box with what they see in it.

    Raises InvalidArgumentError when none is there.
    """
    _check(box)
    rows = np.flatnonzero(_inside(slam_map.poses[:, :2], box))
    if not rows.size:
        raise InvalidArgumentError(f"no keyframe lies within {box}: the map's are from {_extent(slam_map.poses)}")
    return _without_readings(_chosen(slam_map, rows), lambda points: ~_inside(points, box))


def rubbed_out(slam_map: SlamMap, box: Box) -> SlamMap:
    """Return a map without the readings that end within a box."""
    _check(box)
    return _without_readings(slam_map, lambda points: _inside(points, box))


def _chosen(slam_map: SlamMap, rows: np.ndarray) -> SlamMap:
    """Return some keyframes and the edges between them; a first one that goes takes the frame's exact pose along."""
    row_of = np.full(len(slam_map), -1)
    row_of[rows] = np.arange(len(rows))
    ends = row_of[slam_map.ends]
    kept = np.flatnonzero((ends >= 0).all(axis=1))
    of_edges = {n: getattr(slam_map, n)[kept] for n in ("measured", "edge_covariances", "kinds", "weights")}
    of_poses = {n: getattr(slam_map, n)[rows] for n in ("poses", "covariances", "indices", "sessions")}
    scans = tuple(slam_map.scans[k] for k in rows.tolist())
    return replace(slam_map, scans=scans, ends=ends[kept], grid=None, **of_edges, **of_poses)


def _without_readings(slam_map: SlamMap, is_gone: Callable[[Points], Bools]) -> SlamMap:
    scans = []
    for scan, pose in zip(slam_map.scans, slam_map.poses, strict=True):
        gone = scan.valid & is_gone(se2.transform(pose, scan.points))
        scans.append(replace(scan, ranges=np.where(gone, np.nan, scan.ranges)) if gone.any() else scan)
    return replace(slam_map, scans=tuple(scans), grid=None)


def map_points(slam_map: SlamMap) -> Points:
    """Return (m, 2) all readings of the keyframes, metres, frame of the map."""
    seen = [
        se2.transform(pose, scan.points)[scan.valid] for scan, pose in zip(slam_map.scans, slam_map.poses, strict=True)
    ]
    return np.concatenate([np.empty((0, 2)), *seen])


def changes(before: OccupancyGrid, after: OccupancyGrid, *, least_area: float = 0.02) -> list[Change]:
    """Return what stands in one map where the other saw free space, largest first; both in one frame.

    Raises InvalidArgumentError when their cells differ in size.
    """
    from scipy import ndimage

    if before.resolution != after.resolution:
        raise InvalidArgumentError(
            f"maps must have cells of one size, got {before.resolution:g} and {after.resolution:g} m"
        )
    cell = before.resolution
    corners = [np.rint(grid.origin / cell).astype(np.int64) for grid in (before, after)]
    low = np.minimum(*corners)
    high = np.maximum(*(c + grid.log_odds.shape[::-1] for c, grid in zip(corners, (before, after), strict=True)))
    layers = []
    for corner, grid in zip(corners, (before, after), strict=True):
        (column, row), (n_rows, n_columns) = (corner - low).tolist(), grid.log_odds.shape
        for mask in (grid.is_occupied, grid.is_free):
            whole = np.zeros((high - low)[::-1], dtype=np.bool_)
            whole[row : row + n_rows, column : column + n_columns] = mask
            layers.append(whole)
    stood, was_free, stands, is_free = layers
    found = []
    for kind, there, other, free in (("appeared", stands, stood, was_free), ("gone", stood, stands, is_free)):
        near = ndimage.binary_dilation(other, iterations=_TOLERANCE_CELLS)
        labels, _ = ndimage.label(ndimage.binary_dilation(there & free & ~near), np.ones((3, 3)))
        labels[~(there & free & ~near)] = 0
        areas = cell**2 * np.bincount(labels.ravel())
        for k, place in enumerate(ndimage.find_objects(labels), start=1):
            if place is not None and areas[k] >= least_area:
                rows, columns = place
                x0, y0, x1, y1 = columns.start, rows.start, columns.stop, rows.stop
                box = (np.array([x0, y0, x1, y1]) + np.tile(low, 2)) * cell
                found.append(Change(kind=kind, box=tuple(box.tolist()), area=float(areas[k])))
    return sorted(found, key=lambda change: -change.area)


def _inside(points: Points, box: Box) -> Bools:
    low, high = np.array(box[:2]), np.array(box[2:])
    return np.asarray(((points >= low) & (points <= high)).all(axis=1))


def _check(box: Box) -> None:
    if not (np.isfinite(box).all() and box[0] < box[2] and box[1] < box[3]):
        raise InvalidArgumentError(f"a box is X0 Y0 X1 Y1 with X0 < X1 and Y0 < Y1, got {box}")


def _extent(poses: Floats) -> str:
    (x0, y0), (x1, y1) = poses[:, :2].min(axis=0), poses[:, :2].max(axis=0)
    return f"{x0:.1f} {y0:.1f} to {x1:.1f} {y1:.1f}"
