"""The direction that a match of keyframes leaves open, as exactly as their walls have it.

A match has it by the normals of single readings, to some milliradians. Along a corridor that is not enough: of a match
that stands still, a way of 2 m along seems to lead 4 mm into the wall. Each edge says that but little, all of them
together shorten a corridor by a tenth. The walls themselves run straight over metres, and say it to 0.2 milliradians.
"""

from __future__ import annotations

import numpy as np

from curvescan.types import Points, Pose

_APART_M = 0.05
"""Readings farther apart than this across the direction are of different walls, metres."""

_FLAT = 0.01
"""Variance of a wall across the direction, of that along it: of more it is none."""

_N_ROUNDS = 3
"""Two walls in one line part only where the direction is nearly right."""


def along_walls(points: Points, direction: Pose) -> Pose:
    """Return an open direction, (x, y, theta), turned to how the walls beside it run; a turn stays as it is.

    points (n, 2): of the reference scan, in whose frame the direction is.
    """
    way = float(np.hypot(direction[0], direction[1]))
    if way <= abs(direction[2]):
        return direction
    along = direction[:2] / way
    for _ in range(_N_ROUNDS):
        across = np.array([-along[1], along[0]])
        order = np.argsort(points @ across, kind="stable")
        x, y = points[order] @ along, points[order] @ across
        wall = np.cumsum(np.diff(y, prepend=y[:1]) > _APART_M)
        n = np.bincount(wall)
        x -= (np.bincount(wall, x) / n)[wall]
        y -= (np.bincount(wall, y) / n)[wall]
        is_flat = (np.bincount(wall, y * y) < _FLAT * np.bincount(wall, x * x))[wall]
        if not is_flat.any():
            break
        along = along + float(np.sum((x * y)[is_flat]) / np.sum((x * x)[is_flat])) * across
        along /= np.hypot(along[0], along[1])
    return np.array([*(way * along), direction[2]])
