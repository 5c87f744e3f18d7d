"""Simple places: rooms, corridors, halls, curved walls, clutter.

All builders return a :class:`World` with its walls thin and exact, the floor inside, and a corner or the
middle at the origin as each docstring says. Put things in with ``+``.
"""

import numpy as np
from numpy.typing import ArrayLike

from curvescan.simulation.buildings.world import World
from curvescan.types import Floats


def room(length: float = 8.0, width: float = 6.0) -> World:
    """Return a bare rectangular room centred on the origin: `length` along x, `width` along y, metres."""
    x, y = 0.5 * length, 0.5 * width
    return hall(np.array([[-x, -y], [x, -y], [x, y], [-x, y]]), name="room")


def hall(corners: ArrayLike, name: str = "hall") -> World:
    """Return a hall of any outline: (n, 2) corners in order, metres; the last joins the first."""
    corners = np.asarray(corners, dtype=np.float64)
    walls = np.hstack([corners, np.roll(corners, -1, axis=0)])
    return World(name=name, walls=walls, floor=corners)


def corridor(
    length: float = 30.0,
    width: float = 2.0,
    *,
    recesses: ArrayLike = (),
    pillars: ArrayLike = (),
    has_ends: bool = False,
) -> World:
    """Return a corridor along x about the origin, recesses (n, 3), pillars (m, 3); bare it leaves x unobservable."""
    half, y = 0.5 * length, 0.5 * width
    niches = np.asarray(recesses, dtype=np.float64).reshape(-1, 3)
    walls = [_line_with_niches(half, side, niches[niches[:, 2] * side > 0.0]) for side in (y, -y)]
    if has_ends:
        walls.append(np.array([[-half, -y, -half, y], [half, -y, half, y]]))
    square = np.asarray(pillars, dtype=np.float64).reshape(-1, 3)
    boxes = np.column_stack([square[:, :2], square[:, 2], square[:, 2], np.zeros(len(square))])
    end = half - min(1.0, 0.25 * length)
    return World(
        name="corridor",
        walls=np.vstack(walls),
        boxes=boxes,
        floor=np.array([[-half, -y], [half, -y], [half, y], [-half, y]]),
        route=np.array([[-end, 0.0], [end, 0.0]]),
    )


def round_room(radius: float = 4.0) -> World:
    """Return a round room centred on the origin: its wall is one exact circle, seen from within."""
    angles = np.linspace(0.0, 2.0 * np.pi, 90, endpoint=False)
    return World(
        name="round-room",
        arcs=np.array([[0.0, 0.0, radius, -np.pi, 2.0 * np.pi]]),
        floor=radius * np.column_stack([np.cos(angles), np.sin(angles)]),
    )


def curved_hall(length: float = 10.0, width: float = 6.0) -> World:
    """Return a hall centred on the origin whose two short ends are half circles, bulging outwards."""
    x, radius = 0.5 * length, 0.5 * width
    angles = np.linspace(-0.5 * np.pi, 0.5 * np.pi, 30)
    end = radius * np.column_stack([np.cos(angles), np.sin(angles)])
    return World(
        name="curved-hall",
        walls=np.array([[-x, -radius, x, -radius], [-x, radius, x, radius]]),
        arcs=np.array([[x, 0.0, radius, -0.5 * np.pi, np.pi], [-x, 0.0, radius, 0.5 * np.pi, np.pi]]),
        floor=np.vstack([np.add([x, 0.0], end), np.subtract([-x, 0.0], end)]),
    )


def columns(places: ArrayLike, radius: float = 0.25) -> World:
    """Return round columns at (n, 2) places, metres."""
    places = np.asarray(places, dtype=np.float64).reshape(-1, 2)
    return World(name="columns", circles=np.column_stack([places, np.full(len(places), radius)]))


def clutter(area: ArrayLike, n_things: int, seed: int | np.random.SeedSequence = 0) -> World:
    """Return boxes at any angle and small discs, at random places. area (4,)."""
    rng = np.random.default_rng(seed)
    x0, y0, x1, y1 = np.asarray(area, dtype=np.float64)
    places = np.column_stack([rng.uniform(x0, x1, n_things), rng.uniform(y0, y1, n_things)])
    is_box = rng.random(n_things) < 2.0 / 3.0
    sides = rng.uniform(0.2, 0.9, (n_things, 2))
    angles = rng.uniform(-np.pi, np.pi, n_things)
    radii = rng.uniform(0.04, 0.25, n_things)
    return World(
        name="clutter",
        boxes=np.column_stack([places, sides, angles])[is_box],
        circles=np.column_stack([places, radii])[~is_box],
    )


def _line_with_niches(half: float, y: float, niches: Floats) -> Floats:
    """Return the wall along x at `y` as one line that steps into each niche and out again."""
    corners = [[-half, y]]
    for x, width, depth in niches[np.argsort(niches[:, 0])]:
        left, right = x - 0.5 * width, x + 0.5 * width
        corners += [[left, y], [left, y + depth], [right, y + depth], [right, y]]
    corners.append([half, y])
    line = np.array(corners)
    return np.hstack([line[:-1], line[1:]])
