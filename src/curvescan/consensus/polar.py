"""The polar frame of a scan: from a point to the reading that the sensor has in its direction."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan._jit import kernel
from curvescan.types import Floats, Ints


class View(NamedTuple):
    """One scan as the kernels that compare two scans take it.

    Attributes
    ----------
    probes : (p, 9) float64
        Surfels that are compared with the other scan: a few that stand for all, or all.
    surfels : (m, 9) float64
        Surfels that the other scan is compared with: all.
    fan : (3,) float64
        Direction of slot 0 of the lookup, radians in (-pi, pi], slots a radian, range noise, metres.
    lookup : (n_slots,) int64
        Reading in each direction, see :func:`polar_lookup`.
    """

    probes: Floats
    surfels: Floats
    fan: Floats
    lookup: Ints


@kernel
def polar_lookup(
    beam_idx: Ints, n_beams: int, n_slots: int, is_clockwise: bool, is_closed: bool
) -> Ints:
    """Return (n_slots,) the reading in each direction, counter-clockwise from the first beam.

    -1: the beam there has no reading; -2: out of the field of view, which the last slot of an open sweep stands for.
    The slots of a full circle go once around; when it has a beam less than slots the last slot is left to the first
    beam, when it has one more the last beam has none.
    """
    lookup = np.full(n_slots, -2, dtype=np.int64)
    lookup[: min(n_beams, n_slots)] = -1
    for i in range(beam_idx.size):
        slot = n_beams - 1 - beam_idx[i] if is_clockwise else beam_idx[i]
        if slot < n_slots:
            lookup[slot] = i
    if is_closed and n_beams == n_slots - 1:
        lookup[n_slots - 1] = lookup[0]
    return lookup


@kernel
def reading_at(x: float, y: float, view: View) -> int:
    """Return the reading that a scan has in the direction of (x, y), or a negative number as in its lookup.

    The arc tangent is a polynomial, good to 2e-5 rad (Abramowitz and Stegun 4.4.49): a fraction of a beam.
    """
    ax, ay = abs(x), abs(y)
    z = min(ax, ay) / (max(ax, ay) + 1e-300)
    q = z * z
    a = z * (0.9998660 + q * (-0.3302995 + q * (0.1801410 + q * (-0.0851330 + q * 0.0208351))))
    a = 0.5 * math.pi - a if ay > ax else a
    a = math.pi - a if x < 0.0 else a
    a = -a if y < 0.0 else a
    # both angles lie in (-pi, pi], so that their difference is at most one turn off
    turn = 2.0 * math.pi * view.fan[1]
    place = (a - view.fan[0]) * view.fan[1] + 0.5
    if place < 0.0:
        place += turn
    elif place >= turn:
        place -= turn
    slot = min(math.floor(place), view.lookup.size - 1)
    return int(view.lookup[slot])
