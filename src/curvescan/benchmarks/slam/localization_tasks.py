"""What localization is measured on: a map, and another log of the same place with reference poses in the frame of the map."""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from curvescan import se2
from curvescan.evaluation.association import associate
from curvescan.io.poses import read_poses
from curvescan.io.reading import read_log
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan
from curvescan.simulation import World, build_world, simulate
from curvescan.slam import Slam, SlamMap, load_map
from curvescan.types import Bools, Floats, Pose

MAPPED_M = 2.0
"""A place is in the map where the sensor came as near as this when the map was made, metres."""


@dataclass(frozen=True, eq=False, kw_only=True)
class LocalizationTask:
    """A map, and a log of the same place with reference poses in the frame of the map.

    Attributes
    ----------
    name : str
        For people.
    slam_map : SlamMap
        The map.
    scans : sequence of LaserScan
        The log.
    poses : (n, 3) float64
        Where each scan was taken in the frame of the map: metres, metres, radians.
    is_mapped : (n,) bool
        Whether its place is in the map.
    is_exact : (n,) bool
        Whether its reference pose was given, not interpolated.
    """

    name: str
    slam_map: SlamMap
    scans: Sequence[LaserScan]
    poses: Pose
    is_mapped: Bools
    is_exact: Bools


def in_frame_of(anchors: Pose, references: Pose, wanted: Pose) -> tuple[Pose, Floats]:
    """Return reference poses carried into the frame of a map, and how far each is from where the map was made.

    A map and its reference bend differently: each pose is carried over by the nearest one that both have.

    Parameters
    ----------
    anchors, references : (m, 3) float64
        Poses of the same scans, in the map and by the reference.
    wanted : (n, 3) float64
        Other poses by the reference.
    """
    distance, nearest = cKDTree(references[:, :2]).query(wanted[:, :2])
    carried: Pose = se2.compose(anchors[nearest], se2.between(references[nearest], wanted))
    return carried, np.asarray(distance)


def task_of_log(log: Path, reference: Path, *, stride: int = 1) -> LocalizationTask:
    """Return a map of the first half of a log, and its second half.

    Parameters
    ----------
    log, reference : Path
        The log, and poses of the sensor with the stamps of scans.
    stride : int
        Take every so many scans.
    """
    whole = read_log(log)
    scans = [scan for k, scan in enumerate(whole) if k % stride == 0]
    poses, is_exact = _reference_of(scans, read_poses(reference).trajectory)
    half = len(scans) // 2
    slam = Slam()
    for scan in scans[:half]:
        slam.add(scan)
    trajectory = slam.finish()
    known = is_exact[:half]
    carried, distance = in_frame_of(trajectory.poses[known], poses[:half][known], poses[half:])
    return LocalizationTask(
        name=whole.name,
        slam_map=_read_back(slam.map),
        scans=scans[half:],
        poses=carried,
        is_mapped=distance < MAPPED_M,
        is_exact=is_exact[half:],
    )


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
    n_test: int = 800,
    n_people: int = 0,
    moved_share: float = 0.0,
) -> LocalizationTask:
    """Return a map of a simulated floor, of one lap, and a drive to random places on it.

    Parameters
    ----------
    seed : int
        Floor and drives.
    world : str
        Kind of floor.
    n_test : int
        Scans of the drive.
    n_people : int
        People who walk there meanwhile.
    moved_share : float
        Share of the boxes and cylinders that stand elsewhere by then.
    """
    built = build_world(world, seed)
    lap = simulate(built, seed=seed, odometry_noise=None)
    slam = Slam()
    for scan in lap:
        slam.add(scan)
    trajectory = slam.finish()
    later = replace(with_moved_things(built, moved_share, seed), route=np.empty((0, 2)))
    drive = simulate(
        later, seed=seed + 1000, n_scans=n_test, n_people=n_people, odometry_noise=None
    )
    poses, distance = in_frame_of(trajectory.poses, lap.truth.poses, drive.truth.poses)
    return LocalizationTask(
        name=f"{world} {seed}" + f", {moved_share:.0%} moved" * (moved_share > 0.0),
        slam_map=_read_back(slam.map),
        scans=list(drive),
        poses=poses,
        is_mapped=distance < MAPPED_M,
        is_exact=np.ones(len(poses), dtype=np.bool_),
    )


def with_moved_things(world: World, share: float, seed: int) -> World:
    """Return a world with a share of its boxes and cylinders 0.4 to 1 m from where they stood, boxes turned as well."""
    rng = np.random.default_rng([seed, 7])
    boxes, circles = world.boxes.copy(), world.circles.copy()
    for things in (boxes, circles):
        chosen = rng.random(len(things)) < share
        way, direction = rng.uniform(0.4, 1.0, len(things)), rng.uniform(-np.pi, np.pi, len(things))
        shift = way[:, np.newaxis] * np.column_stack((np.cos(direction), np.sin(direction)))
        things[chosen, :2] += shift[chosen]
    boxes[:, 4] += np.where(
        rng.random(len(boxes)) < share, rng.uniform(0.0, np.pi, len(boxes)), 0.0
    )
    return replace(world, boxes=boxes, circles=circles)


def _read_back(slam_map: SlamMap) -> SlamMap:
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "map.csmap"
        slam_map.save(path)
        return load_map(path)
