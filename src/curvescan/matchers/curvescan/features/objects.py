"""Objects: the surfaces of a scan that may move as one, a leg, a chair, the leaf of a door."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.features.surfels import RANGE, distance2
from curvescan.types import Bools, Floats, Ints

PERSON_EXTENT = 0.6  # metres: no person shows more
_OBJECT_EXTENT = 1.0  # metres: what is longer is a wall, and stays
_STANDS_FREE = 0.3  # metres: by so much at least are the surfaces on both sides of a free-standing thing farther away
STANDS_BEFORE = 0.1  # metres: by so much at least one thing stands before another
_OPEN = 1.0  # metres: nothing is seen beside the first and the last surface


class Objects(NamedTuple):
    """Which readings belong together, as far as one scan shows it."""

    label: Ints  # (m,): number of the object that each reading is of, -1 where that is no small one
    is_free: Bools  # (n,): which objects are no larger than a person and stand free on both sides
    # (m,): which readings are of things no larger than a person that stand before what is on one side of them
    is_small: Bools


@kernel
def find_objects(surfels: Floats, bounds: Ints) -> Objects:
    """Return the objects of a scan: its surfaces of up to 1 m."""
    m = surfels.shape[0]
    label, is_small, is_free = np.empty(m, dtype=np.int64), np.empty(m, dtype=np.bool_), np.empty(m, dtype=np.bool_)
    n = m - m  # 0 that is no constant
    for k in range(bounds.size - 1):
        first, last = bounds[k], bounds[k + 1] - 1
        extent = extent_of(surfels, first, last)
        before = surfels[first - 1, RANGE] - surfels[first, RANGE] if first > 0 else _OPEN
        behind = surfels[last + 1, RANGE] - surfels[last, RANGE] if last + 1 < m else _OPEN
        # another person may hide one side
        stands_free = max(before, behind) >= _STANDS_FREE and min(abs(before), abs(behind)) >= _STANDS_FREE
        is_free[n] = extent <= PERSON_EXTENT and stands_free
        stands_before = extent <= PERSON_EXTENT and max(before, behind) >= STANDS_BEFORE
        is_object = extent <= _OBJECT_EXTENT
        for i in range(first, last + 1):
            label[i], is_small[i] = n if is_object else -1, stands_before
        n += is_object
    return Objects(label, is_free[:n].copy(), is_small)


@inlined
def extent_of(surfels: Floats, first: int, last: int) -> float:
    """Return how far readings first to last lie from the first at most, metres."""
    extent2 = 0.0
    for i in range(first, last + 1):
        extent2 = max(extent2, distance2(surfels, first, i))
    return float(np.sqrt(extent2))
