"""Floors with truth, odometry and SLAM: `python bench/floors.py [--kinds ACH] [--floors 20] [--first 0] [--wheels]`.

A: corridors 600 m long whose doors stand back by a hand, a laser of 1 deg and 2.5 Hz, about 1,000 m driven; H: the same
with bare stretches. B: an office floor, two laps, the second the other way; C: the same seen 4 m far with 30 mm of
noise; E: the same with three people around, furniture moved and doors closed between the laps. D: a hall of equal
shelves and pillars. F: 36 rooms all alike on a ring. G: a flat, and a laser that spins while it drives. Wheels, if any,
drift by 2 to 5 % of the way and turn by 1 to 2 deg a metre.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterator
from dataclasses import dataclass, fields, replace

import numpy as np

import curvescan as cs
from closures import FALSE_M, FALSE_RAD
from curvescan import se2
from curvescan.evaluation.trajectory_errors import ate
from curvescan.io.arrays.memory import MemoryLog
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.simulation import SENSORS, Drive, Sensor, World, build_world, simulate
from curvescan.simulation.buildings.floorplan import WALL_THICKNESS, Door, Room, furnish, walls_of
from curvescan.simulation.driving.motion import drive_route
from curvescan.simulation.driving.pursuit import at_start, follow, smooth
from curvescan.slam import SlamMap
from curvescan.slam.pose_graph.graph import EdgeKind
from curvescan.types import Floats, Points, Pose
from localization_tasks import FLOORS, in_the_middle, with_closed_doors, with_moved_things

_DRIVE = Drive(speed=0.8)

_SICK = SENSORS["sick-lms200"]
_COARSE = replace(_SICK, name="coarse", n_beams=181, angle_increment=np.pi / 180.0, range_max=30.0, period=0.4)
_SENSORS: dict[str, Sensor] = {
    "A": _COARSE, "B": _SICK, "C": FLOORS["C"]["sensor"], "D": SENSORS["hokuyo-270"], "E": _SICK, "F": _SICK,
    "G": FLOORS["G"]["sensor"], "H": _COARSE,
}  # fmt: skip

_WAY = 1000.0
"""Driven along corridors, metres."""

_BACK_M, _AFTER = 2.0, 60.0
"""A keyframe is back where it is this near, metres, to one of this long before, seconds: for recall."""

_FOUND_M = 0.2
"""A place is found again where the way to it is off by less than this, metres."""

_WRONG = 4.0
"""A step of the odometry is wrong beyond so many standard deviations."""


# worlds and drives


def corridors(seed: int, bare: float) -> tuple[World, Points]:
    """Return a grid of corridors around nine blocks, and the crossings of a drive.

    bare: how long each wall has no door, metres.
    """
    rng = np.random.default_rng([seed, 31])
    width = rng.uniform(1.8, 2.6)
    at = np.array([np.concatenate(([0.0], np.cumsum(rng.uniform(22.0, 28.0, 3)))) for _ in range(2)])
    half, walls = 0.5 * width, []
    for x0, x1 in zip(at[0], at[0][1:], strict=False):
        for y0, y1 in zip(at[1], at[1][1:], strict=False):
            walls.append(_block(x0 + half, y0 + half, x1 - half, y1 - half, 1.0, bare, rng))
    walls.append(_block(at[0, 0] - half, at[1, 0] - half, at[0, -1] + half, at[1, -1] + half, -1.0, bare, rng))
    place, last, way, driven = np.array([0, 0]), np.array([-1, -1]), [], 0.0
    while driven < _WAY:
        way.append([at[0, place[0]], at[1, place[1]]])
        ahead = [place + step for step in ([1, 0], [0, 1], [-1, 0], [0, -1])]
        ahead = [one for one in ahead if (one >= 0).all() and (one < 4).all() and (one != last).any()]
        last, place = place, ahead[int(rng.integers(len(ahead)))]
        driven += float(np.hypot(at[0, place[0]] - way[-1][0], at[1, place[1]] - way[-1][1]))
    return World(name="corridors", walls=np.vstack(walls)), np.array(way)


def _block(x0: float, y0: float, x1: float, y1: float, inward: float, bare: float, rng: np.random.Generator) -> Floats:
    """Return (n, 4) walls round a rectangle, counter-clockwise, with doors set back.

    inward: 1 into the rectangle, -1 out of it.
    """
    corners = np.array([[x0, y0], [x1, y0], [x1, y1], [x0, y1]])
    line = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        length = float(np.hypot(*(b - a)))
        along = (b - a) / length
        back = inward * np.array([-along[1], along[0]])
        line.append(a)
        s, gap = rng.uniform(1.0, 3.0), rng.uniform(0.0, length) if bare else length
        while s < length - 1.5:
            if gap < s < gap + bare:
                s = gap + bare
                continue
            deep = rng.uniform(0.08, 0.3) * back
            line += [a + s * along, a + s * along + deep, a + (s + 0.9) * along + deep, a + (s + 0.9) * along]
            s += 0.9 + rng.uniform(2.0, 5.0)
    points = np.array(line)
    return np.hstack((points, np.roll(points, -1, axis=0)))


def offices(seed: int) -> World:
    """Return a floor of 40 by 30 m: a corridor all round, offices outside it, larger rooms inside, most doors open."""
    rng = np.random.default_rng([seed, 35])
    length, deep, wide = rng.uniform(38.0, 42.0), rng.uniform(4.5, 5.5), rng.uniform(1.8, 2.4)
    core = 30.0 - 2.0 * (deep + wide)
    rooms, doors, way = [], [], []
    for y0, y1, at, y, least, most in (
        (0.0, deep, deep, deep + 0.5 * wide, 3.0, 5.0),
        (deep + wide, deep + wide + 0.5 * core, deep + wide, deep + 0.5 * wide, 5.0, 9.0),
        (deep + wide + 0.5 * core, 30.0 - deep - wide, 30.0 - deep - wide, 30.0 - deep - 0.5 * wide, 5.0, 9.0),
        (30.0 - deep, 30.0, 30.0 - deep, 30.0 - deep - 0.5 * wide, 3.0, 5.0),
    ):
        x, stops = wide, []
        while x < length - wide - 0.1:
            end = x + rng.uniform(least, most)
            end = length - wide if end > length - wide - least else end
            rooms.append(Room(x, y0, end, y1))
            if rng.random() < 0.8:
                doors.append(Door(rng.uniform(x + 0.8, end - 0.8), at, rng.uniform(0.9, 1.1), is_vertical=False))
                inside = 0.5 * (y0 + y1)
                stops.append([[doors[-1].x, y], [doors[-1].x, at + np.sign(inside - at) * 1.2], [doors[-1].x, y]])
            # those inside, at the ends of the floor, open to the corridors there as well
            doors += [
                Door(wall, rng.uniform(y0 + 1.0, y1 - 1.0), 1.0, is_vertical=True)
                for wall in (x, end)
                if wall in (wide, length - wide) and least == 5.0
            ]
            x = end
        way.append([stop for stop in stops if rng.random() < 0.5])
    lower = sorted(way[0] + way[1], key=lambda stop: stop[0][0])
    upper = sorted(way[2] + way[3], key=lambda stop: -stop[0][0])
    x0, x1, low, high = 0.5 * wide, length - 0.5 * wide, deep + 0.5 * wide, 30.0 - deep - 0.5 * wide
    route = [[x0, low], *sum(lower, []), [x1, low], [x1, high], *sum(upper, []), [x0, high]]  # noqa: RUF017
    ways = [
        Room(0.0, deep, length, deep + wide),
        Room(0.0, 30.0 - deep - wide, length, 30.0 - deep),
        Room(0.0, deep + wide, wide, 30.0 - deep - wide),
        Room(length - wide, deep + wide, length, 30.0 - deep - wide),
    ]
    openings = [Door(x, y, wide - 0.1, is_vertical=False) for x in (x0, x1) for y in (deep + wide, 30.0 - deep - wide)]
    world = walls_of([*rooms, *ways], [*doors, *openings])
    for room in rooms:
        world += furnish(room, doors, rng)
    # doors that are shut, frames and cupboards: steps of 8 to 20 cm in the corridors' walls, where no door is open
    steps = []
    for wall in world.boxes[np.isclose(world.boxes[:, 2:4], WALL_THICKNESS).any(axis=1)].tolist():
        x, y, along, across, _ = wall
        is_level = along > across
        sides = [side for side in (-1.0, 1.0) if any(_holds(one, x, y, side, is_level) for one in ways)]
        at = -0.5 * max(along, across) + rng.uniform(0.6, 2.5)
        while sides and at < 0.5 * max(along, across) - 0.6:
            out = float(rng.choice(sides)) * 0.5 * WALL_THICKNESS
            wide_m, deep_m = rng.uniform(0.8, 1.2), 2.0 * rng.uniform(0.08, 0.2)
            steps.append([x + at, y + out, wide_m, deep_m, 0.0] if is_level else [x + out, y + at, deep_m, wide_m, 0.0])
            at += rng.uniform(2.0, 5.0)
    frames = World(boxes=np.array(steps)).segments
    world = replace(world, walls=np.vstack((world.walls, frames)))
    floor = np.array([[0.0, 0.0], [length, 0.0], [length, 30.0], [0.0, 30.0]])
    return replace(world, name="offices", floor=floor, route=np.array(route))


def _holds(room: Room, x: float, y: float, side: float, is_level: bool) -> bool:
    """Return whether a room holds what lies half a metre beside a wall."""
    x, y = (x, y + 0.5 * side) if is_level else (x + 0.5 * side, y)
    return room.x0 < x < room.x1 and room.y0 < y < room.y1


def shelves(seed: int) -> World:
    """Return a hall of equal shelves in rows, pillars between them, and a way through it."""
    rng = np.random.default_rng([seed, 32])
    n, pitch, long = int(rng.integers(4, 7)), rng.uniform(3.6, 4.4), rng.uniform(8.0, 11.0)
    size = np.array([2.0 * long + 9.0, n * pitch + 3.0])
    outline = [[0.0, 0.0], [size[0], 0.0], [size[0], size[1]], [0.0, size[1]]]
    rows = [3.0 + k * pitch for k in range(n)]
    middles = [3.0 + 0.5 * long, 6.0 + 1.5 * long]
    boxes = [[x, y, long, 1.0, 0.0] for x in middles for y in rows]
    boxes += [[4.5 + long, y, 0.4, 0.4, 0.0] for y in rows]
    way: list[list[float]] = []
    for k, y in enumerate(rows[1:]):
        ends = [1.5, size[0] - 1.5]
        way += [[x, y - 0.5 * pitch] for x in (ends if k % 2 else ends[::-1])]
    corners = np.array(outline)
    walls = np.hstack((corners, np.roll(corners, -1, axis=0)))
    return World(name="shelves", walls=walls, boxes=np.array(boxes), floor=corners, route=np.array([*way, *way]))


def ring(seed: int) -> World:
    """Return 36 rooms all alike around the corridors of a ring, and a way round it twice into some of them."""
    rng = np.random.default_rng([seed, 33])
    width, deep, wide = rng.uniform(3.4, 4.2), 4.0, 2.0
    side = 9 * width
    inside = furnish(Room(0.0, 0.0, width, deep), [Door(0.5 * width, 0.0, 1.0, is_vertical=False)], rng)
    rooms, doors, things, way = [], [], World(), []
    middle = np.array([0.5 * side, 0.5 * side])
    for turn in (0.0, 0.5 * np.pi, np.pi, -0.5 * np.pi):
        pose = np.array([*(middle + se2.transform(np.array([0.0, 0.0, turn]), -middle[np.newaxis])[0]), turn])
        for k in range(9):
            own = np.array([(k + 1) * width, -wide, np.pi])  # its door looks at the corridor, away from which it lies
            local = se2.transform(own, np.array([[0.0, 0.0], [width, deep], [0.5 * width, 0.0], [0.5 * width, 0.9]]))
            corner = se2.transform(pose, local)
            (ax, ay), (bx, by) = np.minimum(corner[0], corner[1]), np.maximum(corner[0], corner[1])
            rooms.append(Room(ax, ay, bx, by))
            doors.append(Door(*corner[2].tolist(), 1.0, is_vertical=abs(np.sin(turn)) > 0.5))
            things += inside.moved(se2.compose(pose, own))
            front = se2.transform(pose, np.array([[(k + 0.5) * width, -0.5 * wide]]))[0]
            way.append(front.tolist())
            if rng.random() < 0.3:
                way += [corner[3].tolist(), front.tolist()]
    hall = np.array([[0.0, 0.0], [side, 0.0], [side, side], [0.0, side]])
    corners = np.hstack((hall, np.roll(hall, -1, axis=0)))
    outer = hall + np.sign(hall - middle) * wide
    floor = middle + (hall - middle) * (0.5 * side + wide + deep) / (0.5 * side)
    walls = np.vstack((corners, _beyond(outer, wide)))
    world = walls_of(rooms, doors)
    return replace(world + things + World(walls=walls), name="ring", floor=floor, route=np.array([*way, *way]))


def _beyond(outer: Points, wide: float) -> Floats:
    """Return the walls that close the corners of a ring, where no room is."""
    walls = []
    for k, corner in enumerate(outer):
        for other in (outer[k - 1], outer[(k + 1) % 4]):
            along = (other - corner) / np.hypot(*(other - corner))
            walls.append([*corner, *(corner + wide * along)])
    return np.array(walls)


def recorded(kind: str, seed: int, *, has_wheels: bool) -> tuple[MemoryLog, Pose]:
    """Return the log of a floor, and (n, 3) its true poses, each in the middle of a sweep."""
    sensor = _SENSORS[kind]
    if kind in "AH":
        world, way = corridors(seed, bare=20.0 if kind == "H" else 0.0)
        line = smooth(way)
        states = list(follow(line, at_start(line), _DRIVE, 0.05))
        laps = [(world, np.array(states)[:: round(sensor.period / 0.05), :3], 0)]
    elif kind in "BCE":
        world = offices(seed)
        then = with_closed_doors(with_moved_things(world, 0.3, seed), 3, seed) if kind == "E" else world
        home = replace(then, route=np.roll(world.route, -1, axis=0)[::-1])
        there, back = (
            drive_route(one, _DRIVE, sensor.period, np.random.default_rng(seed)) for one in (world, home)
        )  # fmt: skip
        turn = np.linspace(there[-1], [*back[0, :2], there[-1, 2] + se2.wrap(back[0, 2] - there[-1, 2])], 20)
        n_people = 3 if kind == "E" else 0
        laps = [(world, there, n_people), (then, np.concatenate((turn[1:-1], back)), n_people)]
    elif kind == "G":
        world = build_world("office", seed)
        laps = [(world, drive_route(world, _DRIVE, sensor.period, np.random.default_rng(seed), 1500), 0)]
    else:
        world = {"D": shelves, "F": ring}[kind](seed)
        laps = [(world, drive_route(world, _DRIVE, sensor.period, np.random.default_rng(seed)), 0)]
    scans: list[cs.LaserScan] = []
    for k, (place, poses, n_people) in enumerate(laps):
        made = simulate(place, sensor=sensor, seed=2 * seed + k, n_people=n_people, poses=poses, odometry_noise=None)
        scans += [replace(scan, stamp=sensor.period * (len(scans) + i)) for i, scan in enumerate(made)]
    truth = np.concatenate([poses for _, poses, _ in laps])
    stamps = np.array([scan.stamp for scan in scans])
    wheels = Trajectory(stamps=stamps, poses=_drifting(truth, seed)) if has_wheels else None
    truth = in_the_middle(truth, scans[0], sensor.period)
    return MemoryLog(scans=tuple(scans), odometry=wheels, name=f"{kind} {seed}"), truth


def _drifting(truth: Pose, seed: int) -> Pose:
    """Return what wheels of a wrong size tell."""
    rng = np.random.default_rng([seed, 34])
    share, turn = rng.choice([-1.0, 1.0], 2) * (rng.uniform(0.02, 0.05), np.radians(rng.uniform(1.0, 2.0)))
    steps = se2.between(truth[:-1], truth[1:])
    steps[:, 2] += turn * np.hypot(steps[:, 0], steps[:, 1])
    steps[:, :2] *= 1.0 + share
    poses = np.zeros_like(truth)
    for k, step in enumerate(steps):
        poses[k + 1] = se2.compose(poses[k], step)
    return poses


# figures


@dataclass(frozen=True, kw_only=True)
class Figures:
    """What SLAM and its odometry make of one floor; lengths in metres."""

    odometry: float  # ATE
    odometry_worst: float
    wrong_steps: float  # share of the odometry's steps that are off by over 4 standard deviations
    odometry_nees: float  # of its last pose
    slam: float  # ATE
    worst: float
    nees: float  # of SLAM's last pose
    nees_median: float  # of its poses
    n_closures: int
    n_false: int
    same: float  # recall of places, going the same way
    opposite: float  # and the other way
    is_trusted: bool

    def __str__(self) -> str:
        return " | ".join(f"{name} {value:.3g}" for name, value in vars(self).items())


def judged(kind: str, seed: int, *, has_wheels: bool) -> tuple[Figures, str]:
    """Return the figures of one floor, and why the run is not trusted."""
    log, truth = recorded(kind, seed, has_wheels=has_wheels)
    run = cs.run(log, "slam", odometry_prior=has_wheels)
    true = se2.between(truth[0], truth)
    steps, found = run.steps, run.trajectory
    odometry = np.array([step.pose_odom for step in steps])
    motions = np.array([step.motion for step in steps[1:]])
    spread = np.array([step.motion_covariance for step in steps[1:]])
    off = se2.between(se2.between(true[:-1], true[1:]), motions)
    errors, odometry_errors = ate(found.poses, true), ate(odometry, true)
    assert found.covariances is not None
    nees = _nees(_off(found.poses, true), found.covariances)
    slam_map = run.map
    assert isinstance(slam_map, SlamMap)
    is_closure = (slam_map.kinds == EdgeKind.CLOSURE) & (slam_map.weights > 0.5)
    same, opposite = _recall(slam_map, found.stamps, true)
    last = _nees(_off(odometry[-1:], true[-1:]), steps[-1].covariance_odom[np.newaxis])
    return Figures(
        odometry=_rms(odometry_errors),
        odometry_worst=float(odometry_errors.max()),
        wrong_steps=float(np.mean(_nees(off, spread) > _WRONG**2)),
        odometry_nees=float(last[0]),
        slam=_rms(errors),
        worst=float(errors.max()),
        nees=float(nees[-1]),
        nees_median=float(np.median(nees[len(nees) // 4 :])),
        n_closures=int(np.count_nonzero(is_closure)),
        n_false=_n_false(slam_map, true, is_closure),
        same=same,
        opposite=opposite,
        is_trusted=run.verdict.is_trusted,
    ), "; ".join(run.verdict.reasons)


def _rms(errors: Floats) -> float:
    return float(np.sqrt(np.mean(errors**2)))


def _off(poses: Pose, true: Pose) -> Pose:
    off = poses - true
    off[:, 2] = se2.wrap(off[:, 2])
    return off


def _nees(off: Pose, covariances: Floats) -> Floats:
    """Return (n,) squared Mahalanobis distances; what is known exactly has none."""
    solved = np.linalg.solve(covariances + 1e-12 * np.eye(3), off[..., np.newaxis])[..., 0]
    return np.asarray(np.einsum("ni,ni->n", off, solved))


def _n_false(slam_map: SlamMap, true: Pose, is_closure: np.ndarray) -> int:
    """Return how many closures are false, in what they claim to measure."""
    scans = slam_map.indices[slam_map.ends[is_closure]]
    off = se2.between(se2.between(true[scans[:, 0]], true[scans[:, 1]]), slam_map.measured[is_closure])
    claimed = slam_map.edge_covariances[is_closure][:, :2, :2].max(axis=(1, 2)) < FALSE_M**2
    return int(
        np.count_nonzero(((np.hypot(off[:, 0], off[:, 1]) > FALSE_M) & claimed) | (np.abs(off[:, 2]) > FALSE_RAD))
    )


def _recall(slam_map: SlamMap, stamps: Floats, true: Pose) -> tuple[float, float]:
    """Return the share of keyframes back at a place that the map has there, the same way and the other way round."""
    scans = slam_map.indices
    seen: dict[bool, list[bool]] = {True: [], False: []}
    for j in range(len(scans)):
        earlier = np.flatnonzero(stamps[scans] < stamps[scans[j]] - _AFTER)
        way = se2.between(true[scans[earlier]], true[scans[j]])
        for is_same in (True, False):
            turned = np.abs(se2.wrap(way[:, 2]))
            near = np.hypot(way[:, 0], way[:, 1]) + np.where(turned < 1.0 if is_same else turned > 2.1, 0.0, np.inf)
            if not len(near) or near.min() > _BACK_M:
                continue
            k = int(np.argmin(near))
            mapped = se2.between(slam_map.poses[earlier[k]], slam_map.poses[j])
            seen[is_same].append(bool(np.hypot(*(mapped - way[k])[:2]) < _FOUND_M))
    same, opposite = (float(np.mean(one)) if one else float("nan") for one in (seen[True], seen[False]))
    return same, opposite


def lines(kinds: str, seeds: range, *, has_wheels: bool) -> Iterator[str]:
    """Yield a line a floor, and one a kind: medians, and how many floors are worse than the odometry, and trusted."""
    for kind in kinds:
        rows = []
        for seed in seeds:
            figures, why = judged(kind, seed, has_wheels=has_wheels)
            rows.append(figures)
            yield f"{kind} {seed}: {figures} {why}"
        means: dict[str, Callable[[list[float]], float]] = {"slam": np.mean, "odometry": np.mean, "n_false": np.sum}
        parts = [
            f"{one.name} {means.get(one.name, np.nanmedian)([getattr(row, one.name) for row in rows]):.3g}"
            for one in fields(Figures)
        ]
        n_worse = sum(row.slam > 1.05 * row.odometry + 0.005 for row in rows)
        yield f"SUMMARY {kind}, {len(rows)} floors: {' | '.join(parts)} | worse than the odometry {n_worse}"


def main() -> None:
    """Print the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--kinds", default="".join(_SENSORS))
    parser.add_argument("--floors", type=int, default=20)
    parser.add_argument("--first", type=int, default=0, help="seed of the first floor")
    parser.add_argument("--wheels", action="store_true")
    given = parser.parse_args()
    for line in lines(given.kinds, range(given.first, given.first + given.floors), has_wheels=given.wheels):
        print(line, flush=True)


if __name__ == "__main__":
    main()
