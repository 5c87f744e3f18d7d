"""CF-SMA3, first half: the pose that brings matched points together, in closed form (section 3, eqs. 10-12).

Lingemann, Nüchter, Hertzberg, Surmann, "High-speed laser localization for mobile robots", Robotics and
Autonomous Systems 51 (2005): the rotation from the centred cross and dot products, then the translation.
"""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan.types import Points, Pose

COINCIDENT = 1e-6
"""Extent, metres, under which matched points are one point and fix no rotation."""


def fixes_rotation(points: Points) -> bool:
    """Return whether (n, 2) points lie apart, so that a rotation can be told from them."""
    return bool(np.ptp(points, axis=0).max() > COINCIDENT)


def align(points_ref: Points, points_cur: Points) -> tuple[Pose, float]:
    """Return the pose of cur in ref that minimises the squared distances, and that minimum (eqs. 10-12).

    Parameters
    ----------
    points_ref, points_cur : (n, 2) float64
        Matched points, row by row, metres, each in its own frame; n >= 2 and not all in one place.

    Returns
    -------
    pose_ref_cur : (3,) float64
        [x, y, theta]; metres, metres, radians in (-pi, pi].
    error : float
        E_min of eq. 10, square metres.
    """
    centre_ref = points_ref.mean(axis=0)
    centre_cur = points_cur.mean(axis=0)
    spread_ref = points_ref - centre_ref
    spread_cur = points_cur - centre_cur
    products = spread_cur.T @ spread_ref
    theta = np.arctan2(products[0, 1] - products[1, 0], products[0, 0] + products[1, 1])
    turn = se2.rotation(theta)
    residuals = spread_ref - spread_cur @ turn.T
    pose = np.empty(3)
    pose[:2] = centre_ref - turn @ centre_cur
    pose[2] = theta
    return pose, float(np.vdot(residuals, residuals))
