"""Rotation hypotheses from the directions of surfaces, and places along a corridor.

The histogram of the directions of all surfaces turns with the sensor. A turn at which the histograms of two scans
correlate is a candidate rotation (Weiss and von Puttkamer 1995). The walls of a corridor fix the pose across it and
leave it open along it. Places along it are then tried one by one: some door frame may decide.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.association import BACKWARD, FORWARD, motion_of
from curvescan.matchers.curvescan.config import QUICK_SIGMAS
from curvescan.matchers.curvescan.features.range_image import RangeImage, bearing
from curvescan.matchers.curvescan.features.surfels import NX, NY
from curvescan.matchers.curvescan.normal_equations import N_SUMS, XX, XY, YY
from curvescan.matchers.curvescan.proposal.correlation import correlate, peaks_of
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
    correlate(likeness, twice, histogram_cur, 0)
    shifts, _ = peaks_of(likeness, n_rotations)
    poses = np.empty((shifts.size + 1, 3))
    for k in range(poses.shape[0]):
        poses[k, 0], poses[k, 1] = around[0], around[1]
        poses[k, 2] = around[2] if k == 0 else wrap_angle(shifts[k - 1] * 2.0 * math.pi / n)
    return poses


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
