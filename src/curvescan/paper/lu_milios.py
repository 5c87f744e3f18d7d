"""The covariance of Lu and Milios (eqs. 13-18) for a match of any method, as the paper's Tables II to V have it.

The paper gives all four methods this covariance, so that they can be compared. It needs pairs of points; a method that
matches points to lines or to peaks has none, so each matched reading is paired with the nearest matched one.
"""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan.matchers.cfsma.covariance import pose_covariance
from curvescan.matchers.result import Label, MatchResult
from curvescan.scan import LaserScan
from curvescan.types import Cov


def lu_milios_covariance(reference: LaserScan, current: LaserScan, result: MatchResult) -> Cov:
    """Return (3, 3) the covariance of eq. 16 of a match's pose, from the readings it matched."""
    cur = current.points[result.labels_current == Label.MATCHED]
    ref = reference.points[result.labels_reference == Label.MATCHED]
    placed = se2.transform(result.pose, cur)
    squared = np.subtract.outer(placed[:, 0], ref[:, 0]) ** 2
    squared += np.subtract.outer(placed[:, 1], ref[:, 1]) ** 2
    return pose_covariance(cur, result.pose, float(squared.min(axis=1).sum()))
