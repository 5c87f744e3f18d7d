"""What the graph knows at one time: poses, their marginal covariances, and how the newest keyframe lies to each.

Made by an optimization and used until the next: keyframes that came since hang on the last one it knew by the odometry
alone.
"""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam.pose_graph.marginals import seen_from
from curvescan.types import Bools, Cov, Pose

UNKNOWN: Cov = np.diag([1e6, 1e6, 10.0])
"""(3, 3) covariance of a relative pose of which nothing is known."""


class Belief:
    """Poses and covariances as of the last optimization, and the odometry since.

    poses (n, 3); covariances (n, 3, 3).
    """

    def __init__(self, k: int, poses: Pose, covariances: Cov) -> None:
        self.k = k
        self.n = len(poses)
        self._relative, self._covariances = seen_from(poses, covariances, k)

    @classmethod
    def at_start(cls, k: int, poses: Pose) -> Belief:
        """Return what is known of keyframe k, the last one, where nothing ties it to those before it."""
        covariances = np.tile(UNKNOWN, (len(poses), 1, 1))
        covariances[k] = 0.0
        return cls(k, poses, covariances)

    def keep(self, is_kept: Bools) -> None:
        """Forget keyframes; `is_kept` is of those that it knows, the others keep their order."""
        self.k = int(np.count_nonzero(is_kept[: self.k]))
        self.n = int(np.count_nonzero(is_kept))
        self._relative, self._covariances = self._relative[is_kept], self._covariances[is_kept]

    def knows(self, i: int) -> bool:
        """Return whether a keyframe was there."""
        return i < self.n

    def last_seen_from(self, i: int) -> UncertainPose:
        """Return keyframe k seen from another."""
        return UncertainPose(self._relative[i], self._covariances[i])

    def seen_from_all(self, poses: Pose, since: UncertainPose, newest: int) -> tuple[Pose, Cov]:
        """Return (newest, 3) pose of the newest keyframe seen from each before it, and (newest, 3, 3) its covariance.

        poses (newest + 1, 3).
        """
        relative = se2.between(poses[:newest], poses[newest])
        _, known = composed_covariances(self._relative, self._covariances, since)
        covariances = np.empty((newest, 3, 3))
        covariances[: self.n] = known[:newest]
        # of keyframes that came since only the pose of the newest relative to the last known one is needed
        widest = float(max(since.cov[0, 0], since.cov[1, 1]))
        covariances[self.n :] = np.diag([widest, widest, since.cov[2, 2]])
        return relative, covariances


def composed_covariances(poses: Pose, covariances: Cov, then: UncertainPose) -> tuple[Pose, Cov]:
    """Return (n, 3) poses composed with one more, or one each, and (n, 3, 3) covariances of independent parts."""
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y, theta = then.pose.T
    out = np.empty_like(poses)
    out[:, 0] = poses[:, 0] + c * x - s * y
    out[:, 1] = poses[:, 1] + s * x + c * y
    out[:, 2] = np.remainder(poses[:, 2] + theta + np.pi, 2.0 * np.pi) - np.pi
    by_first = np.zeros((len(poses), 3, 3))
    by_first[:, [0, 1, 2], [0, 1, 2]] = 1.0
    by_first[:, 0, 2] = -s * x - c * y
    by_first[:, 1, 2] = c * x - s * y
    turn = np.zeros((len(poses), 3, 3))
    turn[:, 0, 0], turn[:, 0, 1], turn[:, 1, 0], turn[:, 1, 1] = c, -s, s, c
    turn[:, 2, 2] = 1.0
    cov = by_first @ covariances @ by_first.transpose(0, 2, 1)
    cov += turn @ then.cov @ turn.transpose(0, 2, 1)
    return out, cov
