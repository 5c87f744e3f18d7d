"""Maps merged and compared: halves of logs merged beside the whole, two buildings refused, change lists of floors.

``python bench/edited_maps.py merge CACHE LOG RELATIONS [LOG RELATIONS]...`` makes maps of the halves of each log and of
the whole, joins the halves, and measures all against the relations; then it tries to join halves of different logs.
``python bench/edited_maps.py changes --floors 6`` moves furniture and closes doors of simulated floors between two
drives, and counts how much of the change list is true and how much of the truth is in it.
"""

from __future__ import annotations

import argparse
import contextlib
import itertools
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import curvescan as cs
from curvescan import se2
from curvescan.editing import operations
from curvescan.editing.merging import in_one_frame, merged
from curvescan.io.trajectories.relations import read_relations
from curvescan.mapping.occupancy import OccupancyBuilder, OccupancyGrid
from curvescan.simulation import World, build_world
from curvescan.types import Bools, Floats, Points, Pose
from localization_drives import Drive, halves_of, make_drive
from localization_tasks import with_closed_doors

MOVED_SHARE, MOVED_M = 0.2, (0.5, 1.5)
"""Share of the furniture that is moved, and how far, metres."""

LONGEST_M = 1.4
"""Boxes longer than this are walls, metres."""

NEW_M, ON_M = 0.2, 0.05
"""A reading is of something new where the old world has nothing within NEW_M and the new one something within ON_M."""

N_SEEN = 20
"""A thing that changed is to be found when so many readings are of it, where the other drive saw free space."""

REACH_M = 0.2
"""A reported box and a reading belong together within this, metres."""


def joined(one: Drive, other: Drive, both: cs.SlamMap) -> cs.Trajectory:
    """Return the poses of all scans of two drives in their merged map: each moves with the keyframe before it."""
    parts = []
    for k, drive in enumerate((one, other)):
        of_drive = both.poses[both.sessions == k]
        at = np.maximum(np.searchsorted(drive.slam_map.indices, np.arange(len(drive.poses)), side="right") - 1, 0)
        parts.append(se2.compose(of_drive[at], se2.between(drive.slam_map.poses[at], drive.poses)))
    stamps = [scan.stamp for drive in (one, other) for scan in drive.log]
    return cs.Trajectory(stamps=np.array(stamps), poses=np.concatenate(parts))


def merge(cache: Path, pairs: Sequence[tuple[Path, Path]]) -> None:
    """Print errors of relations: the whole log, and its merged halves; then what halves of different logs give."""
    print("| log | relations between the halves | whole | merged | all: whole | merged | keyframes | seconds |")
    halves: list[list[Drive]] = []
    for path, relations in pairs:
        log = cs.read_log(path)
        whole = make_drive(log, cache)
        drives = [make_drive(half, cache) for half in halves_of(log)]
        halves.append(drives)
        started = time.process_time()
        both = merged(drives[0].slam_map, drives[1].slam_map)
        seconds = time.process_time() - started
        track = joined(*drives, both)
        of_whole = cs.Trajectory(stamps=np.array([scan.stamp for scan in log]), poses=whole.poses)
        given = read_relations(relations)
        middle = track.stamps[len(drives[0].poses)]
        is_across = (np.minimum(given.first_stamps, given.second_stamps) < middle) & (
            np.maximum(given.first_stamps, given.second_stamps) >= middle
        )
        across = replace(
            given,
            first_stamps=given.first_stamps[is_across],
            second_stamps=given.second_stamps[is_across],
            poses=given.poses[is_across],
        )
        cells = [error_text(t, r) for r in (across, given) for t in (of_whole, track)]
        print(f"| {log.name} | {is_across.sum()} | {' | '.join(cells)} | {len(both)} | {seconds:.1f} |", flush=True)
    for a, b in itertools.combinations(range(len(halves)), 2):
        for one, other in itertools.product(halves[a], halves[b]):
            print(f"{one.log.name} and {other.log.name}: {joined_or_not(one.slam_map, other.slam_map)}", flush=True)


def error_text(track: cs.Trajectory, relations: cs.Relations) -> str:
    """Return mean errors of relations, metres and degrees."""
    found = cs.evaluate(track, relations=relations)
    return f"{np.mean(found.translation):.4f} m, {np.degrees(np.mean(found.rotation)):.3f} deg"


def joined_or_not(one: cs.SlamMap, other: cs.SlamMap) -> str:
    """Return what joining two maps gives: the sentence of the refusal, or that they were joined."""
    try:
        merged(one, other)
    except cs.InvalidArgumentError as error:
        return f"refused: {error}"
    return "JOINED"


def refurnished(world: World, seed: int, n_doors: int) -> World:
    """Return a world with a share of its furniture moved to free places, and some doors closed."""
    rng = np.random.default_rng([seed, 25])
    boxes = world.boxes.copy()
    for k in np.flatnonzero(boxes[:, 2:4].max(axis=1) < LONGEST_M).tolist():
        if rng.random() >= MOVED_SHARE:
            continue
        for _ in range(50):
            way, direction = rng.uniform(*MOVED_M), rng.uniform(-np.pi, np.pi)
            place = boxes[k, :2] + way * np.array([np.cos(direction), np.sin(direction)])
            if world.is_free(place[np.newaxis], 0.5 * float(np.hypot(*boxes[k, 2:4])) + 0.1)[0]:
                boxes[k, :2] = place
                break
    return with_closed_doors(replace(world, boxes=boxes), n_doors, seed)


def drive_through(world: World, seed: int) -> tuple[cs.Log, cs.SlamMap]:
    """Return a drive through a world and its map."""
    log = cs.simulate(world, seed=seed, odometry_noise=None, n_scans=700)
    run = cs.run(log, engine="slam")
    assert run.map is not None
    return log, run.map


def new_readings(log: cs.Log, world: World, other_world: World, seen: OccupancyGrid) -> Points:
    """Return readings on what the other world does not have where the other drive saw free space, world frame."""
    points = []
    for scan, pose in zip(log, log.truth.poses, strict=True):
        there = se2.transform(pose, scan.points[scan.valid])
        points.append(there[(other_world.distance(there) > NEW_M) & (world.distance(there) < ON_M)])
    there = np.concatenate(points)
    cells = np.floor((there - seen.origin) / seen.resolution).astype(int)
    rows, columns = seen.log_odds.shape
    is_inside = (cells >= 0).all(axis=1) & (cells[:, 0] < columns) & (cells[:, 1] < rows)
    there, cells = there[is_inside], cells[is_inside]
    return there[seen.is_free[cells[:, 1], cells[:, 0]]]


def true_grid(log: cs.Log) -> OccupancyGrid:
    """Return the occupancy of a drive by its true poses, world frame."""
    builder = OccupancyBuilder()
    for scan, pose in zip(log, log.truth.poses, strict=True):
        builder.add(scan, pose)
    return builder.grid()


def things_of(points: Points, world: World) -> Floats:
    """Return (n,) which primitive of a world each point is on, the nearest one."""
    one_by_one = [World(boxes=world.boxes[k : k + 1]) for k in range(len(world.boxes))]
    one_by_one += [World(circles=world.circles[k : k + 1]) for k in range(len(world.circles))]
    return np.argmin([one.distance(points) for one in one_by_one], axis=0)


def near_box(points: Points, box: operations.Box) -> Bools:
    """Return (n,) which points lie in a box or within reach of it."""
    low, high = np.array(box[:2]) - REACH_M, np.array(box[2:]) + REACH_M
    near: Bools = ((points >= low) & (points <= high)).all(axis=1)
    return near


def changes_of_floor(world: str, seed: int, n_doors: int) -> tuple[int, int, int, int]:
    """Return how many changes were reported, how many of them are true, how many there are, and how many were found."""
    before = build_world(world, seed)
    log_a, map_a = drive_through(before, seed)
    for attempt in itertools.count():
        after = refurnished(before, seed + 100 * attempt, n_doors)
        # what was moved may be in the way of the route
        with contextlib.suppress(cs.InvalidArgumentError):
            log_b, map_b = drive_through(after, seed + 1000)
            break
    one, other = in_one_frame(map_a, map_b)
    found = operations.changes(one.occupancy(), other.occupancy())
    # the changes are in the frame of the first map, whose first keyframe is the drive's first scan
    frame: Pose = log_a.truth.poses[0]
    n_true = n_real = n_found = 0
    for kind, log, here, there, seen in (
        ("appeared", log_b, after, before, true_grid(log_a)),
        ("gone", log_a, before, after, true_grid(log_b)),
    ):
        points = new_readings(log, here, there, seen)
        things = things_of(points, here) if len(points) else np.zeros(0)
        points = se2.transform(se2.inverse(frame), points)
        boxes = [change.box for change in found if change.kind == kind]
        n_true += sum(bool(near_box(points, box).any()) for box in boxes)
        for thing in np.unique(things).tolist():
            own = points[things == thing]
            if len(own) < N_SEEN:
                continue
            n_real += 1
            n_found += any(near_box(own, box).any() for box in boxes)
    return len(found), n_true, n_real, n_found


def changes(n_floors: int, first: int) -> None:
    """Print precision and recall of change lists."""
    print("| floor | doors closed | changes listed | true | things that changed | found | seconds |")
    total = np.zeros(4, dtype=int)
    for world, n_doors in (("office", 2), ("office-floor", 3)):
        for seed in range(first, first + n_floors):
            started = time.process_time()
            counts = changes_of_floor(world, seed, n_doors)
            total += counts
            listed, true, real, found = counts
            seconds = time.process_time() - started
            print(f"| {world} {seed} | {n_doors} | {listed} | {true} | {real} | {found} | {seconds:.0f} |", flush=True)
    print(f"precision {total[1] / total[0]:.1%} of {total[0]}, recall {total[3] / total[2]:.1%} of {total[2]}")


def main(arguments: Sequence[str] | None = None) -> None:
    """Print what was asked for."""
    parser = argparse.ArgumentParser(prog="python bench/edited_maps.py")
    tasks = parser.add_subparsers(dest="task", required=True)
    of_merge = tasks.add_parser("merge")
    of_merge.add_argument("cache", type=Path)
    of_merge.add_argument("files", type=Path, nargs="+", metavar="LOG RELATIONS")
    of_changes = tasks.add_parser("changes")
    of_changes.add_argument("--floors", type=int, default=6)
    of_changes.add_argument("--first", type=int, default=70)
    given = parser.parse_args(arguments)
    if given.task == "merge":
        given.cache.mkdir(parents=True, exist_ok=True)
        merge(given.cache, list(zip(given.files[::2], given.files[1::2], strict=True)))
    else:
        changes(given.floors, given.first)


if __name__ == "__main__":
    main()
