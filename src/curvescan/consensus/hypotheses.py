"""Hypotheses: where the current scan may have been taken, from pairs of frames."""

from __future__ import annotations

import math

import numpy as np

from curvescan._jit import kernel
from curvescan.types import Floats


@kernel
def pair_frames(
    keypoints_ref: Floats, keypoints_cur: Floats, turn_tolerances: Floats, max_hypotheses: int
) -> Floats:
    """Return (h, 3) poses of the current scan in the reference, one for each pair of frames of one kind."""
    poses = np.empty((max_hypotheses, 3))
    n = 0
    for i in range(keypoints_cur.shape[0]):
        kind = keypoints_cur[i, 4]
        tolerance = turn_tolerances[int(kind)] if kind < 10.0 else 1.0
        for j in range(keypoints_ref.shape[0]):
            if keypoints_ref[j, 4] != kind or n >= max_hypotheses:
                continue
            if abs(keypoints_ref[j, 3] - keypoints_cur[i, 3]) > tolerance:
                continue
            theta = keypoints_ref[j, 2] - keypoints_cur[i, 2]
            if theta > math.pi:
                theta -= 2.0 * math.pi
            elif theta <= -math.pi:
                theta += 2.0 * math.pi
            c, s = math.cos(theta), math.sin(theta)
            x, y = keypoints_cur[i, 0], keypoints_cur[i, 1]
            poses[n, 0] = keypoints_ref[j, 0] - c * x + s * y
            poses[n, 1] = keypoints_ref[j, 1] - s * x - c * y
            poses[n, 2] = theta
            n += 1
    return poses[:n].copy()
