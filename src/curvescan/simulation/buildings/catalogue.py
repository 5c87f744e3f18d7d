"""The named worlds: one explicit table, name -> builder, and the builders of whole floors and offices."""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import replace

import numpy as np

from curvescan.configs import look_up, shipped_table
from curvescan.simulation.buildings import rooms as simple
from curvescan.simulation.buildings.floorplan import (
    WALL_THICKNESS,
    Door,
    Room,
    door_zones,
    furnish,
    shared_walls,
    walls_of,
)
from curvescan.simulation.buildings.world import World
from curvescan.types import Floats, Points

_CORRIDOR = 2.0  # width, metres
_LEAF = 0.04  # thickness of a door leaf, metres
_FREE = 0.1  # metres by which a leaf is narrower than its opening

_TABLE = shipped_table(__package__, "worlds.toml")
_BUILDING, _OFFICE = _TABLE["building"], _TABLE["office"]


def building(seed: int | np.random.SeedSequence = 0, *, visits_round_room: bool = True) -> World:
    """Return a random floor of about 24 m by 18 m; its route is a loop of 60 to 80 m.

    Rows of offices lie below and above a corridor loop; inside the loop lie more offices and a round room (one exact
    arc); the corridor on the right has a curved outer wall. Doors stand open or are closed.
    """
    rng = np.random.default_rng(seed)
    length = rng.uniform(*_BUILDING["length"])
    low = rng.uniform(*_BUILDING["row"])  # top of the lower row
    core_low = low + _CORRIDOR
    core_high = core_low + rng.uniform(*_BUILDING["core"])
    high = core_high + _CORRIDOR  # bottom of the upper row
    width = high + rng.uniform(*_BUILDING["row"])

    lower = _row(0.0, length, 0.0, low, rng)
    upper = _row(0.0, length, high, width, rng)
    side = core_high - core_low
    round_x = _CORRIDOR + rng.uniform(*_BUILDING["hub"]) * (length - 2.0 * _CORRIDOR)
    hub = Room(round_x - 0.5 * side, core_low, round_x + 0.5 * side, core_high)
    core = _row(_CORRIDOR, hub.x0, core_low, core_high, rng)
    core += _row(hub.x1, length - _CORRIDOR, core_low, core_high, rng)

    doors = [_door(one, one.y1, rng) for one in lower] + [_door(one, one.y0, rng) for one in upper]
    doors += [_door(one, (one.y0, one.y1)[int(rng.integers(2))], rng) for one in core]
    hub_door = Door(round_x, core_high, 2.0 * _BUILDING["round_gap"], False)
    rooms = [*lower, *upper, *core]
    is_open = rng.random(len(rooms)) < _BUILDING["open_share"]
    visited = [len(lower) // 2, len(lower) + len(upper) // 2]
    is_open[visited] = True

    ends = _ends(length, low, high)
    world = walls_of([*rooms, hub], [*doors, hub_door]) + ends + _round_wall(hub)
    for one, door, opens in zip(rooms, doors, is_open, strict=True):
        world += _leaf(one, door, opens, rng) + furnish(one, doors, rng)
    world += _in_the_corridors(length, (low, core_low, core_high, high), [*doors, hub_door], rng)

    left, right, bottom, top = 1.0, length - 1.0, low + 1.0, high - 1.0
    inside = [tuple(roomiest_place(world, rooms[i], rng).tolist()) for i in visited]
    at_door = [(doors[i].x, doors[i].y) for i in visited]
    into_hub = [(round_x, core_high), hub.centre, (round_x, core_high), (round_x, top)] if visits_round_room else []
    visits = [
        [(at_door[1][0], top), at_door[1], inside[1], at_door[1], (at_door[1][0], top)],
        [(round_x, top), *into_hub],
    ]
    route: list[tuple[float, ...]] = [
        (left, 0.5 * (low + high)),
        (left, bottom),
        *((at_door[0][0], bottom), at_door[0], inside[0], at_door[0], (at_door[0][0], bottom)),
        *((right, bottom), (right, top)),
        *(place for visit in sorted(visits, key=lambda places: -places[0][0]) for place in visit),
        (left, top),
    ]
    return replace(world, name="building", floor=_outline(ends, length, width, low, high), route=np.array(route))


def _row(x0: float, x1: float, y0: float, y1: float, rng: np.random.Generator) -> list[Room]:
    """Return rooms of about 4 m side by side that fill a strip; none when it is too short."""
    n_rooms = int((x1 - x0) / rng.uniform(*_BUILDING["room"]))
    if n_rooms == 0:
        return [Room(x0, y0, x1, y1)] if x1 - x0 > 1.6 else []
    pitch = (x1 - x0) / n_rooms
    cuts = np.linspace(x0, x1, n_rooms + 1)
    cuts[1:-1] += rng.uniform(-_BUILDING["jog"], _BUILDING["jog"], n_rooms - 1) * pitch
    return [Room(a, y0, b, y1) for a, b in itertools.pairwise(cuts.tolist())]


def _door(one: Room, y: float, rng: np.random.Generator) -> Door:
    width = rng.uniform(*_BUILDING["door"])
    margin = 0.5 * width + 0.2
    return Door(float(rng.uniform(one.x0 + margin, one.x1 - margin)), y, width, False)


def _leaf(one: Room, door: Door, is_open: bool, rng: np.random.Generator) -> World:
    """Return the leaf of a door: across the opening when closed, turned into the room when open."""
    side = 1.0 if rng.random() < 0.5 else -1.0
    if not is_open:
        return World(boxes=np.array([[door.x, door.y, door.width, _LEAF, 0.0]]))
    into = 1.0 if one.centre[1] > door.y else -1.0
    x = door.x + side * 0.5 * (door.width + _LEAF)
    y = door.y + into * 0.5 * (WALL_THICKNESS + door.width - _FREE)
    return World(boxes=np.array([[x, y, _LEAF, door.width - _FREE, 0.0]]))


def _ends(length: float, low: float, high: float) -> World:
    """Return the outer walls of the left corridor (straight) and of the right one (a bulging arc)."""
    middle, chord, bulge = 0.5 * (low + high), high - low, _BUILDING["bulge"]
    radius = (0.25 * chord**2 + bulge**2) / (2.0 * bulge)
    half = np.arcsin(0.5 * chord / radius)
    return World(
        boxes=np.array([[0.0, middle, WALL_THICKNESS, chord, 0.0]]),
        arcs=np.array([[length + bulge - radius, middle, radius, -half, 2.0 * half]]),
    )


def _round_wall(hub: Room) -> World:
    """Return the round wall inside the square of the hub, open to its upper door; shafts fill the corners."""
    (x, _), side = hub.centre, hub.y1 - hub.y0
    radius = 0.5 * side - 0.15
    gap = np.arcsin(_BUILDING["round_gap"] / radius)
    y = hub.y1 - 0.5 * WALL_THICKNESS - radius * np.cos(gap)
    shaft = 0.25 * radius
    corners = itertools.product(
        (hub.x0 + 0.5 * shaft, hub.x1 - 0.5 * shaft), (hub.y0 + 0.5 * shaft, hub.y1 - 0.5 * shaft)
    )
    return World(
        boxes=np.array([[*corner, shaft, shaft, 0.0] for corner in corners]),
        arcs=np.array([[x, y, radius, 0.5 * np.pi + gap, 2.0 * (np.pi - gap)]]),
    )


def _in_the_corridors(
    length: float, y: tuple[float, float, float, float], doors: list[Door], rng: np.random.Generator
) -> World:
    """Return what stands in the long corridors: cabinets and bins at the walls, and shallow pillars."""
    things, zones = World(), door_zones(doors)
    pitch, side = _BUILDING["pillar_pitch"], _BUILDING["pillar"]
    for y0, y1 in ((y[0], y[1]), (y[2], y[3])):
        hall = Room(_CORRIDOR, y0, length - _CORRIDOR, y1)
        things += furnish(hall, doors, rng, density=0.7, sides=(0, 2))
        for x in np.arange(hall.x0 + 1.5, hall.x1 - 1.0, pitch) + rng.uniform(-0.5, 0.5):
            at = y0 if rng.random() < 0.5 else y1
            is_beside = np.abs(zones[:, 1] + zones[:, 3] - 2.0 * at) < 0.1
            if not (is_beside & (np.abs(0.5 * (zones[:, 0] + zones[:, 2]) - x) < 1.0)).any():
                things += World(boxes=np.array([[x, at, side, side, 0.0]]))
    return things


def _outline(ends: World, length: float, width: float, low: float, high: float) -> Floats:
    """Return the floor: the rectangle and the bulge of the curved wall."""
    y = np.linspace(low, high, 20)
    wall = ends.arcs[0]
    x = wall[0] + np.sqrt(np.maximum(wall[2] ** 2 - (y - wall[1]) ** 2, 0.0))
    return np.vstack([[[0.0, 0.0], [length, 0.0]], np.column_stack([x, y]), [[length, width], [0.0, width]]])


def office(seed: int | np.random.SeedSequence = 0) -> World:
    """Return a random cluttered office: 3 to 9 furnished rooms joined by open doors.

    The footprint (9 to 14 m by 7 to 11 m, a corner at the origin) is halved at random into rooms; the route visits
    every room and comes back.
    """
    rng = np.random.default_rng(seed)
    length, width = rng.uniform(*_OFFICE["length"]), rng.uniform(*_OFFICE["width"])
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
    """Return the rooms that random halving makes, none with a side that is too short."""
    length, width = whole.x1 - whole.x0, whole.y1 - whole.y0
    side, least = max(length, width), _OFFICE["least_side"]
    if side < 2.0 * least or (side < _OFFICE["large_side"] and rng.random() < _OFFICE["whole_share"]):
        return [whole]
    cut = rng.uniform(least, side - least)
    if length >= width:
        halves = (whole._replace(x1=whole.x0 + cut), whole._replace(x0=whole.x0 + cut))
    else:
        halves = (whole._replace(y1=whole.y0 + cut), whole._replace(y0=whole.y0 + cut))
    return [one for half in halves for one in _split(half, rng)]


def _spanning_doors(rooms: list[Room], rng: np.random.Generator) -> list[tuple[int, int, Door]]:
    """Return doors that join all rooms, and a few more: (room, room, door)."""
    candidates = [wall for wall in shared_walls(rooms) if wall[5] - wall[4] > _OFFICE["least_wall"]]
    links: list[tuple[int, int, Door]] = []
    group = list(range(len(rooms)))
    for k in rng.permutation(len(candidates)):
        i, j, is_vertical, at, low, high = candidates[k]
        is_extra = rng.random() < _OFFICE["more_doors"]
        width = rng.uniform(*_OFFICE["door"])
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


Seed = int | np.random.SeedSequence  # what decides a random world: the same seed, the same bits

WORLDS: Mapping[str, Callable[[Seed], World]] = {
    "room": lambda _: simple.room(),
    "corridor": lambda _: simple.corridor(**_TABLE["corridor"], has_ends=True),
    "bare-corridor": lambda _: simple.corridor(),
    "round-room": lambda _: simple.round_room(),
    "l-hall": lambda _: simple.hall(_TABLE["l-hall"]["outline"], "l-hall"),
    "t-hall": lambda _: simple.hall(_TABLE["t-hall"]["outline"], "t-hall"),
    "curved-hall": lambda _: simple.curved_hall() + simple.columns(_TABLE["curved-hall"]["columns"]),
    "clutter": lambda seed: simple.room(10.0, 8.0) + simple.clutter((-4.5, -3.5, 4.5, 3.5), 18, seed),
    "office": office,
    "building": building,
    "office-floor": lambda seed: replace(building(seed, visits_round_room=False), name="office-floor"),
}
"""Name -> builder(seed). Only clutter, office, building and office-floor (the building, whose route leaves the round
room out) depend on the seed."""


def build_world(world: World | str, seed: Seed = 0) -> World:
    """Return a named world built with a seed, or the world itself when it is one already."""
    if isinstance(world, World):
        return world
    return look_up(WORLDS, world, "world")(seed)
