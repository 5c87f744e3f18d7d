"""Floor plans: rectangular rooms, the doors between them, the walls that follow from both, and furniture."""

import itertools
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from curvescan.configs import shipped_table
from curvescan.simulation.buildings.world import World
from curvescan.types import Bools, Floats

WALL_THICKNESS = 0.12  # metres, of inner walls; thick enough for door jambs to show as corners
_SAME = 1e-6


class Room(NamedTuple):
    """An axis-aligned room between the centre lines of its walls, metres."""

    x0: float
    y0: float
    x1: float
    y1: float

    @property
    def centre(self) -> tuple[float, float]:
        """Its middle [x, y], metres."""
        return 0.5 * (self.x0 + self.x1), 0.5 * (self.y0 + self.y1)


class Door(NamedTuple):
    """An opening in an axis-aligned wall: its centre on the wall's centre line, metres."""

    x: float
    y: float
    width: float
    is_vertical: bool
    """Whether the wall runs along y."""


def shared_walls(rooms: Sequence[Room]) -> list[tuple[int, int, bool, float, float, float]]:
    """Return (i, j, is_vertical, coordinate, low, high) for each stretch of wall two rooms share."""
    shared = []
    for (i, a), (j, b) in itertools.combinations(enumerate(rooms), 2):
        x_low, x_high = max(a.x0, b.x0), min(a.x1, b.x1)
        y_low, y_high = max(a.y0, b.y0), min(a.y1, b.y1)
        for is_vertical, at_a, at_b, low, high in (
            (True, a.x1, b.x0, y_low, y_high),
            (True, a.x0, b.x1, y_low, y_high),
            (False, a.y1, b.y0, x_low, x_high),
            (False, a.y0, b.y1, x_low, x_high),
        ):
            if abs(at_a - at_b) < _SAME and high - low > _SAME:
                shared.append((i, j, is_vertical, at_a, low, high))
    return shared


def walls_of(rooms: Sequence[Room], doors: Sequence[Door]) -> World:
    """Return the walls around rooms as solid boxes with gaps for doors, shared ones once, corners without a slit."""
    lines: dict[tuple[bool, float], list[tuple[float, float]]] = {}
    for room in rooms:
        for x in (room.x0, room.x1):
            lines.setdefault((True, round(x, 6)), []).append((room.y0, room.y1))
        for y in (room.y0, room.y1):
            lines.setdefault((False, round(y, 6)), []).append((room.x0, room.x1))
    boxes = []
    for (is_vertical, at), stretches in lines.items():
        gaps = sorted(
            (centre - 0.5 * door.width, centre + 0.5 * door.width)
            for door in doors
            for centre, across in [(door.y, door.x) if door.is_vertical else (door.x, door.y)]
            if door.is_vertical == is_vertical and abs(across - at) < _SAME
        )
        for low, high in _pieces(stretches, gaps):
            middle, length = 0.5 * (low + high), high - low
            box = (at, middle, WALL_THICKNESS, length) if is_vertical else (middle, at, length, WALL_THICKNESS)
            boxes.append([*box, 0.0])
    return World(boxes=np.array(boxes))


def overlaps(rectangle: Floats, others: Floats, gap: float = 0.0) -> Bools:
    """Return which of (n, 4) rectangles [x0, y0, x1, y1] come nearer than `gap` to one rectangle."""
    apart: Bools = (
        (others[:, 0] >= rectangle[2] + gap)
        | (others[:, 2] <= rectangle[0] - gap)
        | (others[:, 1] >= rectangle[3] + gap)
        | (others[:, 3] <= rectangle[1] - gap)
    )
    return np.logical_not(apart)


def door_zones(doors: Sequence[Door], depth: float = 0.95) -> Floats:
    """Return (n, 4) rectangles on both sides of each door that must stay clear of furniture."""
    zones = []
    for door in doors:
        along = 0.5 * door.width + 0.15
        dx, dy = (depth, along) if door.is_vertical else (along, depth)
        zones.append([door.x - dx, door.y - dy, door.x + dx, door.y + dy])
    return np.array(zones).reshape(-1, 4)


def _pieces(stretches: list[tuple[float, float]], gaps: list[tuple[float, float]]) -> list[tuple[float, float]]:
    """Return the union of the stretches, lengthened by half a thickness, without the gaps."""
    half = 0.5 * WALL_THICKNESS
    merged: list[list[float]] = []
    for low, high in sorted(stretches):
        if merged and low <= merged[-1][1] + _SAME:
            merged[-1][1] = max(merged[-1][1], high)
        else:
            merged.append([low, high])
    pieces = []
    for low, high in merged:
        start = low - half
        for gap_low, gap_high in gaps:
            if low < gap_low and gap_high < high:
                pieces.append((start, gap_low))
                start = gap_high
        pieces.append((start, high + half))
    return pieces


AISLE = 0.85  # metres kept free around things that stand in the middle of a room, so that a robot passes
_MARGIN = 0.9  # metres kept free before things at walls

_SIZES = shipped_table(__package__, "furniture.toml")
_AT_WALLS, _CHAIR, _DESK, _ISLANDS = (_SIZES[name] for name in ("at_walls", "chair", "desk", "islands"))


def chair(x: float, y: float, angle: float, *, has_castors: bool) -> World:
    """Return a chair: five castors and a column around (x, y), or four legs."""
    n_feet, reach, radius = _CHAIR["castors" if has_castors else "legs"]
    feet = angle + 2.0 * np.pi * np.arange(n_feet) / n_feet
    circles = np.column_stack([x + reach * np.cos(feet), y + reach * np.sin(feet), np.full(n_feet, radius)])
    return World(circles=np.vstack([circles, [x, y, radius]]) if has_castors else circles)


def desk(length: float, depth: float, *, has_panels: bool) -> World:
    """Return a desk around the origin, its back on the side of negative y: panels, or four legs."""
    half_length, half_depth = 0.5 * length, 0.5 * depth
    if has_panels:
        (side, thickness), (back, thin) = _DESK["panel"], _DESK["back"]
        sides = [[x, 0.0, thickness, depth, 0.0] for x in (-half_length + side, half_length - side)]
        return World(boxes=np.array([*sides, [0.0, -half_depth + back, length - back, thin, 0.0]]))
    inset, radius = _DESK["leg"]
    x, y = half_length - inset, half_depth - inset
    return World(circles=np.array([[-x, -y, radius], [x, -y, radius], [x, y, radius], [-x, y, radius]]))


def furnish(
    room: Room,
    doors: Sequence[Door],
    rng: np.random.Generator,
    *,
    density: float = 1.0,
    sides: Sequence[int] = (0, 1, 2, 3),
) -> World:
    """Return furniture for a room: against the walls first, then in the middle, doors kept clear."""
    furniture = World()
    taken = door_zones(doors)
    area = (room.x1 - room.x0) * (room.y1 - room.y0)
    for _ in range(rng.poisson(_SIZES["density"]["at_walls"] * density * area)):
        kind = str(rng.choice(["desk", "cabinet", "cabinet", "bin"]))
        size = _AT_WALLS[kind]
        length = rng.uniform(*size["length"])
        depth = rng.uniform(*size["depth"]) + size["before"] if "depth" in size else length
        placed = _against_wall(room, length, depth, int(rng.choice(sides)), rng.random())
        if placed is None or overlaps(placed[1], taken, 0.04).any():
            continue
        pose, rectangle = placed
        furniture += _piece(kind, length, depth, rng).moved(pose)
        taken = np.vstack([taken, rectangle])
    for _ in range(rng.poisson(_SIZES["density"]["islands"] * density * area)):
        half = rng.uniform(*_ISLANDS["half"])
        margin = half + AISLE + 0.5 * WALL_THICKNESS
        if min(room.x1 - room.x0, room.y1 - room.y0) <= 2.0 * margin:
            continue
        x = rng.uniform(room.x0 + margin, room.x1 - margin)
        y = rng.uniform(room.y0 + margin, room.y1 - margin)
        rectangle = np.array([x - half, y - half, x + half, y + half])
        if not overlaps(rectangle, taken, AISLE).any():
            furniture += _island(half, rng).moved([x, y, rng.uniform(-np.pi, np.pi)])
            taken = np.vstack([taken, rectangle])
    return furniture


def _piece(kind: str, length: float, depth: float, rng: np.random.Generator) -> World:
    """Return a piece that fills its footprint around the origin, its back on the side of negative y."""
    if kind == "cabinet":
        return World(boxes=np.array([[0.0, 0.0, length, depth, 0.0]]))
    if kind == "bin":
        return World(circles=np.array([[0.0, 0.0, 0.5 * length]]))
    before = _AT_WALLS[kind]["before"]
    table = desk(length, depth - before, has_panels=bool(rng.random() < _DESK["panels_share"]))
    x, y, angle = rng.uniform(-0.25, 0.25) * length, 0.5 * depth - 0.3, rng.uniform(-np.pi, np.pi)
    seat = chair(x, y, angle, has_castors=bool(rng.random() < _DESK["castors_share"]))
    return table.moved([0.0, -0.5 * before, 0.0]) + seat


def _island(half: float, rng: np.random.Generator) -> World:
    """Return a thing that stands in the middle of a room, within `half` of the origin."""
    kind = rng.choice(["table", "column", "crate"])
    if kind == "column" or half < 0.35:
        return World(circles=np.array([[0.0, 0.0, min(_ISLANDS["column"], half)]]))
    if kind == "crate":
        side = half * np.sqrt(2.0)
        return World(boxes=np.array([[0.0, 0.0, side, rng.uniform(*_ISLANDS["crate"]) * side, 0.0]]))
    table = World(circles=np.array([[0.0, 0.0, _ISLANDS["foot"]]]))
    reach = half - _ISLANDS["inset"]
    for angle in np.pi * np.array([0.0, 0.5, 1.0, 1.5]):
        if rng.random() < _ISLANDS["chair_share"]:
            table += chair(reach * np.cos(angle), reach * np.sin(angle), rng.random(), has_castors=False)
    return table


def _against_wall(room: Room, length: float, depth: float, side: int, share: float) -> tuple[Floats, Floats] | None:
    """Return the pose of furniture at a wall (bottom, right, top, left), a `share` along it, and its space, or None."""
    inset = 0.5 * WALL_THICKNESS + 0.03
    x0, y0, x1, y1 = room.x0 + inset, room.y0 + inset, room.x1 - inset, room.y1 - inset
    is_level = side % 2 == 0
    wall, room_across = (x1 - x0, y1 - y0) if is_level else (y1 - y0, x1 - x0)
    space = wall - length
    if space < 0.0 or room_across - depth < _MARGIN + depth:
        return None
    along, across = share * space + 0.5 * length, 0.5 * depth
    places = [
        (x0 + along, y0 + across),
        (x1 - across, y0 + along),
        (x1 - along, y1 - across),
        (x0 + across, y1 - along),
    ]
    x, y = places[side]
    dx, dy = (0.5 * length, 0.5 * depth) if is_level else (0.5 * depth, 0.5 * length)
    return np.array([x, y, 0.5 * np.pi * side]), np.array([x - dx, y - dy, x + dx, y + dy])
