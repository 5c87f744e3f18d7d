"""What the graph knows at one time: how its last keyframe lies to each, with covariances.

Made by an optimization and used until the next: keyframes that came since hang on the last one it knew by the odometry
alone.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam.pose_graph.posterior import affines, carried
from curvescan.types import Cov, Pose


class Marginals(NamedTuple):
    """The last of the n keyframes of an optimization as each saw it."""

    relative: Pose  # (n, 3)
    covariances: Cov  # (n, 3, 3)

    @classmethod
    def of(cls, poses: Pose, covariances: Cov) -> Marginals:
        """Return what is known of the last keyframe by (n, 3) poses and (n, 3, 3) covariances, its own zero."""
        relative = se2.between(poses, poses[-1])
        # by the pose that sees: d/dx_i of R_i^T (t_k - t_i)
        jac = -affines(-poses[:, 2], -relative[:, 1], relative[:, 0])
        return cls(relative, carried(covariances, jac))

    @property
    def n(self) -> int:
        """Keyframes that there were."""
        return len(self.relative)

    def last_seen_from(self, i: int) -> UncertainPose:
        """Return the last keyframe seen from another."""
        return UncertainPose(self.relative[i], self.covariances[i])


def composed_covariances(poses: Pose, covariances: Cov, then: UncertainPose) -> Cov:
    """Return (n, 3, 3) covariances of (n, 3) poses composed with one more, or one each, of independent errors."""
    turn, (x, y, _) = affines(poses[:, 2]), then.pose.T
    c, s = turn[:, 0, 0], turn[:, 1, 0]
    by_first = affines(np.zeros(len(poses)), -s * x - c * y, c * x - s * y)
    return carried(covariances, by_first) + carried(then.covariance, turn)
