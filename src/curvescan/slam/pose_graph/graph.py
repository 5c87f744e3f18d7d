"""PoseGraph: keyframe poses and the measured poses between them.

The graph only stores. Rows are appended, and arrays grow by half, so that adding stays cheap; :mod:`optimization` moves
the poses and weighs the edges.
"""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np

from curvescan.errors import InvalidArgumentError
from curvescan.types import Bools, Cov, Floats, Ints, Pose


class EdgeKind(IntEnum):
    """Where an edge comes from."""

    MATCH = 0
    """A step: a match of keyframes that follow each other."""
    MOTION = 1
    """A step by the odometry, alone or along what the match leaves open."""
    CLOSURE = 3
    """A loop closure: a match of keyframes that do not follow each other."""


_MOST_SPREAD = 1.0
"""Greatest trace of the covariance of an edge that leaves nothing open, square metres and radians."""


def is_whole(covariance: Cov) -> bool:
    """Return whether the (3, 3) covariance of an edge leaves no direction open."""
    return bool(np.trace(covariance) < _MOST_SPREAD)


class PoseGraph:
    """Poses (nodes) and measured relative poses (edges), growing.

    Attributes
    ----------
    n_poses, n_edges : int
        How many there are.
    """

    def __init__(self) -> None:
        self.n_poses = 0
        self.n_edges = 0
        self._poses: Floats = np.empty((16, 3))
        self._ends: Ints = np.empty((16, 2), dtype=np.int64)
        self._measured: Floats = np.empty((16, 3))
        self._covariances: Floats = np.empty((16, 3, 3))
        self._kinds: Ints = np.empty(16, dtype=np.int64)
        self._weights: Floats = np.empty(16)

    @property
    def poses(self) -> Pose:
        """(n_poses, 3) float64, a view: [x, y, theta] of each keyframe in the map; metres, metres, radians."""
        return self._poses[: self.n_poses]

    @property
    def ends(self) -> Ints:
        """(n_edges, 2) int64, a view: nodes i and j of each edge."""
        return self._ends[: self.n_edges]

    @property
    def measured(self) -> Pose:
        """(n_edges, 3) float64, a view: measured pose of j in the frame of i."""
        return self._measured[: self.n_edges]

    @property
    def covariances(self) -> Cov:
        """(n_edges, 3, 3) float64, a view: covariance of each measured pose, in the frame of i."""
        return self._covariances[: self.n_edges]

    @property
    def kinds(self) -> Ints:
        """(n_edges,) int64, a view: an EdgeKind each."""
        return self._kinds[: self.n_edges]

    @property
    def weights(self) -> Floats:
        """(n_edges,) float64 in [0, 1], a view: how far the optimizer follows each edge."""
        return self._weights[: self.n_edges]

    @property
    def is_step(self) -> Bools:
        """(n_edges,) whether each edge leads to the next keyframe."""
        return np.asarray(self.kinds != EdgeKind.CLOSURE)

    @property
    def is_closure(self) -> Bools:
        """(n_edges,) whether each edge is a loop closure."""
        return np.asarray(self.kinds == EdgeKind.CLOSURE)

    def add_pose(self, pose: Pose) -> int:
        """Append a pose and return its number."""
        if self.n_poses == len(self._poses):
            self._poses = _grown(self._poses)
        self._poses[self.n_poses] = pose
        self.n_poses += 1
        return self.n_poses - 1

    def keep_poses(self, is_kept: Bools) -> None:
        """Remove poses; the others keep their order. The caller counts the ends of the edges anew."""
        rows = np.flatnonzero(is_kept)
        self._poses[: len(rows)] = self._poses[: self.n_poses][rows]
        self.n_poses = len(rows)

    def keep_edges(self, is_kept: Bools) -> None:
        """Remove the edges that are not kept; the others keep their order."""
        rows = np.flatnonzero(is_kept)
        for column in (self._ends, self._measured, self._covariances, self._kinds, self._weights):
            column[: len(rows)] = column[: self.n_edges][rows]
        self.n_edges = len(rows)

    def add_edge(self, i: int, j: int, pose: Pose, covariance: Cov, kind: EdgeKind, weight: float = 1.0) -> int:
        """Append an edge and return its number.

        pose (3,); covariance (3, 3).
        """
        if i == j or not (0 <= i < self.n_poses and 0 <= j < self.n_poses):
            raise InvalidArgumentError(f"an edge joins two poses of the graph's {self.n_poses}, got {i} and {j}")
        k = self.n_edges
        if k == len(self._ends):
            self._ends = _grown(self._ends)
            self._measured = _grown(self._measured)
            self._covariances = _grown(self._covariances)
            self._kinds = _grown(self._kinds)
            self._weights = _grown(self._weights)
        self._ends[k] = i, j
        self._measured[k] = pose
        self._covariances[k] = covariance
        self._kinds[k] = kind
        self._weights[k] = weight
        self.n_edges += 1
        return k


def _grown(rows: Any) -> Any:
    more = np.empty((len(rows) + len(rows) // 2, *rows.shape[1:]), dtype=rows.dtype)
    more[: len(rows)] = rows
    return more
