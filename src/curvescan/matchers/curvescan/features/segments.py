"""Surfaces: the readings of a sweep, where one surface ends and the next begins.

A breakpoint stands where two neighbouring readings lie farther apart than a surface seen at the worst
incidence would have it (Borges and Aldon 2004; eq. 2 of CF-SMA), unless three readings in a row lie on a line: a wall
seen under a smaller angle. Its readings are few, but they fix the turn better than any others, as they lie far away and
their range noise hardly leads off the wall.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.config import LASER_ERROR
from curvescan.types import Bools, Floats, Ints, Points

MAX_GAP = 2  # a run of at most this many missing readings does not end a surface by itself
# Square of the longest gap that is bridged, square metres: over longer ones a wall is not distinguishable from chance.
_MAX_BRIDGED2 = 1.0
_LEAST_INCIDENCE2 = 0.0016  # square of the least angle at which a wall is seen, 0.04 rad
# Squares of how far off the third reading lies, 0.4 and 2.5 of the gap: about as far as the two beside it.
_LEAST_SHARE2 = 0.16
_MOST_SHARE2 = 1.0 / _LEAST_SHARE2
# Square of how far the middle reading lies from the line through the other two, (0.01 m)^2.
_OFF_LINE2 = LASER_ERROR * LASER_ERROR
_NEAR_LIMIT = 0.9  # share of the incidence limit from which on a beam's turn leaves no angle to divide by
_WIDEST = 10.0  # gap of a beam's turn beyond it, in ranges times the sine of the turn


class Sweep(NamedTuple):
    """What a scan saw, as the kernels take it."""

    ranges: Floats  # (n,): metres
    valid_range: tuple[float, float]  # the least and the greatest that is a measurement
    directions: Points  # (n, 2): unit vectors of the beams
    angles: Floats  # (n,): direction of each beam, radians
    step: float  # from a beam to the next, radians, > 0
    is_even: bool  # whether all steps are alike
    is_clockwise: bool
    is_closed: bool  # whether the last beam neighbours the first
    growth: float  # of the variance of the range noise with the square of the range, of that at the sensor


@kernel
def join_grazed(ranges: Floats, directions: Points, order: Ints, breaks: Bools) -> None:
    """Take back the breaks between readings of walls that are seen at an angle below the limit.

    A gap between two neighbouring beams is no break where the reading before or the one after lies on one line with
    both, about as far away as they are from each other.
    """
    m = order.size
    for i in range(1, m):
        a, b = order[i - 1], order[i]
        if not breaks[i] or abs(b - a) > 1:
            continue
        ax, ay = ranges[a] * directions[a, 0], ranges[a] * directions[a, 1]
        bx, by = ranges[b] * directions[b, 0], ranges[b] * directions[b, 1]
        dx, dy = bx - ax, by - ay
        length2 = dx * dx + dy * dy
        far = max(ranges[a], ranges[b])
        least2 = _LEAST_INCIDENCE2 * length2 * far * far
        if length2 > _MAX_BRIDGED2 or (ax * by - ay * bx) ** 2 < least2:
            continue
        for k in (i - 2, i + 1):
            if k < 0 or k >= m:
                continue
            c = order[k]
            before = k < i
            if abs(c - (a if before else b)) > 1:
                continue
            cx, cy = ranges[c] * directions[c, 0], ranges[c] * directions[c, 1]
            ex, ey = (ax - cx, ay - cy) if before else (cx - bx, cy - by)
            e2 = ex * ex + ey * ey
            is_alike = _LEAST_SHARE2 * length2 <= e2 <= _MOST_SHARE2 * length2
            if not is_alike or ex * dx + ey * dy <= 0.0:
                continue
            # the middle one of the three within a centimetre of the line through the others
            cross = ex * dy - ey * dx
            if cross * cross < _OFF_LINE2 * ((ex + dx) ** 2 + (ey + dy) ** 2):
                breaks[i] = False
                break


@inlined
def widest_gap(turn: float, incidence_limit: float) -> float:
    """Return the gap that a surface may show between two readings, per metre of range and a turn of the beam apart."""
    if turn < _NEAR_LIMIT * incidence_limit:
        return math.sin(turn) / math.sin(incidence_limit - turn)
    return _WIDEST * math.sin(turn)


@kernel
def break_order(sweep: Sweep, incidence_limit: float, jump: float) -> tuple[Ints, Bools]:
    """Return (m,) the beams with readings, counter-clockwise, and (m,) whether a surface begins at each of them."""
    ranges, directions, angles, step = sweep.ranges, sweep.directions, sweep.angles, sweep.step
    least, most = sweep.valid_range
    n = ranges.size
    m = 0
    order = np.empty(n, dtype=np.int64)
    for i in range(n):
        k = n - 1 - i if sweep.is_clockwise else i
        if least <= ranges[k] <= most:
            order[m] = k
            m += 1
    breaks = np.empty(m, dtype=np.bool_)
    # the gap that a surface may show, per metre of range, after 1, 2, ... steps
    slope = np.empty(MAX_GAP + 2)
    for g in range(MAX_GAP + 2):
        slope[g] = widest_gap(g * step, incidence_limit)
    for i in range(m):
        breaks[i] = True
        b = order[i]
        a = order[i - 1] if i > 0 else order[m - 1]
        skipped = abs(b - a)
        if i == 0:
            if not sweep.is_closed or m < 3:
                continue
            skipped = n - skipped
        turn = skipped * step
        if not sweep.is_even:
            turn = abs(angles[b] - angles[a])
            turn = max(2.0 * math.pi - turn, 0.0) if i == 0 else turn
            skipped = int(turn / step + 0.5)
        if skipped > MAX_GAP + 1:
            continue
        near = min(ranges[a], ranges[b])
        dx = ranges[b] * directions[b, 0] - ranges[a] * directions[a, 0]
        dy = ranges[b] * directions[b, 1] - ranges[a] * directions[a, 1]
        widest = slope[skipped] if sweep.is_even else widest_gap(turn, incidence_limit)
        limit = near * widest + jump
        breaks[i] = dx * dx + dy * dy > limit * limit
    return order[:m], breaks


@kernel
def begin_of_longest(ranges: Floats, order: Ints, breaks: Bools) -> int:
    """Return where the longest surface of a full circle begins, whichever beam the sensor lists first; 0 without any.

    Of surfaces with as many readings it is that which begins farthest away.
    """
    m = order.size
    first, most, last = 0, 0, -1
    for i in range(2 * m):
        j = i % m
        if not breaks[j]:
            continue
        if last >= 0:
            n, begin = i - last, last % m
            if n > most or (n == most and ranges[order[begin]] > ranges[order[first]]):
                first, most = begin, n
        last = i
    return first


@kernel
def ordered_readings(sweep: Sweep, incidence_limit: float, jump: float) -> tuple[Ints, Floats, Ints]:
    """Return the valid readings counter-clockwise, of a full circle from a breakpoint on, and where surfaces end.

    beam_idx (m,): the scan's own index of each; readings (m, 3): x, y and range, metres; bounds (s + 1,): segment k is
    readings[bounds[k]:bounds[k + 1]].
    """
    ranges, directions = sweep.ranges, sweep.directions
    order, breaks = break_order(sweep, incidence_limit, jump)
    m = order.size
    join_grazed(ranges, directions, order, breaks)
    first = begin_of_longest(ranges, order, breaks) if sweep.is_closed else 0
    beam_idx = np.empty(m, dtype=np.int64)
    readings = np.empty((m, 3))
    bounds = np.empty(m + 1, dtype=np.int64)
    n_segments = 0
    for i in range(m):
        j = i + first
        if j >= m:
            j -= m
        k = order[j]
        beam_idx[i] = k
        readings[i, 0] = ranges[k] * directions[k, 0]
        readings[i, 1] = ranges[k] * directions[k, 1]
        readings[i, 2] = ranges[k]
        if breaks[j] or i == 0:
            bounds[n_segments] = i
            n_segments += 1
    bounds[n_segments] = m
    return beam_idx, readings, bounds[: n_segments + 1]
