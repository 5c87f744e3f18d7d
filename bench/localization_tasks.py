"""What localization is measured on: a map, and another log of the same place with reference poses in the frame of the map."""

from __future__ import annotations

import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from curvescan import se2
from curvescan.deskew import middle_of_sweep
from curvescan.evaluation.relations import associate
from curvescan.io.reading import read_log, read_poses
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan
from curvescan.simulation import SENSORS, Sensor, World, build_world, simulate
from curvescan.simulation.buildings.floorplan import WALL_THICKNESS
from curvescan.slam import Slam, SlamMap, load_map
from curvescan.slam.localization.correlative import refined, thinned
from curvescan.slam.localization.field import DistanceField, counts, field_of
from curvescan.types import Bools, Floats, Points, Pose

SHOWN, PARTLY_SHOWN = 0.8, 0.5
"""A scan is in the map where this share of its readings ends on walls that the map shows; partly, where this one
does."""

PARTS = ((SHOWN, 1.1, "in the map"), (PARTLY_SHOWN, SHOWN, "partly in the map"), (0.0, PARTLY_SHOWN, "outside"))
"""Shares of a scan that the map shows: from, below, and what it is called."""

_SPINNING = SENSORS["spinning-360"]

FLOORS: Mapping[str, Mapping[str, Any]] = {
    "B": {"world": "building"},
    "C": {"world": "building", "sensor": replace(SENSORS["urg-04lx"], range_max=4.0)},
    "E": {"world": "building", "n_people": 15, "moved_share": 0.3, "n_closed": 3},
    "G": {"sensor": replace(_SPINNING, time_increment=_SPINNING.period / _SPINNING.n_beams)},
}
"""Kinds of floors: an office floor, the same seen 4 m far with 30 mm of noise, with people, moved furniture and closed
doors, and a flat with a laser that spins while it drives."""

_DOOR_M, _WALL_M = (0.6, 1.5), 0.2
"""A gap so wide, metres, between two walls in a line, no thicker than this, is a door."""

_FIT_M, _FIT_GAIN = 0.6, 0.02
"""A reference pose is moved to where the scan fits the map better by this share of its readings, if that is as near,
metres."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LocalizationTask:
    """A map, and a log of the same place with reference poses in the frame of the map."""

    name: str  # for people
    slam_map: SlamMap  # the map
    scans: Sequence[LaserScan]  # the log
    # poses of the scans, and of the map's keyframes, by the reference, in a frame of its own
    references: Pose
    keyframes: Pose
    # (n, 3): where each scan was taken in the frame of the map, by the keyframe nearest to it: metres, metres, radians
    poses: Pose
    is_exact: Bools  # (n,): whether its reference pose was given, not interpolated
    is_true: bool  # whether the reference is the truth; else it is SLAM's, and may itself err against the map
    field: DistanceField  # the map as cells

    def shown(self, k: int) -> float:
        """Return the share of the readings of a scan that end on walls of the map."""
        points = points_of(self.scans[k])
        return counts(self.field, points, self.poses[k])[0] / max(len(points), 1)

    def seen_from(self, keyframe: int, k: int) -> Pose:
        """Return the pose of a scan in the frame of the map by one keyframe: how maps bend elsewhere does not matter."""
        seen = se2.between(self.keyframes[keyframe], self.references[k])
        pose: Pose = se2.compose(self.slam_map.poses[keyframe], seen)
        return pose

    def fitted(self, k: int, pose: Pose) -> Pose:
        """Return a reference pose of a scan, moved to where the scan fits the map better nearby, where the reference is not the truth."""
        if self.is_true:
            return pose
        points = points_of(self.scans[k])
        moved = refined(self.field, pose[np.newaxis], thinned(points))[0][0]
        gain = self.field.agreement(points, moved) - self.field.agreement(points, pose)
        is_near = np.hypot(*(moved - pose)[:2]) < _FIT_M
        return moved if gain > _FIT_GAIN and is_near else pose


def points_of(scan: LaserScan) -> Points:
    """Return the valid readings of a scan in the frame of the sensor."""
    return np.ascontiguousarray(scan.points[scan.valid])


def _task(
    name: str,
    slam_map: SlamMap,
    scans: Sequence[LaserScan],
    references: Pose,
    mapped: Pose,
    is_exact: Bools,
    *,
    is_true: bool,
) -> LocalizationTask:
    """Return a task by the reference poses of its scans and of the scans that made the map."""
    read = _read_back(slam_map)
    keyframes = mapped[read.indices]
    return LocalizationTask(
        name=name,
        slam_map=read,
        scans=scans,
        references=references,
        keyframes=keyframes,
        poses=in_frame_of(read.poses, keyframes, references)[0],
        is_exact=is_exact,
        is_true=is_true,
        field=field_of(read),
    )


def in_frame_of(anchors: Pose, references: Pose, wanted: Pose) -> tuple[Pose, Floats]:
    """Return reference poses carried into the frame of a map, and how far each is from where the map was made.

    A map and its reference bend differently: each pose is carried over by the nearest one that both have.

    anchors, references (m, 3); wanted (n, 3).
    """
    distance, nearest = cKDTree(references[:, :2]).query(wanted[:, :2])
    carried: Pose = se2.compose(anchors[nearest], se2.between(references[nearest], wanted))
    return carried, np.asarray(distance)


def task_of_log(log: Path, reference: Path, *, stride: int = 1) -> LocalizationTask:
    """Return a map of the first half of a log, and its second half."""
    whole = read_log(log)
    scans = [scan for k, scan in enumerate(whole) if k % stride == 0]
    poses, is_exact = _reference_of(scans, read_poses(reference).trajectory)
    half = len(scans) // 2
    slam = Slam()
    for scan in scans[:half]:
        slam.add(scan)
    slam.finish()
    return _task(whole.name, slam.map, scans[half:], poses[half:], poses[:half], is_exact[half:], is_true=False)


def _reference_of(scans: Sequence[LaserScan], reference: Trajectory) -> tuple[Pose, Bools]:
    """Return the reference pose of each scan, in between along the way, and whether it was given."""
    pairs = associate(np.array([s.stamp for s in scans]), reference.stamps, tolerance=1e-4)
    order = np.argsort(pairs.first)
    at, given = pairs.first[order], reference.poses[pairs.second[order]]
    n = np.arange(len(scans))
    before = np.clip(np.searchsorted(at, n, side="right") - 1, 0, len(at) - 2)
    share = np.clip((n - at[before]) / (at[before + 1] - at[before]), 0.0, 1.0)
    moved = se2.between(given[before], given[before + 1])
    is_exact = np.zeros(len(scans), dtype=np.bool_)
    is_exact[at] = True
    return se2.compose(given[before], share[:, np.newaxis] * moved), is_exact


def task_of_floor(
    seed: int,
    *,
    world: str = "office",
    sensor: str | Sensor = "sick-lms200",
    n_test: int = 800,
    n_people: int = 0,
    moved_share: float = 0.0,
    n_closed: int = 0,
) -> LocalizationTask:
    """Return a map of a simulated floor, of one lap, and a drive to random places on it."""
    built = build_world(world, seed)
    lap = simulate(built, sensor=sensor, seed=seed, odometry_noise=None)
    slam = Slam()
    for scan in lap:
        slam.add(scan)
    slam.finish()
    later = replace(with_moved_things(built, moved_share, seed), route=np.empty((0, 2)))
    later = with_closed_doors(later, n_closed, seed)
    drive = simulate(later, sensor=sensor, seed=seed + 1000, n_scans=n_test, n_people=n_people, odometry_noise=None)
    return _task(
        f"{world} {seed}"
        + f", {moved_share:.0%} moved" * (moved_share > 0.0)
        + f", {n_closed} closed" * (n_closed > 0),
        slam.map,
        list(drive),
        in_the_middle(drive.truth.poses, drive[0], drive.sensor.period),
        in_the_middle(lap.truth.poses, lap[0], lap.sensor.period),
        np.ones(len(drive), dtype=np.bool_),
        is_true=True,
    )


def in_the_middle(poses: Pose, scan: LaserScan, period: float) -> Pose:
    """Return the poses (n, 3) of a sensor in the middle of each sweep, given those at its first beam.

    scan: Any of them; period: From one to the next, seconds.
    """
    onward = se2.log(se2.between(poses[:-1], poses[1:]))
    share = middle_of_sweep(scan) / period
    moved: Pose = se2.compose(poses, se2.exp(share * np.concatenate((onward, onward[-1:]))))
    return moved


def with_moved_things(world: World, share: float, seed: int) -> World:
    """Return a world with a share of its boxes and cylinders 0.4 to 1 m from where they stood, boxes turned as well.

    Walls, the boxes of a wall's thickness, stay.
    """
    rng = np.random.default_rng([seed, 7])
    boxes, circles = world.boxes.copy(), world.circles.copy()
    for things in (boxes, circles):
        chosen = (rng.random(len(things)) < share) & ~_is_wall(things)
        way, direction = rng.uniform(0.4, 1.0, len(things)), rng.uniform(-np.pi, np.pi, len(things))
        shift = way[:, np.newaxis] * np.column_stack((np.cos(direction), np.sin(direction)))
        things[chosen, :2] += shift[chosen]
    is_turned = (rng.random(len(boxes)) < share) & ~_is_wall(boxes)
    boxes[:, 4] += np.where(is_turned, rng.uniform(0.0, np.pi, len(boxes)), 0.0)
    return replace(world, boxes=boxes, circles=circles)


def _is_wall(things: Floats) -> Bools:
    """Return (n,) which of some boxes, or cylinders, are walls."""
    return np.isclose(things[:, 2:4], WALL_THICKNESS).any(axis=1) & (things.shape[1] == 5)


def with_closed_doors(world: World, n: int, seed: int) -> World:
    """Return a world in which some of the doors, gaps between two walls in a line, are walls, at most `n`."""
    doors = []
    for along, across in ((0, 1), (1, 0)):
        walls = world.boxes[(world.boxes[:, 4] == 0.0) & (world.boxes[:, 2 + across] < _WALL_M)]
        for at in np.unique(walls[:, across].round(6)):
            line = walls[np.abs(walls[:, across] - at) < 1e-5]
            line = line[np.argsort(line[:, along])]
            ends = line[:, along] + 0.5 * line[:, 2 + along]
            gaps = line[1:, along] - 0.5 * line[1:, 2 + along] - ends[:-1]
            for k in np.flatnonzero((gaps > _DOOR_M[0]) & (gaps < _DOOR_M[1])):
                door = line[k].copy()
                door[along], door[2 + along] = ends[k] + 0.5 * gaps[k], gaps[k]
                doors.append(door)
    if not doors:
        return world
    chosen = np.random.default_rng([seed, 8]).permutation(len(doors))[:n]
    return replace(world, boxes=np.vstack((world.boxes, np.array(doors)[chosen])))


def _read_back(slam_map: SlamMap) -> SlamMap:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.csmap"
        slam_map.save(path)
        return load_map(path)
