"""Association: which reading of the other scan a reading falls on, and how far from its line (projective).

The one place where a reading of one scan meets the other scan; every stage sets its own tolerance on the distances.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.features.range_image import RangeImage, place_in, reading_in
from curvescan.matchers.curvescan.features.surfels import CX, CY, MIN_INCIDENCE2, NX, NY, X, Y
from curvescan.types import Floats

# Rows of projected readings: metres in the frame of the other scan, and slots of its azimuth table.
X_THERE, Y_THERE, PLACE = range(3)
# Readings of the current scan taken into the reference; of the reference into the current scan.
FORWARD, BACKWARD = 1.0, -1.0


class Motion(NamedTuple):
    """A pose of the current scan in the reference, as the readings of one of them are moved by it."""

    # cosine and sine of its rotation
    c: float
    s: float
    # metres
    x: float
    y: float
    way: float  # FORWARD or BACKWARD (no bool: for each constant one Numba would compile anew)


class Association(NamedTuple):
    """A reading in the other scan."""

    j: int  # reading of the other scan in its direction, or a negative number as in the azimuth table
    place: float  # where it stands in the azimuth table, slots
    # the reading in the frame of the other scan, metres
    x: float
    y: float
    # from the centre of the line of reading `j` to it, across the line and along it, metres; 0 where there is none
    across: float
    along: float


@inlined
def motion_of(pose: Floats, way: float) -> Motion:
    """Return the motion by a (3,) pose, FORWARD or BACKWARD."""
    return Motion(math.cos(pose[2]), math.sin(pose[2]), pose[0], pose[1], way)


@inlined
def lever(surfels: Floats, i: int, motion: Motion) -> tuple[float, float]:
    """Return where reading i lies from the current sensor, along the axes of the reference, metres."""
    if motion.way < 0.0:
        return surfels[i, X] - motion.x, surfels[i, Y] - motion.y
    return turned(surfels[i, X], surfels[i, Y], motion)


@inlined
def turned(x: float, y: float, motion: Motion) -> tuple[float, float]:
    """Return a vector of the current scan along the axes of the reference."""
    return motion.c * x - motion.s * y, motion.s * x + motion.c * y


@inlined
def turned_back(x: float, y: float, motion: Motion) -> tuple[float, float]:
    """Return a vector of the reference along the axes of the current scan."""
    return motion.c * x + motion.s * y, motion.c * y - motion.s * x


@inlined
def projected(surfels: Floats, i: int, motion: Motion) -> tuple[float, float]:
    """Return reading i in the frame of the other scan, metres."""
    dx, dy = lever(surfels, i, motion)
    if motion.way < 0.0:
        return turned_back(dx, dy, motion)
    return dx + motion.x, dy + motion.y


@inlined
def faces_away(surfels: Floats, i: int, motion: Motion) -> bool:
    """Return whether the other sensor stands behind the line of reading i, and does not graze it."""
    x, y = (motion.x, motion.y) if motion.way < 0.0 else turned_back(-motion.x, -motion.y, motion)
    dx, dy = surfels[i, X] - x, surfels[i, Y] - y
    away = surfels[i, NX] * dx + surfels[i, NY] * dy
    return bool(away > 0.0 and away * away > MIN_INCIDENCE2 * (dx * dx + dy * dy))


@inlined
def distances(x: float, y: float, surfels: Floats, j: int) -> tuple[float, float]:
    """Return how far (x, y) lies across the line of reading j, and along it from its centre, metres."""
    ux, uy = x - surfels[j, CX], y - surfels[j, CY]
    nx, ny = surfels[j, NX], surfels[j, NY]
    return nx * ux + ny * uy, ny * ux - nx * uy


@inlined
def project(surfels: Floats, motion: Motion, image: RangeImage) -> Floats:
    """Return (3, m) the readings, moved, in the frame of the other scan, and where they stand in its azimuth table."""
    placed = np.empty((3, surfels.shape[0]))
    project_into(placed, surfels, motion, image)
    return placed


@kernel
def project_into(placed: Floats, surfels: Floats, motion: Motion, image: RangeImage) -> None:
    """Write what :func:`project` gives to the first columns of (3, m) `placed`.

    In loops of their own, without a branch, which the compiler turns into vector instructions: three times as fast.
    """
    for i in range(surfels.shape[0]):
        placed[X_THERE, i], placed[Y_THERE, i] = projected(surfels, i, motion)
    azimuth_min, slots_a_radian = image.azimuth_min, image.slots_a_radian
    for i in range(surfels.shape[0]):
        placed[PLACE, i] = place_in(placed[X_THERE, i], placed[Y_THERE, i], azimuth_min, slots_a_radian)


@kernel
def associate(placed: Floats, i: int, image: RangeImage) -> Association:
    """Return what reading i of those that :func:`project` gives falls on in the other scan."""
    x, y, place = placed[X_THERE, i], placed[Y_THERE, i], placed[PLACE, i]
    j = reading_in(place, image)
    if j < 0:
        return Association(j, place, x, y, 0.0, 0.0)
    across, along = distances(x, y, image.surfels, j)
    return Association(j, place, x, y, across, along)


@inlined
def is_seen_through(x: float, y: float, front: float) -> bool:
    """Return whether (x, y) stands nearer than `front` metres: in a free space, if the beam ends beyond."""
    return front > 0.0 and x * x + y * y < front * front
