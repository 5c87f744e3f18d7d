"""Objects: the surfaces of a scan that may move as one, a leg, a chair, the leaf of a door, a cabinet at a wall."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.features.surfels import NX, NY, RANGE, SHARED, VARIANCE, distance2
from curvescan.types import Bools, Floats, Ints

PERSON_EXTENT = 0.6  # metres: no person shows more
_OBJECT_EXTENT = 1.0  # metres: what is longer is a wall, and stays
_STANDS_FREE = 0.3  # metres: by so much at least are the surfaces on both sides of a free-standing thing farther away
STANDS_BEFORE = 0.1  # metres: by so much at least one thing stands before another
_MOVES = 0.02  # metres: standard deviation, in each scan, of where a free-standing thing stood: not all stand still


class Objects(NamedTuple):
    """Which readings belong together, as far as one scan shows it."""

    label: Ints  # (m,): number of the object that each reading is of, -1 where that is no small one
    # (m,): the same with things that stand against a wall, which somebody may have moved by the next visit
    movable: Ints
    is_free: Bools  # (n,): which objects are no larger than a person and stand free on both sides
    # (m,): which readings are of things no larger than a person that stand before what is on one side of them
    is_small: Bools


@kernel
def find_objects(surfels: Floats, bounds: Ints) -> Objects:
    """Return the objects of a scan, surfaces of up to 1 m and things that stand against longer ones; write SHARED."""
    m = surfels.shape[0]
    label, movable = np.empty(m, dtype=np.int64), np.empty(m, dtype=np.int64)
    is_small, is_free = np.empty(m, dtype=np.bool_), np.zeros(m, dtype=np.bool_)
    n = m - m  # 0 that is no constant
    for k in range(bounds.size - 1):
        first, last = bounds[k], bounds[k + 1] - 1
        extent = extent_of(surfels, first, last)
        before = surfels[first - 1, RANGE] - surfels[first, RANGE] if first > 0 else np.inf
        behind = surfels[last + 1, RANGE] - surfels[last, RANGE] if last + 1 < m else np.inf
        # another person may hide one side
        stands_free = max(before, behind) >= _STANDS_FREE and min(abs(before), abs(behind)) >= _STANDS_FREE
        is_free[n] = extent <= PERSON_EXTENT and stands_free
        stands_before = extent <= PERSON_EXTENT and max(before, behind) >= STANDS_BEFORE
        own = n if extent <= _OBJECT_EXTENT else -1
        n += own >= 0
        for i in range(first, last + 1):
            label[i], movable[i], is_small[i] = own, own, stands_before
            if own >= 0 and is_free[own]:  # a mean of all of them keeps the variance of the thing
                surfels[i, SHARED] = (last - first + 1) * _MOVES * _MOVES
        for way in (1, -1):
            n_readings = thing_at_end(surfels, first, last, way) if own < 0 else 0
            begin = first if way > 0 else last - n_readings + 1
            for i in range(begin, begin + n_readings):
                movable[i] = n
            n += n_readings > 0
    return Objects(label, movable, is_free[:n].copy(), is_small)


@kernel
def thing_at_end(surfels: Floats, first: int, last: int, way: int) -> int:
    """Return how many readings at the begin of a surface, or its end, are of a thing up to 1 m that stands against it.

    It faces by more than half a right angle another way, towards the room; a jamb, which faces away from it, is built.
    """
    start = begin = first if way > 0 else last
    n_found = 0
    for k in range(1, last - first + 1):
        i = start + way * k
        if distance2(surfels, start, i - way) > _OBJECT_EXTENT * _OBJECT_EXTENT:
            break
        ax, ay, bx, by = surfels[begin, NX], surfels[begin, NY], surfels[i, NX], surfels[i, NY]
        inwards = way * (ax * by - ay * bx)
        if surfels[i, VARIANCE] >= 0.0 and (surfels[begin, VARIANCE] < 0.0 or ax * bx + ay * by < abs(inwards)):
            n_found, begin = k if inwards > 0.0 else 0, i
    return n_found


@inlined
def all_movable(objects: Objects) -> Objects:
    """Return the objects with the things that stand against a wall."""
    return Objects(objects.movable, objects.movable, objects.is_free, objects.is_small)


@inlined
def extent_of(surfels: Floats, first: int, last: int) -> float:
    """Return how far readings first to last lie from the first at most, metres."""
    extent2 = 0.0
    for i in range(first, last + 1):
        extent2 = max(extent2, distance2(surfels, first, i))
    return float(np.sqrt(extent2))
