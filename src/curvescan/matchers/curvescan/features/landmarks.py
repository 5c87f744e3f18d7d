"""Landmarks: what poses are proposed from, stretches of wall, edges, and the directions and the axis of a scene."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.config import PARALLEL
from curvescan.matchers.curvescan.features.objects import STANDS_BEFORE
from curvescan.matchers.curvescan.features.range_image import bearing
from curvescan.matchers.curvescan.features.surfels import LENGTH, NX, NY, RANGE, X, Y, distance2
from curvescan.types import Floats, Ints

MARK_X, MARK_Y, FACING_X, FACING_Y = range(4)  # columns of walls and edges, see Landmarks
# A stretch of wall ends where it faces another way than at its begin, by 18 degrees, and after so many metres.
_ALIKE, _MAX_STRETCH = 0.95, 2.0
# Bins of the histogram: of 3 degrees, which smoothing and a parabola through the best shift make finer.
N_DIRECTIONS = 120
_LEAST_NORM2 = 1e-12  # square metres, so that a scan without surfaces is not divided by zero
_RIGHT_ANGLES = 4  # directions a right angle apart are one axis


class Landmarks(NamedTuple):
    """What poses are proposed from, in the sensor frame."""

    walls: Floats  # (k, 4): middle of a stretch of surface, and its normal times its length, metres
    edges: Floats  # (k, 4): reading that hides what is beside it, and the unit vector across its beam to that side
    directions: Floats  # (120,): length of surface that faces each direction
    axis: float  # direction in which things that face alike stand beside one another, or at right angles to it, radians


@kernel
def find_landmarks(surfels: Floats, samples: Floats, bounds: Ints, is_closed: bool) -> Landmarks:
    """Return the landmarks of a scan."""
    walls, edges = stretches_of_wall(surfels, bounds), find_edges(surfels, bounds, is_closed)
    return Landmarks(walls, edges, direction_histogram(surfels), axis_of(samples))


@kernel
def stretches_of_wall(surfels: Floats, bounds: Ints) -> Floats:
    """Return the walls of a scan: its surfaces, in stretches that face one way."""
    walls = np.zeros((surfels.shape[0], FACING_Y + 1))
    n = bounds.size - bounds.size  # 0 that is no constant
    for s in range(bounds.size - 1):
        first, length = bounds[s], 0.0
        for i in range(bounds[s], bounds[s + 1]):
            alike = surfels[i, NX] * surfels[first, NX] + surfels[i, NY] * surfels[first, NY]
            if alike < _ALIKE or distance2(surfels, first, i) > _MAX_STRETCH * _MAX_STRETCH:
                n += end_stretch(walls, n, length)
                first, length = i, 0.0
            weight = surfels[i, LENGTH]
            length += weight
            walls[n, MARK_X] += weight * surfels[i, X]
            walls[n, MARK_Y] += weight * surfels[i, Y]
            walls[n, FACING_X] += weight * surfels[i, NX]
            walls[n, FACING_Y] += weight * surfels[i, NY]
        n += end_stretch(walls, n, length)
    return walls[:n].copy()


@kernel
def end_stretch(walls: Floats, n: int, length: float) -> int:
    """Make a mean of the sums of places in row n, and return 1; 0 where no reading had a line."""
    if length > 0.0:
        walls[n, MARK_X] /= length
        walls[n, MARK_Y] /= length
        return 1
    return 0


@kernel
def find_edges(surfels: Floats, bounds: Ints, is_closed: bool) -> Floats:
    """Return the edges of a scan: ends of surfaces that stand before what is beside them."""
    m = surfels.shape[0]
    edges = np.empty((2 * bounds.size, FACING_Y + 1))
    n = m - m  # 0 that is no constant
    for s in range(bounds.size - 1):
        for way in (-1, 1):
            i = bounds[s] if way < 0 else bounds[s + 1] - 1
            j = i + way
            if (j < 0 or j >= m) and not is_closed:
                continue
            r = surfels[i, RANGE]
            if surfels[j % m, RANGE] - r < STANDS_BEFORE:
                continue
            edges[n, MARK_X], edges[n, MARK_Y] = surfels[i, X], surfels[i, Y]
            edges[n, FACING_X], edges[n, FACING_Y] = -way * surfels[i, Y] / r, way * surfels[i, X] / r
            n += 1
    return edges[:n].copy()


@kernel
def axis_of(samples: Floats) -> float:
    """Return the axis of a scene, from pairs of samples: walls lie along it, and rows of round things."""
    x, y = 0.0, 0.0
    for i in range(samples.shape[0]):
        for j in range(i):
            dx, dy = samples[i, X] - samples[j, X], samples[i, Y] - samples[j, Y]
            if samples[i, NX] * samples[j, NX] + samples[i, NY] * samples[j, NY] < PARALLEL:
                continue
            # four times the direction of (dx, dy), as a complex number squared twice
            a, b = dx * dx - dy * dy, 2.0 * dx * dy
            norm = a * a + b * b
            if norm > 0.0:
                x += (a * a - b * b) / norm
                y += 2.0 * a * b / norm
    return bearing(x, y) / _RIGHT_ANGLES


@kernel
def direction_histogram(surfels: Floats) -> Floats:
    """Return (120,) the length of surface that faces each direction, smoothed, of unit norm; it turns with the sensor.

    As in Weiss and von Puttkamer, 1995.
    """
    counts = np.zeros(N_DIRECTIONS)
    places = np.empty(surfels.shape[0])
    for i in range(places.size):  # in a loop of its own, which the compiler turns into vector instructions
        places[i] = (bearing(surfels[i, NX], surfels[i, NY]) + math.pi) * float(N_DIRECTIONS) / (2.0 * math.pi)
    for i in range(places.size):
        k = min(int(places[i]), N_DIRECTIONS - 1)
        share = places[i] - k
        counts[k] += (1.0 - share) * surfels[i, LENGTH]
        counts[k + 1 if k < N_DIRECTIONS - 1 else 0] += share * surfels[i, LENGTH]
    smooth = np.empty(N_DIRECTIONS)
    total = _LEAST_NORM2
    for k in range(N_DIRECTIONS):
        smooth[k] = counts[k - 1] + 2.0 * counts[k] + counts[(k + 1) % N_DIRECTIONS]
        total += smooth[k] * smooth[k]
    return smooth / math.sqrt(total)
