"""Verification: how well two scans agree at a pose, each seen in the other's polar frame.

A reading agrees when it lies near the line through the reading that the other sensor has in its direction,
and both surfaces face alike. It contradicts when it lies in front: there the other sensor saw through. What lies
behind is hidden and says nothing.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.consensus.polar import reading_at
from curvescan.types import Floats, Ints


@kernel
def support(
    surfels_a: Floats,
    probes_a: Ints,
    surfels_b: Floats,
    fan_b: Floats,
    lookup_b: Ints,
    x: float,
    y: float,
    theta: float,
    tolerance: float,
    tolerance_slope: float,
) -> float:
    """Return the agreements less the contradictions of probes of scan a in scan b, at the pose of a in b."""
    c, s = math.cos(theta), math.sin(theta)
    score = 0.0
    for k in range(probes_a.size):
        i = probes_a[k]
        ax, ay = surfels_a[i, 0], surfels_a[i, 1]
        qx, qy = c * ax - s * ay + x, s * ax + c * ay + y
        j = reading_at(qx, qy, fan_b, lookup_b)
        if j < 0:
            continue
        rho = math.sqrt(qx * qx + qy * qy)
        limit = tolerance + tolerance_slope * rho
        ux, uy = qx - surfels_b[j, 3], qy - surfels_b[j, 4]
        across = surfels_b[j, 5] * ux + surfels_b[j, 6] * uy
        apart2 = ux * ux + uy * uy
        if abs(across) < limit and apart2 < 9.0 * limit * limit:
            nx = c * surfels_a[i, 5] - s * surfels_a[i, 6]
            ny = s * surfels_a[i, 5] + c * surfels_a[i, 6]
            alike = nx * surfels_b[j, 5] + ny * surfels_b[j, 6]
            if alike > 0.0:
                ratio = across / limit
                score += (1.0 - ratio * ratio) * alike
                continue
        if rho < surfels_b[j, 2] - 2.0 * limit:
            score -= 0.5
    return score


@kernel
def verify(
    poses: Floats,
    surfels_ref: Floats,
    probes_ref: Ints,
    fan_ref: Floats,
    lookup_ref: Ints,
    surfels_cur: Floats,
    probes_cur: Ints,
    fan_cur: Floats,
    lookup_cur: Ints,
    tolerance: float,
    tolerance_slope: float,
) -> Floats:
    """Return (h,) the score of each pose of the current scan in the reference, both ways round, at most 1."""
    n = poses.shape[0]
    scores = np.empty(n)
    for h in range(n):
        x, y, theta = poses[h, 0], poses[h, 1], poses[h, 2]
        c, s = math.cos(theta), math.sin(theta)
        there = support(
            surfels_cur, probes_cur, surfels_ref, fan_ref, lookup_ref,
            x, y, theta, tolerance, tolerance_slope,
        )
        back = support(
            surfels_ref, probes_ref, surfels_cur, fan_cur, lookup_cur,
            -c * x - s * y, s * x - c * y, -theta, tolerance, tolerance_slope,
        )
        scores[h] = (there + back) / max(probes_cur.size + probes_ref.size, 1)
    return scores
