"""Offices: a floor of furnished rooms with doors, and a whole building around a corridor loop."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from curvescan.simulation.buildings.floorplan import Door, Room, shared_walls, walls_of
from curvescan.simulation.buildings.furniture import furnish
from curvescan.simulation.buildings.world import World
from curvescan.types import Floats, Points

_MIN_SIDE = 3.2  # of an office room, metres


def office(seed: int | np.random.SeedSequence = 0) -> World:
    """Return a random cluttered office: 3 to 9 furnished rooms joined by open doors.

    The footprint (9 to 14 m by 7 to 11 m, a corner at the origin) is halved at random into rooms; the route visits
    every room and comes back.
    """
    rng = np.random.default_rng(seed)
    length, width = rng.uniform(9.0, 14.0), rng.uniform(7.0, 11.0)
    rooms = _split(Room(0.0, 0.0, length, width), rng)
    links = _spanning_doors(rooms, rng)
    doors = [door for _, _, door in links]
    world = walls_of(rooms, doors)
    for one in rooms:
        world += furnish(one, doors, rng)
    places = np.array([roomiest_place(world, one, rng) for one in rooms])
    return replace(
        world,
        name="office",
        floor=np.array([[0.0, 0.0], [length, 0.0], [length, width], [0.0, width]]),
        route=_tour(places, links),
    )


def _split(whole: Room, rng: np.random.Generator) -> list[Room]:
    """Return the rooms that random halving makes, each side at least `_MIN_SIDE`."""
    length, width = whole.x1 - whole.x0, whole.y1 - whole.y0
    is_long = length >= width
    side = max(length, width)
    if side < 2.0 * _MIN_SIDE or (side < 7.0 and rng.random() < 0.4):
        return [whole]
    cut = rng.uniform(_MIN_SIDE, side - _MIN_SIDE)
    if is_long:
        halves = (whole._replace(x1=whole.x0 + cut), whole._replace(x0=whole.x0 + cut))
    else:
        halves = (whole._replace(y1=whole.y0 + cut), whole._replace(y0=whole.y0 + cut))
    return [one for half in halves for one in _split(half, rng)]


def _spanning_doors(rooms: list[Room], rng: np.random.Generator) -> list[tuple[int, int, Door]]:
    """Return doors that join all rooms, and a few more: (room, room, door)."""
    candidates = [wall for wall in shared_walls(rooms) if wall[5] - wall[4] > 1.9]
    links: list[tuple[int, int, Door]] = []
    group = list(range(len(rooms)))
    for k in rng.permutation(len(candidates)):
        i, j, is_vertical, at, low, high = candidates[k]
        is_extra = rng.random() < 0.3
        width = rng.uniform(0.95, 1.3)
        along = rng.uniform(low + 0.5 * width + 0.25, high - 0.5 * width - 0.25)
        if group[i] == group[j] and not is_extra:
            continue
        x, y = (at, along) if is_vertical else (along, at)
        links.append((i, j, Door(x, y, width, is_vertical)))
        group = [group[i] if g == group[j] else g for g in group]
    return links


def roomiest_place(world: World, one: Room, rng: np.random.Generator) -> Floats:
    """Return the roomiest of some random places in a room: (2,) metres."""
    low, high = np.array([one.x0, one.y0]) + 0.6, np.array([one.x1, one.y1]) - 0.6
    places = np.vstack([rng.uniform(low, high, (40, 2)), [one.centre]])
    return np.asarray(places[int(np.argmax(np.minimum(world.distance(places), 0.9)))])


def _tour(places: Points, links: list[tuple[int, int, Door]]) -> Points:
    """Return a walk through all rooms and back to the first, depth first, through the doors."""
    route = []
    seen = set()

    def visit(i: int) -> None:
        seen.add(i)
        route.append(places[i])
        for a, b, door in links:
            for here, there in ((a, b), (b, a)):
                if here == i and there not in seen:
                    route.append(np.array([door.x, door.y]))
                    visit(there)
                    route.append(np.array([door.x, door.y]))
                    route.append(places[i])

    visit(0)
    return np.array(route[:-1])
