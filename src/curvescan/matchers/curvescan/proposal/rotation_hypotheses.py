"""Hypotheses for scans without corners: rotations from the directions of surfaces, and places along a corridor.

The histogram of the directions of all surfaces turns with the sensor. A turn at which the histograms of two scans
correlate is a candidate rotation (Weiss and von Puttkamer 1995). The walls of a corridor fix the pose across it and
leave it open along it. Places along it are then tried one by one: some door frame may decide.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.association import BACKWARD, FORWARD, motion_of
from curvescan.matchers.curvescan.config import PARALLEL, QUICK_SIGMAS
from curvescan.matchers.curvescan.features.range_image import RangeImage, bearing
from curvescan.matchers.curvescan.features.surfels import CX, CY, NX, NY
from curvescan.matchers.curvescan.normal_equations import N_SUMS, XX, XY, YY
from curvescan.matchers.curvescan.refinement import TURN_SIGMA, accumulate
from curvescan.se2.uncertain import wrap_angle
from curvescan.types import Floats

_RIGHT_ANGLES = 4  # directions a right angle apart are one axis

# Metres by which a residual may be wrong after a quick refinement, when the degenerate direction is looked for.
_SIGMA = QUICK_SIGMAS[-1]


@kernel
def rotation_hypotheses(histogram_ref: Floats, histogram_cur: Floats, n_rotations: int, around: Floats) -> Floats:
    """Return (k, 3) the pose `around`, and its place with the rotations at which the histograms correlate best."""
    n = histogram_ref.size
    likeness, twice = np.zeros(n), np.empty(2 * n)
    for k in range(n):
        twice[k] = twice[k + n] = histogram_ref[k]
    for k in range(n):
        length = histogram_cur[k]
        for shift in range(n):  # the inner loop, as the compiler then turns it into vector instructions
            likeness[shift] += length * twice[k + shift]
    poses = np.empty((n_rotations + 1, 3))
    for k in range(3):
        poses[0, k] = around[k]
    count = 1
    taken = np.zeros(n, dtype=np.bool_)
    while count <= n_rotations:
        best = -1
        for k in range(n):
            if taken[k] or likeness[k] < likeness[k - 1] or likeness[k] < likeness[(k + 1) % n]:
                continue
            if best < 0 or likeness[k] > likeness[best]:
                best = k
        if best < 0:
            break
        taken[best] = True
        left, right = likeness[best - 1], likeness[(best + 1) % n]
        curve = left - 2.0 * likeness[best] + right
        offset = 0.5 * (left - right) / curve if curve < 0.0 else 0.0
        theta = (best + offset) * 2.0 * math.pi / n
        poses[count, 0], poses[count, 1] = around[0], around[1]
        poses[count, 2] = wrap_angle(theta)
        count += 1
    return poses[:count]


@kernel
def dominant_axis(surfels: Floats) -> float:
    """Return the direction of most surfaces, right angles counted as one, radians."""
    x, y = 0.0, 0.0
    for i in range(surfels.shape[0]):
        angle = _RIGHT_ANGLES * bearing(surfels[i, NX], surfels[i, NY])
        x += math.cos(angle)
        y += math.sin(angle)
    return bearing(x, y) / _RIGHT_ANGLES


@kernel
def wall_offsets(
    ref: Floats, cur: Floats, pose: Floats, axis: float, reach: float, bin_width: float, n_peaks: int
) -> Floats:
    """Return (k,) how far to move a pose along an axis for walls across it to coincide, the most coinciding first.

    Each pair of walls of both scans that face alike votes for the distance between them (the projections of Weiss and
    von Puttkamer 1995, from a few surfels); 0 where none does.
    """
    half = int(reach / bin_width + 0.5)
    votes = np.zeros(2 * half + 3)
    c, s = math.cos(pose[2]), math.sin(pose[2])
    ux, uy = math.cos(axis), math.sin(axis)
    for i in range(cur.shape[0]):
        facing = ux * (c * cur[i, NX] - s * cur[i, NY]) + uy * (s * cur[i, NX] + c * cur[i, NY])
        if abs(facing) < PARALLEL:
            continue
        qx = c * cur[i, CX] - s * cur[i, CY] + pose[0]
        qy = s * cur[i, CX] + c * cur[i, CY] + pose[1]
        for j in range(ref.shape[0]):
            other = ux * ref[j, NX] + uy * ref[j, NY]
            if other * facing <= 0.0 or abs(other) < PARALLEL:
                continue
            apart = (ref[j, NX] * (ref[j, CX] - qx) + ref[j, NY] * (ref[j, CY] - qy)) / other
            k = math.floor(apart / bin_width + 0.5) + half + 1
            if 1 <= k <= 2 * half + 1:
                votes[k] += 1.0
    offsets = np.zeros(n_peaks)
    count = 0
    while count < n_peaks:
        best, most = 0, 0.0
        for k in range(1, 2 * half + 2):
            total = votes[k - 1] + 2.0 * votes[k] + votes[k + 1]
            if total > most:
                best, most = k, total
        if best == 0:
            break
        offsets[count] = (best - half - 1) * bin_width
        count += 1
        for k in range(max(best - 2, 0), min(best + 3, votes.size)):
            votes[k] = 0.0
    return offsets[: max(count, 1)]


@kernel
def aligned_translations(
    poses: Floats, ref: Floats, cur: Floats, reach: float, bin_width: float, n_peaks: int
) -> Floats:
    """Return each pose moved to where walls of both scans coincide, n_peaks places a axis at most.

    It is moved by `reach` metres along each axis at most; walls coincide within bins of `bin_width` metres.
    """
    moved = np.empty((poses.shape[0] * n_peaks * n_peaks, 3))
    count = 0
    axis = dominant_axis(ref)
    for h in range(poses.shape[0]):
        pose = poses[h]
        first = wall_offsets(ref, cur, pose, axis, reach, bin_width, n_peaks)
        second = wall_offsets(ref, cur, pose, axis + 0.5 * math.pi, reach, bin_width, n_peaks)
        for a in first:
            for b in second:
                moved[count, 0] = pose[0] + a * math.cos(axis) - b * math.sin(axis)
                moved[count, 1] = pose[1] + a * math.sin(axis) + b * math.cos(axis)
                moved[count, 2] = pose[2]
                count += 1
    return moved[:count]


@kernel
def degenerate_hypotheses(
    poses: Floats, ref: RangeImage, cur: RangeImage, step: float, n_steps: int, max_ratio: float
) -> Floats:
    """Return poses along the way that the scans leave open at the given poses; none where they fix both axes."""
    n_each = 2 * n_steps
    moved_along = np.empty((poses.shape[0] * n_each, 3))
    count = 0
    system = np.empty(N_SUMS)
    placed = np.empty((3, max(ref.samples.shape[0], cur.samples.shape[0])))
    for h in range(poses.shape[0]):
        pose = poses[h]
        system[:] = 0.0
        accumulate(cur.samples, ref, motion_of(pose, FORWARD), _SIGMA, TURN_SIGMA * _SIGMA, placed, system)
        accumulate(ref.samples, cur, motion_of(pose, BACKWARD), _SIGMA, TURN_SIGMA * _SIGMA, placed, system)
        half = 0.5 * (system[XX] - system[YY])
        root = math.sqrt(half * half + system[XY] * system[XY])
        mean = 0.5 * (system[XX] + system[YY])
        if mean - root > max_ratio * (mean + root):
            continue
        # the direction of least information is at right angles to that of the most
        angle = 0.5 * math.atan2(system[XY], half) + 0.5 * math.pi
        ux, uy = math.cos(angle), math.sin(angle)
        for k in range(n_each):
            offset = step * (k - n_steps if k < n_steps else k - n_steps + 1)
            moved_along[count, 0] = pose[0] + offset * ux
            moved_along[count, 1] = pose[1] + offset * uy
            moved_along[count, 2] = pose[2]
            count += 1
    return moved_along[:count]
