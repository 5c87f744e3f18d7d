"""The polar frame of a scan: from a point to the reading that the sensor has in its direction."""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.types import Floats, Ints


@kernel
def polar_lookup(beam_idx: Ints, n_beams: int, n_slots: int, is_clockwise: bool) -> Ints:
    """Return (n_slots,) the reading in each direction, counter-clockwise from the first beam.

    -1: the beam there has no reading; -2: out of the field of view. The slots go once around the circle. A full
    circle of one beam fewer or more than slots leaves the last slot to the first beam, or the last beam without one.
    """
    lookup = np.full(n_slots, -2, dtype=np.int64)
    lookup[: min(n_beams, n_slots)] = -1
    for i in range(beam_idx.size):
        slot = n_beams - 1 - beam_idx[i] if is_clockwise else beam_idx[i]
        if slot < n_slots:
            lookup[slot] = i
    if n_beams == n_slots - 1:
        lookup[n_slots - 1] = lookup[0]
    return lookup


@kernel
def reading_at(x: float, y: float, angle_min: float, slots_per_radian: float, lookup: Ints) -> int:
    """Return the reading nearest to the direction of (x, y), or a negative number as in `lookup`.

    The arc tangent is a polynomial, good to 2e-5 rad (Abramowitz and Stegun 4.4.49): a fraction of a beam.
    """
    ax, ay = abs(x), abs(y)
    z = min(ax, ay) / (max(ax, ay) + 1e-300)
    q = z * z
    a = z * (0.9998660 + q * (-0.3302995 + q * (0.1801410 + q * (-0.0851330 + q * 0.0208351))))
    a = 0.5 * math.pi - a if ay > ax else a
    a = math.pi - a if x < 0.0 else a
    a = -a if y < 0.0 else a
    # angle_min lies in (-pi, pi], so that the difference is at most one turn off
    place = (a - angle_min) * slots_per_radian + 0.5
    slot = int(math.floor(place))
    n = lookup.size
    if slot < 0:
        slot = int(math.floor(place + 2.0 * math.pi * slots_per_radian))
    if slot >= n:
        slot = 0
    return int(lookup[slot])
