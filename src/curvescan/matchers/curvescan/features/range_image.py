"""The range image of a scan: from a point to the reading in its direction (projective association)."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.features.surfels import LENGTH, N_COLUMNS
from curvescan.types import Floats, Ints


class RangeImage(NamedTuple):
    """One scan as the kernels that compare two scans take it."""

    samples: Floats  # (p, 12): surfels that are compared with the other scan: a few that stand for all, or all
    surfels: Floats  # (m, 12): surfels that the other scan is compared with: all
    table: Ints  # (n_slots,): reading in each direction, see :func:`azimuth_table`
    azimuth_min: float  # direction of slot 0 of the table, radians in [-pi, pi]
    # slots for a radian, and between neighbouring beams
    slots_a_radian: float
    slots_a_beam: float


@inlined
def with_samples(image: RangeImage, samples: Floats) -> RangeImage:
    """Return a range image with other samples."""
    return RangeImage(samples, image.surfels, image.table, image.azimuth_min, image.slots_a_radian, image.slots_a_beam)


# Slots of an uneven azimuth table for each median step: the nearest beam is found to an eighth of a step. An even one
# has a slot for each beam.
_SLOTS_A_STEP = 4
_MAX_SLOTS = 1 << 16

# Median steps from the nearest beam from which on a direction is a hole: half a step and as much jitter.
_GAP_STEPS = 1.5
_ROUNDING = 1e-9  # radians, and slots: of a beam that stands a full turn after the first
_TINY = 1e-300  # so that the origin is not divided by zero

# Coefficients of the odd powers of the arc tangent on [0, 1], from the third on, by least squares at places that crowd
# at both ends as Chebyshev's do; rounded, so that all machines agree.
_PLACES = np.cos(np.arange(1, 128, 2) * math.pi / 256)
_FIT = np.linalg.lstsq(_PLACES[:, np.newaxis] ** np.arange(3, 18, 2), np.arctan(_PLACES) - _PLACES, rcond=None)[0]
_ATAN: tuple[float, ...] = tuple(_FIT.round(9).tolist())

# Share of a circle by which steps around it spread most evenly, however many there are.
_GOLDEN_SECTION = 0.5 * (math.sqrt(5) - 1.0)


@kernel
def azimuth_table(
    beam_idx: Ints, angles: Floats, step: float, is_even: bool, is_clockwise: bool, is_closed: bool
) -> tuple[Ints, float]:
    """Return the reading in each direction, counter-clockwise from the first beam, and the slots a radian.

    Each slot holds what the nearest beam has: its reading, or -1 where it has none. -2 where that is farther off than
    one and a half steps, as in a hole, and out of the field of view, which the last slot of an open sweep stands for.

    beam_idx (m,); angles (n,).
    """
    n, turn = angles.size, 2.0 * math.pi
    # beams from the first on, counter-clockwise, the last once more before it and the first after it
    around, reading = np.zeros(n + 2), np.full(n + 2, -1)
    n_once = n - n  # 0 that is no constant
    for k in range(n):
        offset = angles[n - 1 - k] - angles[n - 1] if is_clockwise else angles[k] - angles[0]
        if offset < turn - _ROUNDING:  # what a sweep sees a second time is left to the first
            n_once += 1
            around[n_once] = offset
    for i in range(beam_idx.size):
        k = n - 1 - beam_idx[i] if is_clockwise else beam_idx[i]
        if k < n_once:
            reading[k + 1] = i
    reach = turn if is_closed else around[n_once] + (0.5 if is_even else _GAP_STEPS) * step
    around[0], reading[0] = around[n_once] - turn, reading[n_once]
    around[n_once + 1], reading[n_once + 1] = around[1] + turn, reading[1]
    low, high = (0, n_once + 1) if is_closed else (1, n_once)
    # a full circle has a whole number of slots
    n_whole = math.ceil(min((1 if is_even else _SLOTS_A_STEP) * reach / step, _MAX_SLOTS) - _ROUNDING)
    density = 1.0 / step if is_even else n_whole / reach
    table = np.full(n_whole if is_closed else n_whole + 1, -2)
    after = min(low + 1, high)
    for slot in range(n_whole):
        place = slot / density
        while after < high and around[after] < place:
            after += 1
        before = max(after - 1, low)
        nearest = before if place - around[before] <= around[after] - place else after
        if abs(place - around[nearest]) <= _GAP_STEPS * step:
            table[slot] = reading[nearest]
    return table, density


@kernel
def bearing(x: float, y: float) -> float:
    """Return the angle of (x, y) from the x axis, radians in [-pi, pi], to 1e-8 rad; 0 for the origin.

    A polynomial, several times as fast as math.atan2. One good to 2e-5 rad gives some
    points to the wrong one of two beams, by another rule in each sensor frame, and that moves poses by 0.01 mm.
    """
    ax, ay = abs(x), abs(y)
    z = min(ax, ay) / (max(ax, ay) + _TINY)
    q = z * z
    # in pairs, not by Horner's rule: shorter chains of operations that wait for one another
    q2 = q * q
    c3, c5, c7, c9, c11, c13, c15, c17 = _ATAN
    low = (1.0 + c3 * q) + q2 * (c5 + c7 * q)
    high = (c9 + c11 * q) + q2 * (c13 + c15 * q)
    q4 = q2 * q2
    a = z * (low + q4 * (high + q4 * c17))
    a = 0.5 * math.pi - a if ay > ax else a
    a = math.pi - a if x < 0.0 else a
    return -a if y < 0.0 else a


@inlined
def place_in(x: float, y: float, azimuth_min: float, slots_a_radian: float) -> float:
    """Return where a point stands in a table of such columns, slots, one turn off at most; NaN of what is too far."""
    # both angles lie in [-pi, pi], so that their difference is at most one turn off
    return float((bearing(x, y) - azimuth_min) * slots_a_radian + 0.5)


@inlined
def reading_in(place: float, image: RangeImage) -> int:
    """Return the reading in the slot of a place, or a negative number as in the azimuth table."""
    turn = 2.0 * math.pi * image.slots_a_radian
    if place < 0.0:
        place += turn
    elif place >= turn:
        place -= turn
    # not so of NaN: it is no index
    return int(image.table[int(min(place, image.table.size - 1.0))]) if place >= 0.0 else -2


@inlined
def reading_at(x: float, y: float, image: RangeImage) -> int:
    """Return the reading that a scan has in the direction of (x, y), or a negative number as in its azimuth table."""
    return reading_in(place_in(x, y, image.azimuth_min, image.slots_a_radian), image)


@inlined
def reading_beside(place: float, image: RangeImage, nearest: int) -> int:
    """Return the reading of the two beams on either side of a place that is not the nearest, or a negative number."""
    half = 0.5 * image.slots_a_beam
    before = reading_in(place - half, image)
    return before if before != nearest else reading_in(place + half, image)


@kernel
def choose_samples(surfels: Floats, n_samples: int) -> Floats:
    """Return n_samples surfels, or none if there are no lines, spread evenly over the lengths of the surfaces.

    A reading that stands for much may be chosen more than once. The first few are spread as evenly as all.
    """
    m = surfels.shape[0]
    total = 0.0
    for i in range(m):
        total += surfels[i, LENGTH]
    chosen = np.empty(n_samples, dtype=np.int64)
    count = 0
    reached = 0.0
    for i in range(m):
        length = surfels[i, LENGTH]
        reached += length
        while count < n_samples and length > 0.0 and reached * n_samples >= (count + 0.5) * total:
            chosen[count] = i
            count += 1
    # a stride near the golden section that shares no factor with the count visits each one once
    stride = max(int(_GOLDEN_SECTION * count), 1)
    while math.gcd(stride, max(count, 1)) != 1:
        stride += 1
    samples = np.empty((count, N_COLUMNS))
    k = 0
    for i in range(count):
        for column in range(N_COLUMNS):
            samples[i, column] = surfels[chosen[k], column]
        k = (k + stride) % count
    return samples
