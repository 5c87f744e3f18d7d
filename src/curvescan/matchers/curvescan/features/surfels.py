"""Surfels: the readings of a sweep, each with the line through it.

The line through a reading is fitted to the readings around it; near a corner the fit that has its centre to one side is
taken when it is the better one, so that lines do not bend around corners (as of Kuwahara's edge-preserving filter).
"""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.config import LIKELY_SIGMAS
from curvescan.types import Floats, Ints

# Columns of a surfel: the reading (x, y, range), a point (cx, cy) and the unit normal (nx, ny) of the line through it,
# facing the sensor, the variance of the reading across the line and of the line's direction, the length of surface that
# it stands for, and the variance that it has besides as a part of a thing that may have moved. Without a line the
# variance is negative and the length 0.
X, Y, RANGE, CX, CY, NX, NY, VARIANCE, TILT, LENGTH, SPACING, SHARED = range(12)
N_COLUMNS = SHARED + 1

SUM_X, SUM_Y, SUM_XX, SUM_XY, SUM_YY = range(5)  # columns of the running sums of `moments`
# Columns of the line fitted around a reading: its centre and unit direction, mean squared distance of its readings from
# it, sum of squares along it, first and last reading.
FIT_X, FIT_Y, FIT_UX, FIT_UY, FIT_VARIANCE, FIT_ALONG, FIT_LOW, FIT_HIGH = range(8)
# The line runs at this share of the way from the fit to its reading: all of it would leave each residual the noise of
# two readings, none of it lose what the surface does within an arm.
OWN_SHARE = 0.4
# Two fifths of the variances of n residuals about a line lie below the true one over this: the chi-square quantile by
# Wilson and Hilferty.
_SPREAD = 2.0 / (9 * np.maximum(np.arange(65) - 2, 3))
_RAISED = 1.0 / (1.0 - _SPREAD - 0.2533 * np.sqrt(_SPREAD)) ** 3


# Least square of the cosine of incidence by which a line's noise is taken for the range's: grazed walls say little.
_MIN_FACING2 = 0.05
# Multiple of the variance that noise explains from which on a line goes around a corner: a better one is sought.
_BENT = 1.5
# A line is better when its variance is less by this factor: of two that are as good the reading's own is kept.
_BETTER = 1.3
_MIN_INCIDENCE = 0.1  # least cosine of incidence that surfels are taken to have: a grazed wall is rough
MIN_INCIDENCE2 = _MIN_INCIDENCE * _MIN_INCIDENCE

# Multiple of the variance that noise explains beyond which the rest is the surface's: below it it may be chance.
_ROUGH = LIKELY_SIGMAS * LIKELY_SIGMAS
_LEAST_ALONG = 1e-12  # square metres: readings in one place have no line

_MIN_LENGTH, _MAX_LENGTH = 0.03, 0.3  # length of surface that a reading stands for, metres, at least and at most


@inlined
def moments(readings: Floats) -> Floats:
    """Return (m + 1, 5) running sums of x, y, x x, x y, y y: any stretch's moments are a difference of rows."""
    m = readings.shape[0]
    sums = np.zeros((m + 1, 5))
    for i in range(m):
        x, y = readings[i, X], readings[i, Y]
        sums[i + 1, SUM_X] = sums[i, SUM_X] + x
        sums[i + 1, SUM_Y] = sums[i, SUM_Y] + y
        sums[i + 1, SUM_XX] = sums[i, SUM_XX] + x * x
        sums[i + 1, SUM_XY] = sums[i, SUM_XY] + x * y
        sums[i + 1, SUM_YY] = sums[i, SUM_YY] + y * y
    return sums


@inlined
def distance2(readings: Floats, i: int, j: int) -> float:
    """Return the square of the distance between two readings, square metres."""
    dx, dy = readings[j, X] - readings[i, X], readings[j, Y] - readings[i, Y]
    return float(dx * dx + dy * dy)


@inlined
def arms_of(readings: Floats, i: int, low: int, high: int, stop: int, arm2: float) -> tuple[int, int]:
    """Return the first and the last reading within an arm of reading i, two a side at least.

    low, high: those of a reading before it on the same surface, which ends at `stop`.
    """
    while i - low > 2 and distance2(readings, i, low) > arm2:
        low += 1
    high = max(high, i)
    while high + 1 < stop and (high - i < 2 or distance2(readings, i, high + 1) <= arm2):
        high += 1
    return low, high


@kernel
def fit_line(sums: Floats, low: int, high: int) -> tuple[float, float, float, float, float, float]:
    """Return the total least squares line through readings low..high, both inclusive."""
    n = high - low + 1
    share = 1.0 / n
    cx = (sums[high + 1, SUM_X] - sums[low, SUM_X]) * share
    cy = (sums[high + 1, SUM_Y] - sums[low, SUM_Y]) * share
    sxx = sums[high + 1, SUM_XX] - sums[low, SUM_XX] - n * cx * cx
    sxy = sums[high + 1, SUM_XY] - sums[low, SUM_XY] - n * cx * cy
    syy = sums[high + 1, SUM_YY] - sums[low, SUM_YY] - n * cy * cy
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
        scale = 1.0 / norm
        ux, uy = ux * scale, uy * scale
    else:
        ux, uy = 1.0, 0.0
    return cx, cy, ux, uy, max(mean - root, 0.0), mean + root


@kernel
def fit_lines(readings: Floats, bounds: Ints, arm: float, growth: float) -> tuple[Floats, float]:
    """Return (m, 8) the line around each reading, and the range noise of the sweep at the sensor.

    The noise is a low quantile (two fifths, as clutter raises many) of the fits' residual variances along the beams.
    """
    m = readings.shape[0]
    sums = moments(readings)
    fits = np.zeros((m, FIT_HIGH + 1))
    variances = np.empty(m)  # of ranges, by the lines of five readings or more
    n_fits = 0
    for s in range(bounds.size - 1):
        start, stop = bounds[s], bounds[s + 1]
        low, high = start, start
        for i in range(start, stop):
            x, y = readings[i, X], readings[i, Y]
            low, high = arms_of(readings, i, low, high, stop, arm * arm)
            n = high - low + 1
            fits[i, FIT_LOW], fits[i, FIT_HIGH] = low, high
            if n < 3:
                fits[i, FIT_VARIANCE] = 1.0
                continue
            cx, cy, ux, uy, across, along = fit_line(sums, low, high)
            variance = across / (n - 2)
            fits[i, FIT_X], fits[i, FIT_Y], fits[i, FIT_UX], fits[i, FIT_UY] = cx, cy, ux, uy
            fits[i, FIT_VARIANCE], fits[i, FIT_ALONG] = variance, along
            if n >= 5:
                facing = (ux * y - uy * x) / readings[i, RANGE]
                of_one = max(facing * facing, _MIN_FACING2) * (1.0 + growth * readings[i, RANGE] ** 2)
                variances[n_fits] = variance * _RAISED[min(n, 64)] / of_one
                n_fits += 1
    return fits, math.sqrt(low_quantile(variances[:n_fits]))


@kernel
def low_quantile(variances: Floats) -> float:
    """Return the variance that two fifths lie below, square metres; 0 of none.

    Found without sorting, in bins of a quarter of an octave from (0.1 mm)^2 to (1 m)^2: a bin is the exponent of the
    number and the first two bits of its fraction, as they stand in memory.
    """
    first, n_bins = (1023 - 27) * 4, 108
    histogram = np.zeros(n_bins, dtype=np.int64)
    for bits in variances.view(np.int64):
        histogram[min(max((bits >> 50) - first, 0), n_bins - 1)] += 1
    count, k = 0, 0
    while k < n_bins - 1 and 5 * (count + histogram[k]) < 2 * variances.size:
        count += histogram[k]
        k += 1
    inside = (2 / 5 * variances.size - count) / max(histogram[k], 1)
    return 2.0 ** (k // 4 - 27) * (1.0 + (k % 4 + inside) / 4) if variances.size else 0.0


@inlined
def best_fit(fits: Floats, i: int, facing2: float, sigma2: float) -> int:
    """Return the reading whose line reading i is to have: its own, or a better one that also holds it.

    The readings of a line around a corner lie farther from it than the noise explains; then that of all lines which
    hold reading i is taken from which its readings lie least far.
    """
    best = i
    if fits[i, FIT_VARIANCE] <= _BENT * sigma2 * max(facing2, MIN_INCIDENCE2):
        return best
    least = fits[i, FIT_VARIANCE] / _BETTER
    for j in range(int(fits[i, FIT_LOW]), int(fits[i, FIT_HIGH]) + 1):
        holds = fits[j, FIT_LOW] <= i <= fits[j, FIT_HIGH] and fits[j, FIT_HIGH] - fits[j, FIT_LOW] >= 3
        if holds and fits[j, FIT_VARIANCE] < least:
            best, least = j, fits[j, FIT_VARIANCE]
    return best


@kernel
def fit_surfels(readings: Floats, fits: Floats, step: float, noise: tuple[float, float, float]) -> Floats:
    """Return the readings with the lines through them, as (m, 12) surfels.

    A reading stands for the length of surface between it and its neighbours, `step` radians away, but for no more than
    0.3 m and for no less than 0.03 m: near surfaces, which are dense, do not count for all, nor far ones. noise: of a
    range at the sensor, the growth of its variance, and the least noise anywhere.
    """
    m = readings.shape[0]
    sigma, growth, sigma_min = noise
    surfels = np.empty((m, N_COLUMNS))
    for i in range(m):
        x, y, r = readings[i, X], readings[i, Y], readings[i, RANGE]
        bx, by = x / r, y / r
        sigma2 = max(sigma * math.sqrt(1.0 + growth * r * r), sigma_min) ** 2
        surfels[i, X], surfels[i, Y], surfels[i, RANGE], surfels[i, SHARED] = x, y, r, 0.0
        if fits[i, FIT_HIGH] - fits[i, FIT_LOW] < 2.0:
            # alone: a point that faces the sensor and holds no line
            surfels[i, CX], surfels[i, CY] = x, y
            surfels[i, NX], surfels[i, NY] = -bx, -by
            surfels[i, VARIANCE], surfels[i, TILT], surfels[i, LENGTH] = -1.0, 1.0, 0.0
            surfels[i, SPACING] = r * step
            continue
        facing = fits[i, FIT_UX] * by - fits[i, FIT_UY] * bx
        best = best_fit(fits, i, facing * facing, sigma2)
        nx, ny = -fits[best, FIT_UY], fits[best, FIT_UX]
        facing = nx * bx + ny * by
        if facing > 0.0:
            nx, ny, facing = -nx, -ny, -facing
        variance = sigma2 * max(facing * facing, MIN_INCIDENCE2)
        rough = fits[best, FIT_VARIANCE] - _ROUGH * variance
        if rough > 0.0:
            variance += rough
        off = OWN_SHARE * (nx * (x - fits[best, FIT_X]) + ny * (y - fits[best, FIT_Y]))
        surfels[i, CX], surfels[i, CY] = fits[best, FIT_X] + off * nx, fits[best, FIT_Y] + off * ny
        surfels[i, NX], surfels[i, NY] = nx, ny
        surfels[i, VARIANCE] = variance
        surfels[i, TILT] = variance / max(fits[best, FIT_ALONG], _LEAST_ALONG)
        spacing = r * step / max(-facing, _MIN_INCIDENCE)
        surfels[i, LENGTH] = min(max(spacing, _MIN_LENGTH), _MAX_LENGTH)
        surfels[i, SPACING] = spacing
    return surfels
