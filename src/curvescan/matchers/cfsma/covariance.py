"""CF-SMA3, second half: the covariance of the pose (section 2.3, eqs. 13-18).

Lu and Milios, "Robot pose estimation in unknown environments by matching 2D range scans", CVPR 1994.
"""

from typing import cast

import numpy as np

from curvescan import se2
from curvescan.types import Cov, Points, Pose

LEAST_SIGMA = 1e-4
"""Least standard deviation of a matched point, metres: a tenth of what a laser's driver resolves."""


def pose_covariance(points_cur: Points, pose_ref_cur: Pose, error: float) -> Cov:
    """Return the covariance of an aligned pose, C = (M^T M)^-1 sigma^2 (eqs. 13-18).

    Convention: the points of cur are transformed, ref = R m' + T, so a small change of the pose moves the transformed
    point by M_i = [[1, 0, -q_y], [0, 1, q_x]] with q = R m' (eq. 15's signs, derived for pose of cur in ref).

    Departure: eq. 15 linearises at zero rotation. Here q is taken at the rotation found, which is the same for small
    angles and right for large ones.

    Departure: eq. 17 prints N_t - 3. Each pair gives two equations, so 2 N_t - 3 is the divisor without bias; it
    halves the variance.

    Departure: sigma is kept at or above 0.1 mm, so that two identical scans give a covariance that is positive
    definite, as the contract of a match promises.

    points_cur (n, 2); pose_ref_cur (3,); result (3, 3).
    """
    n = points_cur.shape[0]
    turned = points_cur @ se2.rotation(pose_ref_cur[2]).T
    sum_x, sum_y = turned.sum(axis=0)
    information = np.array([[n, 0.0, -sum_y], [0.0, n, sum_x], [-sum_y, sum_x, np.vdot(turned, turned)]])
    variance = max(error / (2 * n - 3), LEAST_SIGMA**2)
    covariance = np.linalg.inv(information) * variance
    return cast(Cov, 0.5 * (covariance + covariance.T))
