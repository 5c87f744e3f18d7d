"""PoseGraph: keyframe poses and the measured poses between them. It only stores; the optimization moves and weighs."""

from __future__ import annotations

from enum import IntEnum
from typing import Any

import numpy as np

from curvescan.errors import InvalidArgumentError
from curvescan.odometry.gaps import LOST_COVARIANCE
from curvescan.slam.pose_graph.rows import Rows
from curvescan.types import Bools, Cov, Floats, Ints, Pose


class EdgeKind(IntEnum):
    """Where an edge comes from."""

    MATCH = 0
    """A step: a match of keyframes that follow each other."""
    MOTION = 1
    """A step by the odometry, alone or along what the match leaves open."""
    CLOSURE = 3
    """A loop closure: a match of keyframes that do not follow each other."""
    BY_HAND = 4
    """A closure put in by hand, or a pinned keyframe: it keeps its weight."""


_MOST_SPREAD = 1.0
"""Greatest trace of the covariance of an edge that leaves nothing open, square metres and radians."""


def is_whole(covariances: Cov) -> Bools:
    """Return whether the (..., 3, 3) covariances of edges leave no direction open."""
    return np.asarray(np.trace(covariances, axis1=-2, axis2=-1) < _MOST_SPREAD)


def is_lost(covariances: Cov) -> Bools:
    """Return whether the (m, 3, 3) covariances of edges are of a step within which the track was lost."""
    return np.asarray((np.diagonal(covariances, axis1=1, axis2=2) >= np.diag(LOST_COVARIANCE)).all(axis=1))


def as_if_tracked(covariances: Cov) -> Cov:
    """Return (m, 3, 3) covariances of edges as if the sensor had gone on where the track was lost."""
    return covariances - is_lost(covariances)[:, np.newaxis, np.newaxis] * LOST_COVARIANCE


_EDGE = np.dtype([
    ("ends", np.int64, 2), ("measured", np.float64, 3), ("covariance", np.float64, (3, 3)),
    ("kind", np.int64), ("weight", np.float64),
])  # fmt: skip

_LEAST_STEP = 1e-4
"""Weight that a step keeps however far it is off: a slip bends the graph, and does not break it."""


class PoseGraph:
    """Poses (nodes) and measured relative poses (edges), growing; all arrays are views."""

    def __init__(self) -> None:
        self._poses, self._edges = Rows((3,)), Rows(dtype=_EDGE)

    @property
    def n_poses(self) -> int:
        """How many poses there are."""
        return len(self._poses)

    @property
    def poses(self) -> Pose:
        """(n_poses, 3): of each keyframe in the map."""
        return self._poses.array

    @property
    def ends(self) -> Ints:
        """(n_edges, 2): poses i and j of each edge."""
        return self._edges.array["ends"]

    @property
    def measured(self) -> Pose:
        """(n_edges, 3): measured pose of j in the frame of i."""
        return self._edges.array["measured"]

    @property
    def edge_covariances(self) -> Cov:
        """(n_edges, 3, 3): of each measured pose, in the frame of i."""
        return self._edges.array["covariance"]

    @property
    def kinds(self) -> Ints:
        """(n_edges,): an EdgeKind each."""
        return self._edges.array["kind"]

    @property
    def weights(self) -> Floats:
        """(n_edges,) in [0, 1]: how far the optimizer follows each edge."""
        return self._edges.array["weight"]

    @property
    def least_weights(self) -> Floats:
        """(n_edges,): weight that each edge keeps: a closure none, a step a little, what was put in by hand all."""
        return np.where(self.is_closure, self.kinds == EdgeKind.BY_HAND, _LEAST_STEP)

    @property
    def is_followed(self) -> Bools:
        """(n_edges,): whether the optimizer follows each edge."""
        return np.asarray(self.weights > 0.5)

    @property
    def is_closure(self) -> Bools:
        """(n_edges,): whether each edge is a loop closure."""
        return np.asarray(self.kinds >= EdgeKind.CLOSURE)

    def add_pose(self, pose: Pose) -> None:
        """Append a pose."""
        self._poses.append(pose)

    def add_edge(self, i: int, j: int, pose: Pose, covariance: Cov, kind: int, weight: float = 1.0) -> None:
        """Append an edge: the measured pose (3,) of j in the frame of i, its covariance (3, 3), and its EdgeKind."""
        if i == j or not (0 <= i < self.n_poses and 0 <= j < self.n_poses):
            raise InvalidArgumentError(f"an edge joins two poses of the graph's {self.n_poses}, got {i} and {j}")
        self._edges.append(((i, j), pose, covariance, kind, weight))

    def keep_poses(self, is_kept: Bools) -> None:
        """Remove poses that no edge ends on; the others keep their order and are counted anew."""
        self.ends[:] = (np.cumsum(is_kept) - 1)[self.ends]
        self._poses.keep(is_kept)

    def keep_edges(self, is_kept: Bools) -> None:
        """Remove edges; the others keep their order."""
        self._edges.keep(is_kept)

    def arrays(self) -> dict[str, Any]:
        """Return copies of the arrays, by the names that they have in a map."""
        names = "poses", "ends", "measured", "edge_covariances", "kinds", "weights"
        return {name: getattr(self, name).copy() for name in names}


def components(ends: Ints, n_poses: int) -> Ints:
    """Return (n_poses,) number of the connected component of each pose by edges (m, 2), the one of pose 0 first."""
    from scipy.sparse import csr_matrix
    from scipy.sparse.csgraph import connected_components

    links = csr_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), shape=(n_poses, n_poses))
    _, labels = connected_components(links, directed=False)
    return np.asarray(labels, dtype=np.int64)
