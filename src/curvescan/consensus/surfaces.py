"""Surfaces: the readings of a sweep, where one surface ends and the next begins, and the line through each reading.

A breakpoint stands where two neighbouring readings lie farther apart than a surface seen at the worst
incidence would have it (Borges and Aldon 2004; eq. 2 of CF-SMA). The line through a reading is fitted to
the readings around it; near a corner the fit that has its centre to one side is taken when it is the
better one, so that lines do not bend around corners (the idea of Kuwahara's edge-preserving filter).
"""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.types import Bools, Floats, Ints, Points

X, Y, RANGE, CX, CY, NX, NY, VARIANCE, TILT = range(9)
"""Columns of a surfel: the reading (x, y, range), a point (cx, cy) and the unit normal (nx, ny) of the line
through it, facing the sensor, the variance of the reading across the line and of the line's direction."""

N_COLUMNS = 9


@kernel
def widest_gap(turn: float, incidence_limit: float) -> float:
    """Return the gap that a surface may show between two readings, per metre of range and a turn of the beam apart."""
    if turn < 0.9 * incidence_limit:
        return math.sin(turn) / math.sin(incidence_limit - turn)
    return 10.0 * math.sin(turn)


@kernel
def sweep(
    ranges: Floats,
    directions: Points,
    valid: Bools,
    is_clockwise: bool,
    is_closed: bool,
    step: float,
    angles: Floats,
    incidence_limit: float,
    max_gap: int,
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
    n = ranges.size
    m = 0
    order = np.empty(n, dtype=np.int64)
    for i in range(n):
        k = n - 1 - i if is_clockwise else i
        if valid[k]:
            order[m] = k
            m += 1
    breaks = np.ones(m, dtype=np.bool_)
    # the gap that a surface may show, per metre of range, after 1, 2, ... steps
    slope = np.empty(max_gap + 2)
    for g in range(max_gap + 2):
        slope[g] = widest_gap(g * step, incidence_limit)
    first = -1
    for i in range(m):
        b = order[i]
        a = order[i - 1] if i > 0 else order[m - 1]
        skipped = abs(b - a)
        if i == 0:
            if not is_closed or m < 3:
                first = 0
                continue
            skipped = n - skipped
        turn = skipped * step
        if angles.size > 0:
            turn = abs(angles[b] - angles[a])
            turn = max(2.0 * math.pi - turn, 0.0) if i == 0 else turn
            skipped = int(turn / step + 0.5)
        if skipped > max_gap + 1:
            if first < 0:
                first = i
            continue
        near = min(ranges[a], ranges[b])
        dx = ranges[b] * directions[b, 0] - ranges[a] * directions[a, 0]
        dy = ranges[b] * directions[b, 1] - ranges[a] * directions[a, 1]
        widest = slope[skipped] if angles.size == 0 else widest_gap(turn, incidence_limit)
        limit = near * widest + 0.03
        breaks[i] = dx * dx + dy * dy > limit * limit
        if breaks[i] and first < 0:
            first = i
    first = max(first, 0)
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


@kernel
def moments(readings: Floats) -> Floats:
    """Return (m + 1, 5) running sums of x, y, x x, x y, y y: any stretch's moments are a difference of rows."""
    m = readings.shape[0]
    sums = np.zeros((m + 1, 5))
    for i in range(m):
        x, y = readings[i, 0], readings[i, 1]
        sums[i + 1, 0] = sums[i, 0] + x
        sums[i + 1, 1] = sums[i, 1] + y
        sums[i + 1, 2] = sums[i, 2] + x * x
        sums[i + 1, 3] = sums[i, 3] + x * y
        sums[i + 1, 4] = sums[i, 4] + y * y
    return sums


@kernel
def fit_line(sums: Floats, low: int, high: int) -> tuple[float, float, float, float, float, float]:
    """Return the total least squares line through readings low..high, both inclusive.

    Returns
    -------
    cx, cy : float
        Centre of the readings.
    ux, uy : float
        Unit direction of the line, of either sign.
    across, along : float
        Sums of squared distances from the line and, along it, from the centre.
    """
    n = high - low + 1
    cx = (sums[high + 1, 0] - sums[low, 0]) / n
    cy = (sums[high + 1, 1] - sums[low, 1]) / n
    sxx = sums[high + 1, 2] - sums[low, 2] - n * cx * cx
    sxy = sums[high + 1, 3] - sums[low, 3] - n * cx * cy
    syy = sums[high + 1, 4] - sums[low, 4] - n * cy * cy
    half = 0.5 * (sxx - syy)
    root = math.sqrt(half * half + sxy * sxy)
    mean = 0.5 * (sxx + syy)
    # the better conditioned of the two forms of the eigenvector
    if half >= 0.0:
        ux, uy = half + root, sxy
    else:
        ux, uy = sxy, root - half
    norm = math.sqrt(ux * ux + uy * uy)
    if norm > 0.0:
        ux, uy = ux / norm, uy / norm
    else:
        ux, uy = 1.0, 0.0
    return cx, cy, ux, uy, max(mean - root, 0.0), mean + root


@kernel
def fit_surfels(
    readings: Floats, sums: Floats, bounds: Ints, arm: float, sigma_min: float
) -> tuple[Floats, float]:
    """Return the readings with the lines through them, as (m, 9) surfels, and the range noise of the sweep.

    The noise is a low quantile (two fifths, as clutter raises many) of the residual variances of all fits, taken
    along the beams; a histogram over the logarithm finds it without sorting.
    """
    m = readings.shape[0]
    surfels = np.empty((m, 9))
    for i in range(m):
        for k in range(3):
            surfels[i, k] = readings[i, k]
    fits = np.zeros((m, 8))  # cx, cy, ux, uy, variance across, along, first, last reading
    # two fifths of the variances of n residuals lie below this share of the true one: the chi-square quantile by
    # Wilson and Hilferty
    share = np.empty(65)
    for n in range(5, 65):
        spread = 2.0 / (9.0 * (n - 2))
        root = 1.0 - spread - 0.2533 * math.sqrt(spread)
        share[n] = root * root * root
    histogram = np.zeros(64, dtype=np.int64)
    n_fits = 0
    for s in range(bounds.size - 1):
        start, stop = bounds[s], bounds[s + 1]
        low, high = start, start
        for i in range(start, stop):
            x, y = surfels[i, 0], surfels[i, 1]
            while i - low > 2:
                dx, dy = surfels[low, 0] - x, surfels[low, 1] - y
                if dx * dx + dy * dy <= arm * arm:
                    break
                low += 1
            high = max(high, i)
            while high + 1 < stop:
                dx, dy = surfels[high + 1, 0] - x, surfels[high + 1, 1] - y
                if high - i >= 2 and dx * dx + dy * dy > arm * arm:
                    break
                high += 1
            n = high - low + 1
            fits[i, 6], fits[i, 7] = low, high
            if n < 3:
                fits[i, 4] = 1.0
                continue
            cx, cy, ux, uy, across, along = fit_line(sums, low, high)
            variance = across / (n - 2)
            fits[i, 0], fits[i, 1], fits[i, 2], fits[i, 3] = cx, cy, ux, uy
            fits[i, 4], fits[i, 5] = variance, along
            if n >= 5:
                facing = (ux * y - uy * x) / surfels[i, 2]
                cos2 = max(facing * facing, 0.05)
                # bins of a quarter of an octave of variance, from (0.1 mm)^2 on
                level = int(
                    4.0
                    * (math.log(variance / (cos2 * share[min(n, 64)]) + 1e-12) - math.log(1e-8))
                    / math.log(2.0)
                )
                histogram[min(max(level, 0), 63)] += 1
                n_fits += 1
    count = 0
    level = 0
    while level < 63 and 5 * (count + histogram[level]) < 2 * n_fits:
        count += histogram[level]
        level += 1
    inside = (0.4 * n_fits - count) / max(histogram[level], 1)
    sigma2 = 1e-8 * 2.0 ** (0.25 * (level + inside)) if n_fits > 0 else 0.0
    sigma2 = max(sigma2, sigma_min * sigma_min)
    for i in range(m):
        low, high = int(fits[i, 6]), int(fits[i, 7])
        best = i
        if 3.0 * fits[low, 4] < fits[best, 4] and fits[low, 7] >= i:
            best = low
        if 3.0 * fits[high, 4] < fits[best, 4] and fits[high, 6] <= i:
            best = high
        x, y, r = surfels[i, 0], surfels[i, 1], surfels[i, 2]
        n = int(fits[best, 7] - fits[best, 6]) + 1
        if n < 3:
            # alone: a point that faces the sensor and holds no line
            surfels[i, 3], surfels[i, 4] = x, y
            surfels[i, 5], surfels[i, 6] = -x / r, -y / r
            surfels[i, 7], surfels[i, 8] = -1.0, 1.0
            continue
        nx, ny = -fits[best, 3], fits[best, 2]
        facing = (nx * x + ny * y) / r
        if facing > 0.0:
            nx, ny, facing = -nx, -ny, -facing
        cos2 = max(facing * facing, 0.01)
        variance = sigma2 * cos2
        rough = fits[best, 4] - 4.0 * variance
        if rough > 0.0:
            variance += rough
        surfels[i, 3], surfels[i, 4] = fits[best, 0], fits[best, 1]
        surfels[i, 5], surfels[i, 6] = nx, ny
        surfels[i, 7] = variance
        surfels[i, 8] = variance / max(fits[best, 5], 1e-12)
    return surfels, math.sqrt(sigma2)
