"""Hypotheses for scenes without corners: turns from the directions of surfaces, and slides along a corridor.

The histogram of the directions of all surfaces turns with the sensor; where those of two scans
correlate is a rotation (Weiss and von Puttkamer 1995). Where walls fix the pose across but not along, as a corridor does,
poses along it are tried one by one: some door frame may tell.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.range_image import RangeImage, bearing
from curvescan.matchers.curvescan.refinement import accumulate
from curvescan.matchers.curvescan.surfels import LENGTH, NX, NY
from curvescan.se2.angles import wrap_angle
from curvescan.types import Floats


@kernel
def direction_histogram(surfels: Floats) -> Floats:
    """Return (120,) the length of surface that faces each direction, smoothed, of unit norm."""
    counts = np.zeros(120)
    for i in range(surfels.shape[0]):
        place = (bearing(surfels[i, NX], surfels[i, NY]) + math.pi) * 120.0 / (2.0 * math.pi)
        k = min(int(place), 119)
        share = place - k
        counts[k] += (1.0 - share) * surfels[i, LENGTH]
        counts[k + 1 if k < 119 else 0] += share * surfels[i, LENGTH]
    smooth = np.empty(120)
    total = 1e-12
    for k in range(120):
        smooth[k] = counts[k - 1] + 2.0 * counts[k] + counts[(k + 1) % 120]
        total += smooth[k] * smooth[k]
    return smooth / math.sqrt(total)


@kernel
def rotation_hypotheses(
    histogram_ref: Floats, histogram_cur: Floats, n_rotations: int, around: Floats
) -> Floats:
    """Return (k, 3) the pose `around`, and its place with the rotations at which the histograms correlate best."""
    n = histogram_ref.size
    likeness = np.zeros(n)
    for shift in range(n):
        total = 0.0
        for k in range(n - shift):
            total += histogram_cur[k] * histogram_ref[k + shift]
        for k in range(n - shift, n):
            total += histogram_cur[k] * histogram_ref[k + shift - n]
        likeness[shift] = total
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
def translation_grid(poses: Floats, step: float, n_steps: int) -> Floats:
    """Return each pose moved to the places of a square lattice around it, out to n_steps a side, centre first."""
    n_side = 2 * n_steps + 1
    moved = np.empty((poses.shape[0] * n_side * n_side, 3))
    count = 0
    for ring in range(n_steps + 1):
        for h in range(poses.shape[0]):
            for i in range(-ring, ring + 1):
                for j in range(-ring, ring + 1):
                    if max(abs(i), abs(j)) != ring:
                        continue
                    moved[count, 0] = poses[h, 0] + step * i
                    moved[count, 1] = poses[h, 1] + step * j
                    moved[count, 2] = poses[h, 2]
                    count += 1
    return moved


@kernel
def degenerate_hypotheses(
    poses: Floats,
    ref: RangeImage,
    cur: RangeImage,
    step: float,
    n_steps: int,
    max_ratio: float,
) -> Floats:
    """Return poses along the way that the scans leave open at the given poses; none where they fix both axes."""
    n_each = 2 * n_steps
    moved_along = np.empty((poses.shape[0] * n_each, 3))
    count = 0
    system = np.empty(9)
    for h in range(poses.shape[0]):
        pose = poses[h]
        system[:] = 0.0
        accumulate(cur.samples, ref, pose, 1.0, 0.02, 0.006, system)
        accumulate(ref.samples, cur, pose, -1.0, 0.02, 0.006, system)
        half = 0.5 * (system[0] - system[3])
        root = math.sqrt(half * half + system[1] * system[1])
        mean = 0.5 * (system[0] + system[3])
        if mean - root > max_ratio * (mean + root):
            continue
        # the direction of least information is at right angles to that of the most
        angle = 0.5 * math.atan2(system[1], half) + 0.5 * math.pi
        ux, uy = math.cos(angle), math.sin(angle)
        for k in range(n_each):
            offset = step * (k - n_steps if k < n_steps else k - n_steps + 1)
            moved_along[count, 0] = pose[0] + offset * ux
            moved_along[count, 1] = pose[1] + offset * uy
            moved_along[count, 2] = pose[2]
            count += 1
    return moved_along[:count]
