"""Covariance: the information of the inliers on the pose, and the directions in which they have none.

The information of a point-to-line fit in closed form (Censi, "An accurate closed-form estimate of ICP's
covariance", ICRA 2007; "On achievable accuracy for pose tracking", ICRA 2009): each reading constrains the pose along
its line's normal, with the range noise of both scans; readings of a thing that stands free share what it may have moved
by. Lines are fitted to noisy readings, and a tilted line seems to give something along the wall as well: in a corridor
that is all there is. Its expected amount is known from the fit and is taken off, so that a corridor stays unobservable
along itself.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.matchers.curvescan.association import BACKWARD, FORWARD, distances, lever, motion_of, projected, turned
from curvescan.matchers.curvescan.features.features import Surfaces
from curvescan.matchers.curvescan.features.objects import Objects, all_movable
from curvescan.matchers.curvescan.features.surfels import NX, NY, SHARED, TILT, VARIANCE
from curvescan.matchers.curvescan.refinement import N_TRIANGLE, XX, YY, add_square
from curvescan.se2.uncertain import eigen3
from curvescan.types import Bools, Floats, Ints

Row: TypeAlias = tuple[float, float, float]
Open: TypeAlias = tuple[bool, bool, bool]

# Columns of the sums: the triangles of the information and of its spurious part, from tilt; the normalised squared
# residuals, how many there are, the squared distances of the readings from the current sensor.
INFORMATION, SPURIOUS = 0, N_TRIANGLE
CHI2, COUNT, LEVER2 = range(2 * N_TRIANGLE, 2 * N_TRIANGLE + 3)
_N_COLUMNS = LEVER2 + 1

_HOLDS = 0.5  # least share of the information in the least informed direction of an object that may hold it alone

# Free-standing things of a scan that may move together, as people do: more of them do not keep pace by chance.
_MAX_THINGS = 6
_LASTS = 60.0  # seconds that things which stand against a wall are taken to stay there
# Share of the variance of a reading that the line through it holds: OWN_SHARE of its noise, and the rest of a mean.
_LINE_NOISE = 0.3
_LEAST_LEVER = 1e-3  # metres, so that nothing is divided by zero
_SAGITTA2 = 0.5 * 0.5  # square of the half that a sagitta is of the arc's length times its turn


@kernel
def add_information(
    surfels: Floats,
    surfels_other: Floats,
    objects: tuple[Objects, Objects],
    partner: Ints,
    pose: Floats,
    way: float,
    system: Floats,
    parts: Floats,
) -> None:
    """Add the information of the readings of one scan, each against its partner's line.

    Each counts for the whole, for the object that it is of, and for the one that its partner is of. system (15,):
    columns from INFORMATION on; parts (n_cur + n_ref + 2, 12): the same triangles of each object of the current scan,
    then of the reference; of all that stand free, and of all.
    """
    motion = motion_of(pose, way)
    n_objects = objects[0].is_free.size if way > 0.0 else objects[1].is_free.size
    own, others = (0, n_objects) if way > 0.0 else (n_objects, 0)
    for i in range(surfels.shape[0]):
        j = partner[i]
        if j < 0 or surfels[i, VARIANCE] < 0.0 or surfels_other[j, VARIANCE] < 0.0:
            continue
        dx, dy = lever(surfels, i, motion)
        x, y = projected(surfels, i, motion)
        e = distances(x, y, surfels_other, j)[0]
        nx, ny = surfels_other[j, NX], surfels_other[j, NY]
        if way < 0.0:
            nx, ny = turned(nx, ny, motion)
        va, vb = surfels[i, VARIANCE], surfels_other[j, VARIANCE]
        normal, along = (nx, ny, ny * dx - nx * dy), (-ny, nx, nx * dx + ny * dy)
        weight = 1.0 / (va + vb + surfels[i, SHARED] + surfels_other[j, SHARED])
        false = weight * surfels_other[j, TILT]
        add_reading(system, weight, false, normal, along)
        first, second = objects[0].label[i], objects[1].label[j]
        if first >= 0:
            add_reading(parts[own + first], weight, false, normal, along)
        if second >= 0:
            add_reading(parts[others + second], weight, false, normal, along)
        if (first >= 0 and objects[0].is_free[first]) or (second >= 0 and objects[1].is_free[second]):
            add_reading(parts[-2], weight, false, normal, along)
        if first >= 0 or second >= 0:
            add_reading(parts[-1], weight, false, normal, along)
        system[CHI2] += e * e / (va + _LINE_NOISE * vb)
        system[COUNT] += 1.0
        system[LEVER2] += dx * dx + dy * dy


@inlined
def add_reading(sums: Floats, weight: float, false: float, normal: Row, along: Row) -> None:
    """Add the information of one reading, and what is spurious of it; rows: of x, y, theta."""
    add_square(sums, INFORMATION, weight, normal[0], normal[1], normal[2])
    add_square(sums, SPURIOUS, false, along[0], along[1], along[2])


@kernel
def principal(system: Floats, part: Floats, units: Floats, scale: float) -> tuple[Floats, Floats, Floats]:
    """Return the information of a system without a part, in its principal directions, the spurious one, and these."""
    net, false = np.empty((3, 3)), np.empty((3, 3))
    k = 0
    for i in range(3):
        for j in range(i, 3):
            unit = scale * units[i] * units[j]
            spurious_part = system[SPURIOUS + k] - part[SPURIOUS + k]
            net[i, j] = net[j, i] = unit * (system[INFORMATION + k] - part[INFORMATION + k] - spurious_part)
            false[i, j] = false[j, i] = unit * spurious_part
            k += 1
    information, axes = eigen3(net)
    spurious = np.zeros(3)
    for k in range(3):
        for i in range(3):
            for j in range(3):
                spurious[k] += axes[i, k] * false[i, j] * axes[j, k]
    return information, spurious, axes


@inlined
def share_of(part: Floats, units: Floats, axis: Floats) -> float:
    """Return the information of a part along an axis."""
    total, k = 0.0, 0
    for i in range(3):
        for j in range(i, 3):
            twice = 1.0 if i == j else 2.0
            total += twice * part[INFORMATION + k] * units[i] * units[j] * axis[i] * axis[j]
            k += 1
    return total


@kernel
def pose_information(
    ref: Surfaces, cur: Surfaces, partners: tuple[Ints, Ints], pose: Floats, least: float
) -> tuple[Floats, Floats, Floats, Floats, bool]:
    """Return the information that the readings with partners have on the pose, in its principal directions.

    A direction is measured only if it stays so without any one object, or the few that stand free: what they alone fix
    moves with them; so, a minute later, does what stands against a wall. What opens a direction, to less than `least`
    information or twice the spurious part, is left out. information, spurious (3,): 1/m^2, ascending, less the spurious
    part of tilted lines, and that part; axes (3, 3): columns, orthonormal over x, y and theta times the root mean
    square distance of the readings; units (3,): what one unit of each row of `axes` is in metres, metres and radians;
    last whether what is measured is so by objects alone, at most a minute apart: they may all have kept pace.
    """
    system = np.zeros(_N_COLUMNS)
    surfels_ref, surfels_cur, of_ref, of_cur = ref.image.surfels, cur.image.surfels, ref.objects, cur.objects
    is_later = abs(cur.stamp - ref.stamp) > _LASTS
    if is_later:
        of_ref, of_cur = all_movable(of_ref), all_movable(of_cur)
    parts = np.zeros((of_cur.is_free.size + of_ref.is_free.size + 2, CHI2))
    add_information(surfels_cur, surfels_ref, (of_cur, of_ref), partners[1], pose, FORWARD, system, parts)
    add_information(surfels_ref, surfels_cur, (of_ref, of_cur), partners[0], pose, BACKWARD, system, parts)
    n = max(system[COUNT], 1.0)
    arm = math.sqrt(system[LEVER2] / n) + _LEAST_LEVER
    # every reading counts twice, once a way: half of the sum. Residuals larger than the noise
    # explains widen it, smaller ones do not narrow it
    scale = 0.5 / max(system[CHI2] / n, 1.0)
    units = np.array([1.0, 1.0, 1.0 / arm])
    information, spurious, axes = principal(system, np.zeros(CHI2), units, scale)
    if information[0] < max(least, 2.0 * spurious[0]):
        return information, spurious, axes, units, False
    left, false, _ = principal(system, parts[-1], units, scale)
    may_keep_pace = left[0] < max(least, 2.0 * false[0]) and not is_later
    n_free = max(count_free(parts, of_cur.is_free), count_free(parts[of_cur.is_free.size :], of_ref.is_free))
    n_parts = parts.shape[0] - 1 - (n_free > _MAX_THINGS)
    held, weakest = information[0], axes[:, 0].copy()
    lowest = held
    for k in range(n_parts):
        if scale * share_of(parts[k], units, weakest) < _HOLDS * held:
            continue
        left, false, directions = principal(system, parts[k], units, scale)
        if left[0] < max(least, 2.0 * false[0]) and left[0] < lowest:
            information, spurious, axes, lowest = left, false, directions, left[0]
    return information, spurious, axes, units, may_keep_pace


@inlined
def count_free(parts: Floats, is_free: Bools) -> int:
    """Return how many things of one scan that stand free agree."""
    n = 0
    for k in range(is_free.size):
        n += is_free[k] and parts[k, XX] + parts[k, YY] > 0.0
    return n


@kernel
def matrices(information: Row, axes: Floats, units: Floats, is_open: Open, open_sigma: float) -> tuple[Floats, Floats]:
    """Return the (3, 3) information on a pose, zero along its open principal directions, and its covariance.

    The covariance, metres and radians, has `open_sigma` along what is open, and nowhere more.
    """
    matrix, cov = np.zeros((3, 3)), np.zeros((3, 3))
    least = 1.0 / (open_sigma * open_sigma)
    for k in range(3):
        known = 0.0 if is_open[k] else information[k]
        for i in range(3):
            for j in range(3):
                matrix[i, j] += (axes[i, k] / units[i]) * (axes[j, k] / units[j]) * max(known, 0.0)
                cov[i, j] += (axes[i, k] * units[i]) * (axes[j, k] * units[j]) / max(known, least)
        if is_open[k]:
            # an open turn about a place apart from the sensor moves it along an arc: its sagitta, to second order
            turn = abs(axes[2, k]) * units[2] * open_sigma
            way = math.hypot(axes[0, k], axes[1, k]) * open_sigma
            for i in range(2):
                cov[i, i] += _SAGITTA2 * turn * turn * way * way
    return matrix, cov
