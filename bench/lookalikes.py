"""Lookalikes: floors made to deceive a search for loop closures: rooms all alike on both sides of two corridors that make a ring."""

from __future__ import annotations

from dataclasses import replace
from typing import Literal, TypeAlias, get_args

import numpy as np

from curvescan.errors import InvalidArgumentError
from curvescan.scan import LaserScan
from curvescan.simulation.buildings.floorplan import Door, Room, furnish, walls_of
from curvescan.simulation.buildings.world import World
from curvescan.simulation.driving.motion import drive_route
from curvescan.simulation.driving.pursuit import Drive
from curvescan.simulation.recording import simulate
from curvescan.simulation.sensing.sensors import choose_sensor
from curvescan.types import Pose

Deceit: TypeAlias = Literal["offices", "corridors", "people", "moved", "storeys"]
"""Rooms all alike; no room open to the corridors; people besides; furniture of half of the rooms moved in the second
lap; the second lap on another storey that is exactly like the first, and nothing seen on the stair."""

_N_STAIR = 30
"""Scans on the stair."""

_N_ROOMS = 3, 5
"""Rooms of a row: at least three, so that one has the same neighbour on both sides; not more than four, so that a floor
costs seconds."""

_DRIVE = Drive(speed=0.8)

_DEPTH, _CORRIDOR = 4.0, 2.0  # metres


def lookalike_floor(seed: int, *, deceit: Deceit = "offices", lap: int = 0) -> World:
    """Return a floor whose rooms are all alike."""
    if deceit not in get_args(Deceit):
        raise InvalidArgumentError(f"deceit must be one of {get_args(Deceit)}, got {deceit!r}")
    rng = np.random.default_rng(seed)
    n, width = int(rng.integers(*_N_ROOMS)), float(rng.uniform(3.4, 4.6))
    length = n * width
    low, middle, high = _CORRIDOR, _CORRIDOR + _DEPTH, _CORRIDOR + 2.0 * _DEPTH
    top = high + _CORRIDOR
    rooms = [Room(k * width, low, (k + 1) * width, middle) for k in range(n)]
    rooms += [Room(k * width, middle, (k + 1) * width, high) for k in range(n)]
    ring = [
        Room(-_CORRIDOR, 0.0, length + _CORRIDOR, low),
        Room(-_CORRIDOR, high, length + _CORRIDOR, top),
        Room(-_CORRIDOR, low, 0.0, high),
        Room(length, low, length + _CORRIDOR, high),
    ]
    openings = [
        Door(x, y, _CORRIDOR - 0.1, is_vertical=False)
        for x in (-0.5 * _CORRIDOR, length + 0.5 * _CORRIDOR)
        for y in (low, high)
    ]
    doors = [] if deceit == "corridors" else [
        Door(room.centre[0], low if room.y0 == low else high, 1.0, is_vertical=False)
        for room in rooms
    ]  # fmt: skip
    world = walls_of([*rooms, *ring], [*doors, *openings])
    for k, room in enumerate(rooms):
        is_moved = deceit == "moved" and lap > 0 and k % 2 == 1
        template = Room(0.0, low, width, middle)
        inside = furnish(
            template, [Door(0.5 * width, low, 1.0, is_vertical=False)], np.random.default_rng([seed, 1 + is_moved])
        )
        # the upper rooms are the lower ones turned about by half a turn
        pose = [room.x0, 0.0, 0.0] if room.y0 == low else [room.x1, high + low, np.pi]
        world += inside.moved(pose)
    return replace(
        world,
        name="lookalikes",
        floor=np.array([[-_CORRIDOR, 0.0], [length + _CORRIDOR, 0.0], [length + _CORRIDOR, top], [-_CORRIDOR, top]]),
        route=_route(rooms[:n], deceit, length, top, rng),
    )


def deceive(seed: int, *, deceit: Deceit = "offices", sensor: str = "sick-lms200") -> tuple[list[LaserScan], Pose]:
    """Return the scans of two laps through a floor of lookalikes, and (n, 3) their true poses."""
    first = lookalike_floor(seed, deceit=deceit)
    n_people = 4 if deceit == "people" else 0
    period = choose_sensor(sensor).period
    # the route leaves nothing to chance
    lap_poses = _turned_back(drive_route(first, _DRIVE, period, np.random.default_rng(seed)))
    truth = np.concatenate((lap_poses, lap_poses[1:]))
    n = len(lap_poses)
    scans: list[LaserScan] = []
    for lap, poses in enumerate((truth[:n], truth[n:])):
        world = lookalike_floor(seed, deceit=deceit, lap=lap)
        made = simulate(world, sensor=sensor, seed=2 * seed + lap, n_people=n_people, poses=poses, odometry_noise=None)
        scans += [replace(scan, stamp=scan.stamp + lap * n * period) for scan in made]
    return _on_storeys(scans, truth, n) if deceit == "storeys" else (scans, truth)


def _on_storeys(scans: list[LaserScan], truth: Pose, n: int) -> tuple[list[LaserScan], Pose]:
    """Return the second lap on a storey of its own, 1 km away, after scans that see nothing."""
    stair = [replace(scans[n], ranges=np.full(len(scans[n].ranges), np.inf)) for _ in range(_N_STAIR)]
    above = truth[n:] + np.array([1000.0, 0.0, 0.0])
    way = np.linspace(truth[n - 1], above[0], _N_STAIR)
    return [*scans[:n], *stair, *scans[n:]], np.concatenate((truth[:n], way, above))


def _turned_back(poses: Pose) -> Pose:
    """Return the poses of a lap, and a turn on the spot that ends as the lap began."""
    last, wanted = poses[-1], poses[0, 2]
    turn = float(np.remainder(wanted - last[2] + np.pi, 2.0 * np.pi) - np.pi)
    n = max(int(np.ceil(abs(turn) / 0.15)), 1)
    share = np.linspace(0.0, 1.0, n + 1)[1:, np.newaxis]
    onward = np.column_stack((last[:2] + share * (poses[0, :2] - last[:2]), last[2] + share * turn))
    return np.concatenate((poses, onward))


def _route(rooms: list[Room], deceit: Deceit, length: float, top: float, rng: np.random.Generator) -> np.ndarray:
    """Return a way along the lower corridor, into some rooms, and round the ring back to its beginning."""
    y, half = 0.5 * _CORRIDOR, 0.5 * _CORRIDOR
    way = [[-half, y]]
    for room in rooms:
        x = room.centre[0]
        way.append([x, y])
        if deceit != "corridors" and rng.random() < 0.5:
            way += [[x, _CORRIDOR + 0.9], [x, y]]
    way += [[length + half, y], [length + half, top - y], [-half, top - y], [-half, y]]
    return np.array(way)
