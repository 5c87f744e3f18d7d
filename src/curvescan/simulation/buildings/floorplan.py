"""Floor plans: rectangular rooms, the doors between them, and the walls that follow from both."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

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
    for i, a in enumerate(rooms):
        for j in range(i + 1, len(rooms)):
            b = rooms[j]
            y_low, y_high = max(a.y0, b.y0), min(a.y1, b.y1)
            x_low, x_high = max(a.x0, b.x0), min(a.x1, b.x1)
            for at_a, at_b in ((a.x1, b.x0), (a.x0, b.x1)):
                if abs(at_a - at_b) < _SAME and y_high - y_low > _SAME:
                    shared.append((i, j, True, at_a, y_low, y_high))
            for at_a, at_b in ((a.y1, b.y0), (a.y0, b.y1)):
                if abs(at_a - at_b) < _SAME and x_high - x_low > _SAME:
                    shared.append((i, j, False, at_a, x_low, x_high))
    return shared


def walls_of(rooms: Sequence[Room], doors: Sequence[Door]) -> World:
    """Return the walls around rooms, as solid boxes, with gaps for the doors.

    Walls that rooms share are built once. Boxes reach half a thickness past corners, so that no slit is
    left, and end square at doors.
    """
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
            boxes.append(
                [at, middle, WALL_THICKNESS, length, 0.0] if is_vertical else [middle, at, length, WALL_THICKNESS, 0.0]
            )
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
    zones = np.empty((len(doors), 4))
    for i, door in enumerate(doors):
        along, across = 0.5 * door.width + 0.15, depth
        dx, dy = (across, along) if door.is_vertical else (along, across)
        zones[i] = [door.x - dx, door.y - dy, door.x + dx, door.y + dy]
    return zones


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
