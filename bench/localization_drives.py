"""Localization of drives through one place in each other's maps: fixes, found, false, tracked and time.

Run as ``python bench/localization_drives.py CACHE LOG...`` on logs that curvescan reads, or on CMU's
``robotdata*.log.gz``. Each log makes a map, kept in CACHE; every other log is localized in it. With ``--prior`` also
with an initial pose 1 m and 20 deg off, with ``--plain`` also in the map's cells alone, with ``--halves`` the halves of
each log in each other's maps. No truth is needed: right fixes put one map on the other alike, and the placement that
most poses of both drives support is the reference. Of halves it is the map of the whole log, seen from the keyframe that lies nearest,
so that bending elsewhere does not count.
"""

from __future__ import annotations

import argparse
import gzip
import itertools
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

import curvescan as cs
from curvescan import se2
from curvescan.editing.operations import map_points
from curvescan.io.arrays.memory import MemoryLog
from curvescan.mapping.map_server import read_map, write_map
from curvescan.odometry import StepOutcome
from curvescan.types import Bools, Floats, Ints, Pose

SAME_M, SAME_RAD = 1.0, np.radians(10.0)
"""A pose farther from the reference than this is false, metres and radians: maps made apart bend by some decimetres."""

SHOWN, SHOWN_M = 0.8, 0.2
"""A map shows a scan of which this share of the readings lies this near to readings of its keyframes, metres."""

PRIOR_OFF, PRIOR_SIGMA = np.array([0.8, 0.6, np.radians(20.0)]), np.array([0.7, 0.7, np.radians(15.0)])
"""An initial pose is so far off, 1 m and 20 deg, and is said to be so uncertain, x, y, theta."""


def read_drive(path: Path) -> cs.Log:
    """Return a log; CMU's lines ``L x y theta xl yl thetal r1..r180 t`` (centimetres, radians) are read here."""
    if not path.name.startswith("robotdata"):
        return cs.read_log(path)
    with gzip.open(path, "rt") as file:
        rows = np.array([line.split()[1:] for line in file if line.startswith("L ")], dtype=np.float64)
    ranges, laser = 0.01 * rows[:, 6:-1], rows[:, 3:6] * (0.01, 0.01, 1.0)
    return cs.log_from_arrays(
        zip(rows[:, -1], ranges, strict=True),
        angle_min=-np.pi / 2.0,
        angle_increment=np.pi / 180.0,
        range_max=81.8,
        odometry=laser,
        name=path.name.removesuffix(".log.gz"),
    )


@dataclass(frozen=True, eq=False, kw_only=True)
class Drive:
    """A log, its map, and where its scans were in that map."""

    log: cs.Log
    slam_map: cs.SlamMap
    poses: Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class Localized:
    """The steps of a drive in the map of another."""

    outcomes: tuple[StepOutcome, ...]
    poses: Pose
    seconds: Floats

    @property
    def is_known(self) -> Bools:
        """(n,) whether a pose was given."""
        known: Bools = np.isfinite(self.poses[:, 0])
        return known

    @property
    def fixes(self) -> Ints:
        """Scans at which the sensor was found, elsewhere than the track had it or for the first time."""
        return np.flatnonzero([outcome is StepOutcome.FOUND for outcome in self.outcomes])


def halves_of(log: cs.Log) -> list[cs.Log]:
    """Return the halves of a log."""
    scans, wheels, n = list(log), log.odometry, len(log) // 2
    parts = []
    for k, part in enumerate((slice(0, n), slice(n, 2 * n))):
        odometry = None
        if wheels is not None:
            odometry = cs.Trajectory(stamps=wheels.stamps[part], poses=wheels.poses[part])
        parts.append(MemoryLog(scans=tuple(scans[part]), odometry=odometry, name=f"{log.name}-{k + 1}"))
    return parts


def make_drive(log: cs.Log, cache: Path) -> Drive:
    """Return a drive with its map by SLAM, from the cache where it was made before."""
    file, track = cache / f"{log.name}.csmap", cache / f"{log.name}.npy"
    if not track.exists():
        run = cs.run(log, engine="slam")
        assert run.map is not None
        run.map.save(file)
        np.save(track, run.trajectory.poses)
    return Drive(log=log, slam_map=cs.load_map(file), poses=np.load(track))


def localized(
    drive: Drive, slam_map: cs.SlamMap | cs.OccupancyGrid, initial_pose: cs.UncertainPose | None = None
) -> Localized:
    """Return the steps of a drive in a map."""
    given = {} if initial_pose is None else {"initial_pose": initial_pose}
    started = time.process_time()
    run = cs.localize(drive.log, slam_map, **given)
    seconds = np.full(len(run.steps), (time.process_time() - started) / max(len(run.steps), 1))
    return Localized(
        outcomes=tuple(step.outcome for step in run.steps),
        poses=np.array([step.pose for step in run.steps]),
        seconds=seconds,
    )


def plain_map_of(drive: Drive, cache: Path) -> cs.OccupancyGrid:
    """Return the map of a drive as its map.pgm and map.yaml have it: free, occupied or unknown."""
    write_map(cache, drive.slam_map.occupancy(), drive.log.name)
    return read_map(cache / f"{drive.log.name}.yaml")


def placements(drive: Drive, found: Localized, chosen: Ints) -> Pose:
    """Return (n, 3) poses of the drive's own map in the other map, by some of its scans."""
    placed: Pose = se2.compose(found.poses[chosen], se2.between(drive.poses[chosen], np.zeros(3)))
    return placed


def is_same(drive: Drive, found: Localized, placement: Pose) -> Bools:
    """Return (n,) whether each pose lies where a placement of the maps has its scan; of unknown poses False."""
    x, y, theta = se2.between(se2.compose(placement, drive.poses), found.poses).T
    same: Bools = (np.hypot(x, y) < SAME_M) & (np.abs(theta) < SAME_RAD)
    return same


def placement_of(drive: Drive, found: Localized, other: Drive, back: Localized) -> Pose:
    """Return the placement of a drive's map in another's that both drives support most; NaN where neither was found.

    One way alone may be false in most of its poses. found: The drive in the other's map; back: the other in its map.
    """
    known = np.flatnonzero(found.is_known), np.flatnonzero(back.is_known)
    each = np.vstack([placements(drive, found, _some(known[0])), se2.inverse(placements(other, back, _some(known[1])))])
    if not len(each):
        return np.full(3, np.nan)
    shares = [
        float(np.mean(is_same(drive, found, placement)) + np.mean(is_same(other, back, se2.inverse(placement))))
        for placement in each
    ]
    best: Pose = each[int(np.argmax(shares))]
    return best


def _some(rows: Ints) -> Ints:
    some: Ints = rows[np.linspace(0, len(rows) - 1, min(len(rows), 60)).astype(int)]
    return some


def same_as_whole(own: Pose, other: Drive, other_in_whole: Pose) -> Callable[[Localized], Bools]:
    """Return what says whether poses lie where the map of the whole log has them, from the nearest keyframe.

    own (n, 3), other_in_whole (m, 3): Poses of the scans of both halves in that map.
    """

    def same(found: Localized) -> Bools:
        keyframes = other.slam_map.poses
        nearest = np.argmin(np.hypot(*(np.nan_to_num(found.poses)[:, np.newaxis] - keyframes)[..., :2].T), axis=0)
        there = other_in_whole[other.slam_map.indices[nearest]]
        in_whole = se2.compose(there, se2.between(keyframes[nearest], found.poses))
        x, y, theta = se2.between(own, in_whole).T
        is_near: Bools = (np.hypot(x, y) < SAME_M) & (np.abs(theta) < SAME_RAD)
        return is_near

    return same


def in_map_of(other: Drive, own: Pose, other_in_whole: Pose) -> Pose:
    """Return (n, 3) where the map of one half has the scans of the other, each by the keyframe that lies nearest.

    own (n, 3), other_in_whole (m, 3): Poses of the scans of both halves in the map of the whole.
    """
    there = other_in_whole[other.slam_map.indices]
    nearest = cKDTree(there[:, :2]).query(own[:, :2])[1]
    poses: Pose = se2.compose(other.slam_map.poses[nearest], se2.between(there[nearest], own))
    return poses


def shown_in(log: cs.Log, other: Drive, poses: Pose) -> Bools:
    """Return (n,) which scans a map shows, by their poses in it: SHOWN of their readings are on what its scans saw."""
    seen = cKDTree(map_points(other.slam_map))
    ends = (se2.transform(pose, scan.points[scan.valid]) for scan, pose in zip(log, poses, strict=True))
    return np.array([len(p) > 0 and np.mean(seen.query(p)[0] < SHOWN_M) >= SHOWN for p in ends])


def line_of(name: str, found: Localized, same: Callable[[Localized], Bools], shown: Bools) -> str:
    """Return a row of the table, and say where false fixes are."""
    known, fixes = found.is_known, found.fixes
    false = known & ~same(found)
    first = int(np.argmax(known)) if known.any() else -1
    # a fix is false where the pose given with it is
    n_false = int(np.count_nonzero(false[fixes]))
    where = ", ".join(str(k) for k in fixes[false[fixes]].tolist()) if n_false else ""
    return (
        f"| {name} | {len(fixes)} | {n_false} | {first} | {np.mean(known):.1%} | {np.count_nonzero(false)} | "
        f"{1e3 * found.seconds.mean():.1f} | {np.mean(shown):.1%} | "
        f"{np.mean((known & ~false)[shown]) if shown.any() else np.nan:.1%} | {where}"
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Print a table of all pairs."""
    parser = argparse.ArgumentParser(prog="python bench/localization_drives.py")
    parser.add_argument("cache", type=Path)
    parser.add_argument("logs", type=Path, nargs="+")
    parser.add_argument("--prior", action="store_true", help="also with an initial pose 1 m and 20 deg off")
    parser.add_argument("--plain", action="store_true", help="also in map.pgm and map.yaml alone")
    parser.add_argument("--halves", action="store_true", help="halves of each log in each other's maps")
    parser.add_argument("--only", help="a pair, such as 4,2")
    given = parser.parse_args(arguments)
    given.cache.mkdir(parents=True, exist_ok=True)
    logs = [read_drive(path) for path in given.logs]
    wholes = [make_drive(log, given.cache) for log in logs] if given.halves else []
    logs = [half for log in logs for half in halves_of(log)] if given.halves else logs
    drives = [make_drive(log, given.cache) for log in logs]
    # of each half, where its scans are in the map of the whole
    parts = [whole.poses[k * (len(whole.poses) // 2) :][: len(whole.poses) // 2] for whole in wholes for k in (0, 1)]
    sys.stdout.write(
        "| drive in map | fixes | false | first at scan | with a pose | false poses | ms a scan | shown | of it right |\n"
    )

    totals: defaultdict[str, Ints] = defaultdict(lambda: np.zeros(7, dtype=np.int64))

    @cache
    def way(i: int, j: int) -> Localized:
        return localized(drives[i], drives[j].slam_map)

    for i, j in itertools.permutations(range(len(drives)), 2):
        if (given.only and given.only != f"{i + 1},{j + 1}") or (given.halves and i // 2 != j // 2):
            continue
        drive, other = drives[i], drives[j]
        found = way(i, j)
        if given.halves:
            same = same_as_whole(parts[i], other, parts[j])
            there = in_map_of(other, parts[i], parts[j])
        else:
            placement = placement_of(drive, found, other, way(j, i))
            same = partial(is_same, drive, placement=placement)
            there = se2.compose(placement, drive.poses)
        name, is_placed = f"{i + 1} in {j + 1}", not np.isnan(there).any()
        shown = shown_in(drive.log, other, there) if is_placed else np.zeros(len(there), dtype=np.bool_)

        maps = [("map.csmap", other.slam_map)] + [("plain map", plain_map_of(other, given.cache))] * given.plain
        rows = [(kind, found if kind == "map.csmap" else localized(drive, where)) for kind, where in maps]
        if given.prior and is_placed:
            prior = cs.UncertainPose(there[0] + PRIOR_OFF, np.diag(PRIOR_SIGMA**2))
            rows += [(f"{kind}, initial pose", localized(drive, where, prior)) for kind, where in maps]
        for kind, row in rows:
            is_right, fixes = row.is_known & same(row), row.fixes
            count = (len(fixes), np.sum(~is_right[fixes]), np.sum(row.is_known & ~is_right), np.sum(row.is_known))
            totals[kind] += [*count, len(is_right), np.sum(is_right & shown), np.sum(shown)]
            off = np.hypot(*(row.poses - found.poses)[:, :2].T)
            more = "" if row is found else f" {np.nanmedian(off):.3f} m from the pose in map.csmap"
            sys.stdout.write(line_of(f"{name}, {kind}", row, same, shown) + more + "\n")
        sys.stdout.flush()
    for kind, (n_fixes, n_false, n_poses, n_known, n, n_right, n_shown) in totals.items():
        sys.stdout.write(
            f"all, {kind}: {n_fixes} fixes, {n_false} false, {n_poses} false poses, {n_known / n:.1%} with a pose, "
            f"{n_right / max(n_shown, 1):.1%} of the shown right\n"
        )


if __name__ == "__main__":
    main()
