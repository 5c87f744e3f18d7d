"""How two poses differ: by how much, and whether one lies on the way that the scans leave open at the other."""

from __future__ import annotations

import math

from curvescan._jit import kernel
from curvescan.matchers.curvescan.config import SAME
from curvescan.types import Pose

# Turn for each metre, radians, below which a motion is a line: its arc leaves the line by 2 cm in 0.6 m.
_STRAIGHT = SAME


@kernel
def difference(pose: Pose, origin: Pose) -> tuple[float, float, float]:
    """Return x, y and theta of a pose less those of another, metres, metres and radians in [-pi, pi]."""
    turn = pose[2] - origin[2]
    return pose[0] - origin[0], pose[1] - origin[1], turn - 2.0 * math.pi * round(turn / (2.0 * math.pi))


@kernel
def distance(a: Pose, b: Pose) -> float:
    """Return how far apart two poses are: metres, or radians times 2 m, whichever is more."""
    x, y, theta = difference(a, b)
    return max(math.hypot(x, y), 2.0 * abs(theta))


def is_along(direction: Pose, pose: Pose, other: Pose, tolerance: float) -> bool:
    """Return whether a motion that starts in a (3,) direction and keeps to it passes another pose."""
    x, y, theta = difference(other, pose)
    dx, dy, turn = direction.tolist()
    length = math.hypot(dx, dy)
    if abs(turn) < _STRAIGHT * length:
        return bool(max(abs(dx * y - dy * x) / length, abs(theta)) < tolerance)
    # the sensor circles around this place, seen from the pose
    cx, cy = -dy / turn, dx / turn
    c, s = math.cos(theta), math.sin(theta)
    missed = math.hypot(x - (cx - c * cx + s * cy), y - (cy - s * cx - c * cy))
    return bool(missed < tolerance * (1.0 + abs(theta)))
