"""World: what stands still in a simulated place, as exact primitives.

Walls are thin segments and circular arcs; boxes and circles are solid. Nothing is approximated: a curved
wall is a true arc, so that a ray meets it to float rounding. Frame: x, y in metres, angles in radians,
counter-clockwise. Worlds are immutable; ``a + b`` puts the things of b into a.
"""

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, cast

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan.errors import InvalidArgumentError, require
from curvescan.types import Bools, Floats, Ints, Points

_CHUNK = 2048  # points measured at once: keeps the (points, primitives) tables in the cache


@dataclass(frozen=True, eq=False, kw_only=True)
class World:
    """A place made of primitives, in the world frame.

    Parameters
    ----------
    name : str
        Name for titles and messages.
    walls : (n, 4) array_like
        Thin segments [x0, y0, x1, y1], metres.
    boxes : (b, 5) array_like
        Solid rectangles [x, y, length, width, angle]: centre, sides along and across `angle`.
    circles : (m, 3) array_like
        Solid discs [x, y, r].
    arcs : (k, 5) array_like
        Thin circular arcs [x, y, r, start, extent], counter-clockwise from the angle `start`;
        0 < extent <= 2 pi. They are seen from both sides.
    floor : (f, 2) array_like
        Polygon inside which robots and people stay; empty: the bounding rectangle.
    route : (w, 2) array_like
        Places worth visiting, in order, back to the first at the end; empty: none in particular.

    Raises
    ------
    InvalidArgumentError
        When a shape is wrong, a number is not finite or a size is not positive.
    """

    name: str = "world"
    walls: Floats = field(default_factory=lambda: np.empty((0, 4)))
    boxes: Floats = field(default_factory=lambda: np.empty((0, 5)))
    circles: Floats = field(default_factory=lambda: np.empty((0, 3)))
    arcs: Floats = field(default_factory=lambda: np.empty((0, 5)))
    floor: Points = field(default_factory=lambda: np.empty((0, 2)))
    route: Points = field(default_factory=lambda: np.empty((0, 2)))

    def __repr__(self) -> str:
        held = ", ".join(f"{len(getattr(self, kind)):,} {kind}" for kind in _TO_NEAREST if len(getattr(self, kind)))
        return f"World({self.name!r}: {held or 'empty'})"

    def __post_init__(self) -> None:
        widths = {"walls": 4, "boxes": 5, "circles": 3, "arcs": 5, "floor": 2, "route": 2}
        for name, width in widths.items():
            object.__setattr__(self, name, _read_only_rows(getattr(self, name), name, width))
        for name, sizes in (
            ("box sides", self.boxes[:, 2:4]),
            ("circle radii", self.circles[:, 2]),
            ("arc radii", self.arcs[:, 2]),
            ("arc extents", self.arcs[:, 4]),
        ):
            require(bool(np.all(sizes > 0.0)), f"{name} must be > 0", float(sizes.min(initial=np.inf)))
        widest = float(self.arcs[:, 4].max(initial=0.0))
        require(widest <= 2.0 * np.pi, "arc extents must be at most 2 pi", widest)

    def __add__(self, other: "World") -> "World":
        """Return the things of both worlds, with the name, floor and route of the first that has one."""
        both: dict[str, Any] = {kind: np.vstack([getattr(self, kind), getattr(other, kind)]) for kind in _TO_NEAREST}
        floor, route = (
            mine if len(mine) else its for mine, its in ((self.floor, other.floor), (self.route, other.route))
        )
        return replace(self, floor=floor, route=route, **both)

    def moved(self, pose: ArrayLike) -> "World":
        """Return the world turned and shifted: `pose` is (3,), the old world frame seen in the new one."""
        x, y, theta = np.asarray(pose, dtype=np.float64)
        pose = np.array([x, y, theta])  # of three numbers, or an error
        boxes, circles, arcs = self.boxes.copy(), self.circles.copy(), self.arcs.copy()
        for things in (boxes, circles, arcs):
            things[:, :2] = se2.transform(pose, things[:, :2])
        boxes[:, 4] += theta
        arcs[:, 3] += theta
        walls = se2.transform(pose, self.walls.reshape(-1, 2)).reshape(-1, 4)
        floor, route = (se2.transform(pose, places) for places in (self.floor, self.route))
        return replace(self, walls=walls, boxes=boxes, circles=circles, arcs=arcs, floor=floor, route=route)

    @cached_property
    def segments(self) -> Floats:
        """(n + 4 b, 4) every straight edge a ray can meet: the walls, then four edges of each box."""
        corners = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
        local = corners[np.newaxis] * self.boxes[:, np.newaxis, 2:4]
        cos, sin = np.cos(self.boxes[:, 4, np.newaxis]), np.sin(self.boxes[:, 4, np.newaxis])
        x = self.boxes[:, 0, np.newaxis] + cos * local[..., 0] - sin * local[..., 1]
        y = self.boxes[:, 1, np.newaxis] + sin * local[..., 0] + cos * local[..., 1]
        edges = np.stack([x, y, np.roll(x, -1, axis=1), np.roll(y, -1, axis=1)], axis=-1)
        return np.ascontiguousarray(np.vstack([self.walls, edges.reshape(-1, 4)]))

    @cached_property
    def curves(self) -> Floats:
        """(m + k, 6) circles, then arcs: [x, y, r, cos and sin of the middle, cos of half the extent]."""
        middle = self.arcs[:, 3] + 0.5 * self.arcs[:, 4]
        arcs = np.column_stack([self.arcs[:, :3], np.cos(middle), np.sin(middle), np.cos(0.5 * self.arcs[:, 4])])
        return np.ascontiguousarray(np.vstack([full_circles(self.circles), arcs]))

    @property
    def n_primitives(self) -> int:
        """Count of what a ray can hit: segments, then circles, then arcs, in the order of hit indices."""
        return len(self.segments) + len(self.curves)

    @cached_property
    def bounds(self) -> Floats:
        """(4,) [x_min, y_min, x_max, y_max] around everything (arcs by their whole circle), metres."""
        centres, radii = self.curves[:, :2], self.curves[:, 2:3]
        points = np.vstack([self.segments.reshape(-1, 2), self.floor, centres - radii, centres + radii])
        if not len(points):
            return np.zeros(4)
        return np.concatenate([points.min(axis=0), points.max(axis=0)])

    def distance(self, points: ArrayLike) -> Floats:
        """Return the distance from each of (n, 2) points to the nearest primitive: 0 inside, inf in an empty world."""
        points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        distances = np.full(len(points), np.inf)
        for start in range(0, len(points), _CHUNK):
            chunk = points[start : start + _CHUNK, np.newaxis]
            part = distances[start : start + _CHUNK]
            for kind, to_nearest in _TO_NEAREST.items():
                if len(primitives := getattr(self, kind)):
                    np.minimum(part, to_nearest(chunk, primitives), out=part)
        return distances

    def is_free(self, points: ArrayLike, clearance: float = 0.0) -> Bools:
        """Return which of (n, 2) points lie on the floor, `clearance` metres away from everything."""
        points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        distance = self.distance(points)
        return (distance > 0.0) & (distance >= clearance) & self.on_floor(points)

    def on_floor(self, points: ArrayLike) -> Bools:
        """Return which of the (n, 2) points lie inside the floor polygon (or the bounds, without one)."""
        points = np.asarray(points, dtype=np.float64).reshape(-1, 2)
        if not len(self.floor):
            low, high = self.bounds[:2], self.bounds[2:]
            return cast(Bools, np.all((points >= low) & (points <= high), axis=1))
        x, y = points[:, 0, np.newaxis], points[:, 1, np.newaxis]
        x0, y0 = self.floor.T
        x1, y1 = np.roll(self.floor, -1, axis=0).T
        straddles = (y0 > y) != (y1 > y)
        rise = np.where(y1 == y0, 1.0, y1 - y0)
        is_left = x < x0 + (y - y0) * (x1 - x0) / rise
        return cast(Bools, np.count_nonzero(straddles & is_left, axis=1) % 2 == 1)


def full_circles(circles: Floats) -> Floats:
    """Return (m, 3) circles [x, y, r] as (m, 6) rows of :attr:`World.curves`."""
    return np.hstack([circles, np.tile([1.0, 0.0, -1.0], (len(circles), 1))])


def _picked(x: Floats, y: Floats, nearest: Ints) -> Floats:
    """Return the length of one vector of each row; those of the others, which take time, are not worked out."""
    rows = np.arange(len(nearest))
    return cast(Floats, np.hypot(x[rows, nearest], y[rows, nearest]))


def _shortest(x: Floats, y: Floats) -> Floats:
    return _picked(x, y, np.argmin(x * x + y * y, axis=1))


def _to_walls(points: Floats, walls: Floats) -> Floats:
    x0, y0 = walls[:, 0], walls[:, 1]
    dx, dy = walls[:, 2] - x0, walls[:, 3] - y0
    squared = np.maximum(dx**2 + dy**2, np.finfo(np.float64).tiny)
    x, y = points[..., 0] - x0, points[..., 1] - y0
    along = np.clip((x * dx + y * dy) / squared, 0.0, 1.0)
    return _shortest(x - along * dx, y - along * dy)


def _to_boxes(points: Floats, boxes: Floats) -> Floats:
    cos, sin = np.cos(boxes[:, 4]), np.sin(boxes[:, 4])
    x, y = points[..., 0] - boxes[:, 0], points[..., 1] - boxes[:, 1]
    along = np.abs(cos * x + sin * y) - 0.5 * boxes[:, 2]
    across = np.abs(cos * y - sin * x) - 0.5 * boxes[:, 3]
    return _shortest(np.maximum(along, 0.0), np.maximum(across, 0.0))


def _to_circles(points: Floats, circles: Floats) -> Floats:
    x, y = points[..., 0] - circles[:, 0], points[..., 1] - circles[:, 1]
    nearest = np.argmin(np.sqrt(x * x + y * y) - circles[:, 2], axis=1)
    return cast(Floats, np.maximum(_picked(x, y, nearest) - circles[nearest, 2], 0.0))


def _to_arcs(points: Floats, arcs: Floats) -> Floats:
    offset = points - arcs[:, :2]
    turned = np.remainder(np.arctan2(offset[..., 1], offset[..., 0]) - arcs[:, 3], 2.0 * np.pi)
    distance = np.abs(np.hypot(offset[..., 0], offset[..., 1]) - arcs[:, 2])
    ends = np.full(distance.shape, np.inf)
    for angle in (arcs[:, 3], arcs[:, 3] + arcs[:, 4]):
        off = offset - arcs[:, 2:3] * np.column_stack([np.cos(angle), np.sin(angle)])
        ends = np.minimum(ends, np.hypot(off[..., 0], off[..., 1]))
    return cast(Floats, np.where(turned <= arcs[:, 4], distance, ends).min(axis=1))


_TO_NEAREST: dict[str, Callable[[Floats, Floats], Floats]] = {
    "walls": _to_walls,
    "boxes": _to_boxes,
    "circles": _to_circles,
    "arcs": _to_arcs,
}
"""What a world is made of, in the order of World.n_primitives, and how far (n, 1, 2) points are from the nearest."""


def _read_only_rows(values: ArrayLike, name: str, width: int) -> Floats:
    rows = np.array(values, dtype=np.float64, order="C")
    if rows.size == 0:
        rows = rows.reshape(0, width)
    require(rows.ndim == 2 and rows.shape[1] == width, f"{name} must have shape (n, {width})", rows.shape)
    if not np.all(np.isfinite(rows)):
        raise InvalidArgumentError(f"{name} must be finite numbers")
    rows.setflags(write=False)
    return rows
