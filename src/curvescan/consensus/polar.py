"""The polar frame of a scan: from a point to the reading that the sensor has in its direction."""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.types import Floats, Ints

ANGLE_MIN, PER_RADIAN, IS_CLOSED, SIGMA = range(4)
"""Entries of a fan: direction of slot 0, slots a radian, whether the circle is full, range noise in metres."""


@kernel
def polar_lookup(beam_idx: Ints, n_beams: int, is_clockwise: bool) -> Ints:
    """Return (n_beams,) the reading in each slot, counter-clockwise; -1 where there is none."""
    lookup = np.full(n_beams, -1, dtype=np.int64)
    for i in range(beam_idx.size):
        slot = n_beams - 1 - beam_idx[i] if is_clockwise else beam_idx[i]
        lookup[slot] = i
    return lookup


@kernel
def arctangent(y: float, x: float) -> float:
    """Return atan2(y, x) to 2e-5 rad by a polynomial (Abramowitz and Stegun 4.4.49), several times faster."""
    ax, ay = abs(x), abs(y)
    z = min(ax, ay) / max(max(ax, ay), 1e-300)
    q = z * z
    a = z * (
        0.9998660 + q * (-0.3302995 + q * (0.1801410 + q * (-0.0851330 + q * 0.0208351)))
    )
    if ay > ax:
        a = 0.5 * math.pi - a
    if x < 0.0:
        a = math.pi - a
    return -a if y < 0.0 else a


@kernel
def reading_at(x: float, y: float, fan: Floats, lookup: Ints) -> int:
    """Return the reading nearest to the direction of (x, y): -1 where it is missing, -2 outside the field of view."""
    angle = arctangent(y, x) - fan[0]
    angle -= 2.0 * math.pi * math.floor(angle / (2.0 * math.pi))
    n = lookup.size
    slot = int(angle * fan[1] + 0.5)
    if slot >= n:
        if fan[2] == 0.0:
            # just below slot 0
            if 2.0 * math.pi * fan[1] - angle * fan[1] < 0.5:
                return int(lookup[0])
            return -2
        # a full circle of fewer or more beams than steps: the seam belongs to the nearer neighbour
        slot = n - 1 if angle * fan[1] - (n - 1) < 2.0 * math.pi * fan[1] - angle * fan[1] else 0
    return int(lookup[slot])
