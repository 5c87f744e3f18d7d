"""Surfaces: the readings of a sweep, where one surface ends and the next begins.

A breakpoint stands where two neighbouring readings lie farther apart than a surface seen at the worst
incidence would have it (Borges and Aldon 2004; eq. 2 of CF-SMA), unless three readings in a row lie on a line: a wall
seen under a smaller angle. Its readings are few, but they fix the turn better than any others, as they lie far away and
their range noise hardly leads off the wall.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.config import LASER_ERROR
from curvescan.types import Bools, Floats, Ints, Points

MAX_GAP = 2
"""A run of at most this many missing readings does not end a surface by itself."""

_MAX_BRIDGED2 = 1.0
"""Square of the longest gap that is bridged, square metres: over longer ones a wall is not distinguishable from
chance."""

_LEAST_INCIDENCE2 = 0.0016
"""Square of the least angle at which a wall is seen, 0.04 rad."""

_LEAST_SHARE2 = 0.16
_MOST_SHARE2 = 1.0 / _LEAST_SHARE2
"""Squares of how far off the third reading lies, 0.4 and 2.5 of the gap: about as far as the two beside it."""

_OFF_LINE2 = LASER_ERROR * LASER_ERROR
"""Square of how far the middle reading lies from the line through the other two, (0.01 m)^2."""

_NEAR_LIMIT = 0.9
"""Share of the incidence limit from which on a beam's turn leaves no angle to divide by."""

_WIDEST = 10.0
"""Gap of a beam's turn beyond it, in ranges times the sine of the turn."""


@kernel
def join_grazed(ranges: Floats, directions: Points, order: Ints, breaks: Bools) -> None:
    """Take back the breaks between readings of walls that are seen at an angle below the limit.

    A gap between two neighbouring beams is no break where the reading before or the one after lies on one line with
    both, about as far away as they are from each other.

    ranges, directions (n,); order (m,); breaks (m,).
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


@kernel
def widest_gap(turn: float, incidence_limit: float) -> float:
    """Return the gap that a surface may show between two readings, per metre of range and a turn of the beam apart."""
    if turn < _NEAR_LIMIT * incidence_limit:
        return math.sin(turn) / math.sin(incidence_limit - turn)
    return _WIDEST * math.sin(turn)


@kernel
def break_order(
    ranges: Floats,
    directions: Points,
    valid: Bools,
    is_clockwise: bool,
    is_closed: bool,
    step: float,
    angles: Floats,
    incidence_limit: float,
    max_gap: int,
    jump: float,
) -> tuple[Ints, Bools]:
    """Return (m,) the beams with readings, counter-clockwise, and (m,) whether a surface begins at each of them."""
    n = ranges.size
    m = 0
    order = np.empty(n, dtype=np.int64)
    for i in range(n):
        k = n - 1 - i if is_clockwise else i
        if valid[k]:
            order[m] = k
            m += 1
    breaks = np.empty(m, dtype=np.bool_)
    # the gap that a surface may show, per metre of range, after 1, 2, ... steps
    slope = np.empty(max_gap + 2)
    for g in range(max_gap + 2):
        slope[g] = widest_gap(g * step, incidence_limit)
    for i in range(m):
        breaks[i] = True
        b = order[i]
        a = order[i - 1] if i > 0 else order[m - 1]
        skipped = abs(b - a)
        if i == 0:
            if not is_closed or m < 3:
                continue
            skipped = n - skipped
        turn = skipped * step
        if angles.size > 0:
            turn = abs(angles[b] - angles[a])
            turn = max(2.0 * math.pi - turn, 0.0) if i == 0 else turn
            skipped = int(turn / step + 0.5)
        if skipped > max_gap + 1:
            continue
        near = min(ranges[a], ranges[b])
        dx = ranges[b] * directions[b, 0] - ranges[a] * directions[a, 0]
        dy = ranges[b] * directions[b, 1] - ranges[a] * directions[a, 1]
        widest = slope[skipped] if angles.size == 0 else widest_gap(turn, incidence_limit)
        limit = near * widest + jump
        breaks[i] = dx * dx + dy * dy > limit * limit
    return order[:m], breaks


@kernel
def ordered_readings(
    ranges: Floats,
    directions: Points,
    valid: Bools,
    is_clockwise: bool,
    is_closed: bool,
    step: float,
    angles: Floats,
    incidence_limit: float,
    max_gap: int,
    jump: float,
) -> tuple[Ints, Floats, Ints]:
    """Return the valid readings counter-clockwise from a breakpoint on, and where surfaces end.

    `angles` has the direction of each beam where these are not evenly spaced, and is empty where they are.

    Returns
    -------
    beam_idx : (m,) int64
        The scan's own index of each reading.
    readings : (m, 3) float64
        x, y and range, metres, sensor frame.
    bounds : (s + 1,) int64
        Segment k is readings[bounds[k]:bounds[k + 1]].
    """
    order, breaks = break_order(
        ranges, directions, valid, is_clockwise, is_closed, step, angles, incidence_limit, max_gap, jump
    )
    m = order.size
    join_grazed(ranges, directions, order, breaks)
    first = 0
    while first < m - 1 and not breaks[first]:
        first += 1
    if m > 0 and not breaks[first]:
        first = 0
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
