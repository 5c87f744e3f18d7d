"""CF-SMA3, first half: the pose that brings matched points together, in closed form (section 2.3, eqs. 10-12).

Lingemann, Nüchter, Hertzberg, Surmann, "High-speed laser localization for mobile robots", Robotics and
Autonomous Systems 51 (2005): the rotation from the centred cross and dot products, then the translation.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from curvescan._jit import kernel
from curvescan.types import Points, Pose

COINCIDENT = 1e-6
"""Spread, metres, under which matched points are one point and fix no rotation."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Alignment:
    """Closed-form minimum of eq. 10."""

    pose: Pose  # (3,): pose of cur in ref [x, y, theta]: metres, metres, radians in (-pi, pi]
    error: float  # E_min, square metres
    spread: float  # root mean square distance of the points of cur from their centre, metres

    @property
    def fixes_rotation(self) -> bool:
        """Whether the points lie apart, so that they determine a rotation."""
        return self.spread > COINCIDENT


def align(points_ref: Points, points_cur: Points) -> Alignment:
    """Return the pose of cur in ref that minimises the squared distances of matched points (eqs. 10-12).

    points_ref, points_cur (n, 2).
    """
    x, y, theta, error, spread = _align(points_ref, points_cur)
    return Alignment(pose=np.array([x, y, theta]), error=error, spread=spread)


@kernel
def _align(ref: Points, cur: Points) -> tuple[float, float, float, float, float]:
    """Return x, y, theta, E_min and the spread of cur."""
    n = ref.shape[0]
    centre_ref_x = centre_ref_y = centre_cur_x = centre_cur_y = 0.0
    for i in range(n):
        centre_ref_x += ref[i, 0]
        centre_ref_y += ref[i, 1]
        centre_cur_x += cur[i, 0]
        centre_cur_y += cur[i, 1]
    centre_ref_x /= n
    centre_ref_y /= n
    centre_cur_x /= n
    centre_cur_y /= n
    cross = dot = square = 0.0
    for i in range(n):
        ref_x, ref_y = ref[i, 0] - centre_ref_x, ref[i, 1] - centre_ref_y
        cur_x, cur_y = cur[i, 0] - centre_cur_x, cur[i, 1] - centre_cur_y
        cross += cur_x * ref_y - cur_y * ref_x
        dot += cur_x * ref_x + cur_y * ref_y
        square += cur_x * cur_x + cur_y * cur_y
    theta = math.atan2(cross, dot)
    c, s = math.cos(theta), math.sin(theta)
    x = centre_ref_x - (c * centre_cur_x - s * centre_cur_y)
    y = centre_ref_y - (s * centre_cur_x + c * centre_cur_y)
    error = 0.0
    for i in range(n):
        # from the points themselves: the difference of two large sums would lose a small error
        error += (ref[i, 0] - (c * cur[i, 0] - s * cur[i, 1] + x)) ** 2
        error += (ref[i, 1] - (s * cur[i, 0] + c * cur[i, 1] + y)) ** 2
    return x, y, theta, error, math.sqrt(square / n)
