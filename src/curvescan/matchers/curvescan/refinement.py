"""Refinement: robust point-to-line Gauss-Newton between two scans, each reading against the other scan's line.

Each reading is paired with the reading that the other sensor has in its direction (projective association,
as Blais and Levine 1995; point to line as Censi 2008), both ways round, so that swapping the scans swaps the result.
A residual is weighed by the variance of both readings across the line: a range error counts for little
where the surface is grazed.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.association import (
    BACKWARD,
    FORWARD,
    Motion,
    associate,
    lever,
    motion_of,
    project_into,
    turned,
    turned_back,
)
from curvescan.matchers.curvescan.config import LIKELY_SIGMAS, REACH, SURE_SIGMAS
from curvescan.matchers.curvescan.features.range_image import RangeImage
from curvescan.matchers.curvescan.features.surfels import NX, NY, RANGE, SHARED, VARIANCE
from curvescan.se2.uncertain import wrap_angle
from curvescan.types import Floats

# Metres by which a residual may be wrong for each metre of range, over what it may at the sensor: how well a rotation
# is known beside a translation, radians a metre.
TURN_SIGMA = 0.3
# Squared normalised residuals (2 and 4 standard deviations) up to which a residual counts in full, and from which on
# not at all; between them less and less, so that no iteration jumps.
_KNEE_CHI2 = LIKELY_SIGMAS * LIKELY_SIGMAS
_OUTLIER_CHI2 = 4 * _KNEE_CHI2
# Least cosine of the angle between two lines of one surface, 46 degrees: the faces of a right corner are two.
_FACING = 0.7
# Information that each parameter has before any reading, 1/m^2 and 1/rad^2: what no reading fixes moves little.
_DAMPING = 10.0
_MAX_STEP = 0.5  # longest step of an iteration, metres and radians: beyond it the lines are others
EXACTLY = np.zeros(1)  # sigma schedule of the last iteration: the pose is as good as the readings
_LEAST_PIVOT = 1e-12  # so that no root is taken of what rounding makes negative
# Columns of normal equations over x, y and theta: the upper triangle of the information, and the gradient.
XX, XY, XT, YY, YT, TT, GRADIENT_X, GRADIENT_Y, GRADIENT_T = range(9)
N_TRIANGLE = TT + 1
N_SUMS = GRADIENT_T + 1


@inlined
def add_square(system: Floats, first: int, weight: float, jx: float, jy: float, jt: float) -> None:
    """Add to the triangle that starts at column `first` the information of one residual with the given derivatives."""
    wx, wy = weight * jx, weight * jy
    system[first + XX] += wx * jx
    system[first + XY] += wx * jy
    system[first + XT] += wx * jt
    system[first + YY] += wy * jy
    system[first + YT] += wy * jt
    system[first + TT] += weight * jt * jt


@kernel
def accumulate(
    surfels: Floats, view: RangeImage, motion: Motion, sigma_extra: float, slope: float, placed: Floats, system: Floats
) -> None:
    """Add to (9,) `system` the normal equations of the readings of one scan against the lines of another.

    The motion is FORWARD where the first is the current one. A residual has this standard deviation besides the noise:
    metres, and metres more for each metre of range. Theta turns about the current sensor. placed (3, m): room to work.
    """
    others, way = view.surfels, motion.way
    project_into(placed, surfels, motion, view)
    for i in range(surfels.shape[0]):
        va = surfels[i, VARIANCE]
        if va < 0.0:
            continue
        j, _, _, _, e, along = associate(placed, i, view)
        if j < 0:
            continue
        vb = others[j, VARIANCE]
        if vb < 0.0:
            continue
        extra = sigma_extra + slope * others[j, RANGE]
        variance = va + vb + extra * extra
        if e * e > _OUTLIER_CHI2 * variance:
            continue
        reach = REACH + SURE_SIGMAS * extra
        spread = REACH * others[j, RANGE]
        if along * along > reach * reach + spread * spread:
            continue
        # facing: both lines must look the same way
        nx, ny = others[j, NX], others[j, NY]
        mx, my = surfels[i, NX], surfels[i, NY]
        mx, my = turned_back(mx, my, motion) if way < 0.0 else turned(mx, my, motion)
        if mx * nx + my * ny < _FACING:
            continue
        # where walls and things contradict each other, walls say where the sensor is; then each reading for itself
        shared = surfels[i, SHARED] + others[j, SHARED] if sigma_extra > 0.0 else 0.0
        weight, u2 = 1.0 / (variance + shared), e * e / variance
        if u2 > _KNEE_CHI2:
            left, whole = _OUTLIER_CHI2 - u2, _OUTLIER_CHI2 - _KNEE_CHI2
            weight *= left * left / (whole * whole)
        if way < 0.0:
            nx, ny = turned(-nx, -ny, motion)
        dx, dy = lever(surfels, i, motion)
        jt = nx * -dy + ny * dx
        add_square(system, XX, weight, nx, ny, jt)
        system[GRADIENT_X] += weight * nx * e
        system[GRADIENT_Y] += weight * ny * e
        system[GRADIENT_T] += weight * jt * e


@inlined
def solve(system: Floats, damping: float) -> tuple[float, float, float]:
    """Return minus the solution of the 3 x 3 normal equations, by Cholesky, each diagonal raised by `damping`."""
    a00 = system[XX] + damping
    a11, a22 = system[YY] + damping, system[TT] + damping
    a01, a02, a12 = system[XY], system[XT], system[YT]
    l00 = math.sqrt(a00)
    l10, l20 = a01 / l00, a02 / l00
    l11 = math.sqrt(max(a11 - l10 * l10, _LEAST_PIVOT))
    l21 = (a12 - l20 * l10) / l11
    l22 = math.sqrt(max(a22 - l20 * l20 - l21 * l21, _LEAST_PIVOT))
    y0 = -system[GRADIENT_X] / l00
    y1 = (-system[GRADIENT_Y] - l10 * y0) / l11
    y2 = (-system[GRADIENT_T] - l20 * y0 - l21 * y1) / l22
    z2 = y2 / l22
    z1 = (y1 - l21 * z2) / l11
    z0 = (y0 - l10 * z1 - l20 * z2) / l00
    return z0, z1, z2


@kernel
def refine(poses: Floats, ref: RangeImage, cur: RangeImage, sigmas: Floats) -> Floats:
    """Return (h, 3) refined poses, with an iteration for each of (n,) sigmas."""
    refined = poses.copy()
    system = np.empty(N_SUMS)
    placed = np.empty((3, max(ref.samples.shape[0], cur.samples.shape[0])))
    for h in range(refined.shape[0]):
        pose = refined[h]
        for sigma_extra in sigmas:
            system[:] = 0.0
            slope = TURN_SIGMA * sigma_extra
            there = motion_of(pose, FORWARD)
            back = Motion(there.c, there.s, there.x, there.y, BACKWARD)
            accumulate(cur.samples, ref, there, sigma_extra, slope, placed, system)
            accumulate(ref.samples, cur, back, sigma_extra, slope, placed, system)
            dx, dy, dtheta = solve(system, _DAMPING)
            step = max(abs(dx), abs(dy), abs(dtheta))
            shrink = _MAX_STEP / step if step > _MAX_STEP else 1.0
            pose[0] += shrink * dx
            pose[1] += shrink * dy
            pose[2] = wrap_angle(pose[2] + shrink * dtheta)
    return refined
