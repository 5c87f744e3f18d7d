"""Oriented keypoints: characteristic points at three arm lengths, and ends of surfaces, for hypotheses.

A characteristic point is where a surface turns, as in CF-SMA (eq. 7), but measured between the two lines
that leave it with arms of a fixed length, so that noise at close range makes no corners. It carries a
direction: one pair of oriented keypoints is a full pose. An end of a surface is physical when what
lies behind it is farther away, and a shadow when it is nearer: only the first stays where it is as the sensor moves.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.config import SURE_SIGMAS
from curvescan.matchers.curvescan.features.surfels import RANGE, SUM_X, SUM_Y, X, Y, arms_of, distance2, fit_line
from curvescan.types import Floats, Ints

# Columns of a frame: position, direction of its frame, angle by which the surface turns there, kind.
FX, FY, DIRECTION, TURN, KIND = range(5)
BEGIN, END = 10, 20  # kinds of the first and last reading of a surface; a corner's kind is the number of its arm
_MIN_READINGS = 5  # readings of a surface that has corners: two arms of two, and one between them
# Square of the share of an arm that its last reading must reach, 0.7: what is shorter is another arm's.
_ARM_REACHED2 = 0.49
# Square of how far from its reading, in arms, two lines may meet for a corner to be taken there: half an arm.
_MEETING2 = 0.5 * 0.5
# Variance of the tilt of a line through n readings, evenly spaced: 12 / n times that of a reading, for arms of one
# metre.
_TILT2 = 12
_END_REACHED2 = 0.36  # square of the share of its arm, 0.6, that the line to an end of a surface must have
_GRAZED = 0.2  # sine of the angle of incidence, 12 degrees, below which the place of an end depends on where one stands


@inlined
def arm_direction(sums: Floats, low: int, high: int, dx: float, dy: float) -> tuple[float, float]:
    """Return the unit direction of the line through readings low..high, pointing the way of (dx, dy)."""
    if high - low < 2:
        norm = math.sqrt(dx * dx + dy * dy)
        return dx / norm, dy / norm
    _, _, ux, uy, _, _ = fit_line(sums, low, high)
    if ux * dx + uy * dy < 0.0:
        return -ux, -uy
    return ux, uy


@kernel
def measure_bends(
    readings: Floats, sums: Floats, bounds: Ints, arm: float, straight: float, bend: Floats, lows: Ints, highs: Ints
) -> None:
    """Write how much the surface turns at each reading (1 - cosine), and the ends of its arms.

    straight: square, its sign kept, of the cosine of the least turn that is looked at. `bend` is 0, and the ends are
    not touched, where a surface is straight or an arm too short.
    """
    arm2 = arm * arm
    least2 = _ARM_REACHED2 * arm2
    bend[:] = 0.0
    for s in range(bounds.size - 1):
        start, stop = bounds[s], bounds[s + 1]
        if stop - start < _MIN_READINGS:
            continue
        low, high, upcoming = start, start, start
        for i in range(start, stop):
            if i < upcoming:
                continue
            low, high = arms_of(readings, i, low, high, stop, arm2)
            if i - low < 2 or high - i < 2:
                continue
            if distance2(readings, i, low) < least2 or distance2(readings, i, high) < least2:
                continue
            x, y = readings[i, X], readings[i, Y]
            # chords to the middle of each arm, times its readings: a mean's end is half as noisy
            inx = (i - low) * x - (sums[i, SUM_X] - sums[low, SUM_X])
            iny = (i - low) * y - (sums[i, SUM_Y] - sums[low, SUM_Y])
            outx = sums[high + 1, SUM_X] - sums[i + 1, SUM_X] - (high - i) * x
            outy = sums[high + 1, SUM_Y] - sums[i + 1, SUM_Y] - (high - i) * y
            dot = inx * outx + iny * outy
            squares = (inx * inx + iny * iny) * (outx * outx + outy * outy)
            if dot * abs(dot) > straight * squares:
                upcoming = i + 1 + (high - low) // 8  # no corner within a quarter of an arm
                continue
            lows[i], highs[i] = low, high
            bend[i] = 1.0 - dot / math.sqrt(squares)


@inlined
def is_sharpest(bend: Floats, i: int, low: int, high: int) -> bool:
    """Return whether the surface turns nowhere more within half an arm of reading i."""
    height = bend[i]
    if bend[i - 1] > height or bend[i + 1] >= height:
        return False
    most = height
    for j in range((i + low) // 2, (i + high + 1) // 2 + 1):
        most = max(most, bend[j])
    return bool(most <= height)


@kernel
def corner_between(
    readings: Floats, sums: Floats, low: int, i: int, high: int, arm: float
) -> tuple[float, float, float, float]:
    """Return place, direction and turn of the corner at reading i between the lines low..i - 1 and i + 1..high."""
    x, y = readings[i, X], readings[i, Y]
    inx, iny = arm_direction(sums, low, i - 1, x - readings[low, X], y - readings[low, Y])
    outx, outy = arm_direction(sums, i + 1, high, readings[high, X] - x, readings[high, Y] - y)
    cross, dot = inx * outy - iny * outx, inx * outx + iny * outy
    if abs(cross) > 0.5:
        # where the two lines meet is sharper than any reading
        ax = (sums[i, SUM_X] - sums[low, SUM_X]) / (i - low)
        ay = (sums[i, SUM_Y] - sums[low, SUM_Y]) / (i - low)
        bx = (sums[high + 1, SUM_X] - sums[i + 1, SUM_X]) / (high - i)
        by = (sums[high + 1, SUM_Y] - sums[i + 1, SUM_Y]) / (high - i)
        along = ((bx - ax) * outy - (by - ay) * outx) / cross
        px, py = ax + along * inx, ay + along * iny
        if (px - x) ** 2 + (py - y) ** 2 < _MEETING2 * arm * arm:
            x, y = px, py
    return x, y, math.atan2(iny + outy, inx + outx), math.atan2(cross, dot)


@kernel
def find_corners(
    found: Floats, readings: Floats, sums: Floats, bounds: Ints, arms: Floats, sigma: float, min_turn: float, most: int
) -> int:
    """Write the corners at each arm length into (k, 5) `found`, `most` of them; return how many there are."""
    m, n_found = readings.shape[0], most - most  # 0 that is no constant
    bend = np.empty(m)
    lows = np.empty(m, dtype=np.int64)
    highs = np.empty(m, dtype=np.int64)
    min_bend = 1.0 - math.cos(min_turn)
    straight = math.cos(0.5 * min_turn) * abs(math.cos(0.5 * min_turn))
    for a in range(arms.size - 1, -1, -1):
        measure_bends(readings, sums, bounds, arms[a], straight, bend, lows, highs)
        for s in range(bounds.size - 1):
            for i in range(bounds[s] + 1, bounds[s + 1] - 1):
                if bend[i] < min_bend or n_found >= most:
                    continue
                low, high = lows[i], highs[i]
                if not is_sharpest(bend, i, low, high):
                    continue
                x, y, direction, turn = corner_between(readings, sums, low, i, high, arms[a])
                # a line through n readings over an arm tilts by sigma sqrt(12 / n) / arm
                doubt = sigma * math.sqrt(_TILT2 / float(i - low) + _TILT2 / float(high - i)) / arms[a]
                if abs(turn) < max(min_turn, SURE_SIGMAS * doubt):
                    continue
                found[n_found, FX], found[n_found, FY] = x, y
                found[n_found, DIRECTION], found[n_found, TURN] = direction, turn
                found[n_found, KIND] = a
                n_found += 1
    return n_found


@kernel
def add_ends(
    found: Floats, n_found: int, readings: Floats, sums: Floats, bounds: Ints, arm: float, is_closed: bool
) -> int:
    """Write physical ends of surfaces, which hide nothing nearer than themselves, behind the corners found."""
    m = readings.shape[0]
    for s in range(bounds.size - 1):
        start, stop = bounds[s], bounds[s + 1]
        if stop - start < 4:
            continue
        for side in range(2):
            i = start if side == 0 else stop - 1
            j = i - 1 if side == 0 else i + 1
            if j < 0 or j >= m:
                if not is_closed:
                    continue
                j = m - 1 if j < 0 else 0
            if readings[j, RANGE] < readings[i, RANGE] or n_found >= found.shape[0]:
                continue
            k = i
            way = 1 if side == 0 else -1
            while start <= k + way < stop and distance2(readings, i, k + way) <= arm * arm:
                k += way
            if abs(k - i) < 3 or distance2(readings, i, k) < _END_REACHED2 * arm * arm:
                continue
            x, y = readings[i, X], readings[i, Y]
            low, high = min(i, k), max(i, k)
            dx, dy = readings[high, X] - readings[low, X], readings[high, Y] - readings[low, Y]
            ux, uy = arm_direction(sums, low, high, dx, dy)
            if abs(ux * y - uy * x) < _GRAZED * readings[i, RANGE]:
                continue
            found[n_found, FX], found[n_found, FY] = x, y
            found[n_found, DIRECTION] = math.atan2(uy, ux)
            found[n_found, TURN] = 0.0
            found[n_found, KIND] = BEGIN if side == 0 else END
            n_found += 1
    return n_found
