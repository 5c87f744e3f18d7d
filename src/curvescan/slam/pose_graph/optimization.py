"""Least squares over a pose graph: Gauss-Newton on the sparse normal equations.

Grisetti, Kümmerle, Stachniss and Burgard, "A tutorial on graph-based SLAM", 2010. The error of an edge is taken where
the matcher's covariance lives, in the frame of its first pose: e = [R_i^T (t_j - t_i) - t_ij; theta_j - theta_i -
theta_ij].
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import numpy as np

from curvescan import se2
from curvescan._jit import kernel
from curvescan.se2.uncertain import wrap_angle
from curvescan.types import Cov, Floats, Ints, Pose

_SHORT = 0.1
"""Metres and radians: after a step no longer than this the information matrix is still the same, and its factorization
is used again."""


class Edges(NamedTuple):
    """The edges of a problem."""

    ends: Ints  # (m, 2): poses i and j of each
    measured: Pose  # (m, 3): measured pose of j in the frame of i
    information: Cov  # (m, 3, 3): inverse covariance of the measured pose

    @classmethod
    def of(cls, ends: Ints, measured: Pose, covariances: Cov) -> Edges:
        """Return edges from covariances, each positive definite."""
        return cls(ends, measured, np.linalg.inv(covariances).astype(np.float64))

    def chosen(self, rows: Ints) -> Edges:
        """Return some of the edges."""
        return Edges(self.ends[rows], self.measured[rows], self.information[rows])


def optimize(
    poses: Pose, edges: Edges, weights: Floats, anchors: Ints, *, max_iterations: int = 20, tolerance: float = 1e-5
) -> Pose:
    """Return the (n, 3) poses that the edges agree on best; weights (m,); anchors (k,)."""
    order = elimination_order(edges.ends, len(poses))
    rank = np.argsort(order)
    edges, anchors, poses = edges._replace(ends=rank[edges.ends]), rank[anchors], poses[order]
    longest = np.inf
    for _ in range(max_iterations):
        jacobians, gradient, _ = linearized(poses, *edges, weights)
        gradient[anchors] = 0.0
        if longest > _SHORT:
            solver = factorized(_normal_matrix(jacobians, edges, weights, anchors, len(poses)), order="NATURAL")
        step = solver.solve(-gradient.ravel()).reshape(-1, 3)
        poses = poses + step
        longest = np.abs(step).max(initial=0.0)
        if not longest > tolerance:
            break
    poses[:, 2] = se2.wrap(poses[:, 2])
    return poses[rank]


def information_matrix(poses: Pose, edges: Edges, weights: Floats, anchors: Ints) -> Any:
    """Return the information matrix at the poses, J^T W J, (3n, 3n) in CSC.

    Poses that are anchored stand for themselves: their rows and columns are those of the identity.
    """
    return _normal_matrix(linearized(poses, *edges, weights)[0], edges, weights, anchors, len(poses))


def squared_distances(poses: Pose, edges: Edges) -> Floats:
    """Return (m,) squared Mahalanobis distances of the edges at the poses."""
    return linearized(poses, *edges, np.ones(len(edges.ends)))[2]


def _normal_matrix(jacobians: Floats, edges: Edges, weights: Floats, anchors: Ints, n: int) -> Any:
    from scipy.sparse import bsr_array  # loads for a good part of a second

    m, k = len(edges.ends), len(anchors)
    jacobians[np.isin(edges.ends, anchors)] = 0.0
    weighted = (weights[:, np.newaxis, np.newaxis] * edges.information)[:, np.newaxis] @ jacobians
    # two blocks a row, those of the poses that an edge joins; one for each anchor
    where = np.append(edges.ends, anchors), np.append(2 * np.arange(m), 2 * m + np.arange(k + 1))
    held = np.tile(np.eye(3), (k, 1, 1))
    jac, half = (
        bsr_array((np.concatenate((blocks.reshape(-1, 3, 3), held)), *where), shape=(3 * (m + k), 3 * n))
        for blocks in (jacobians, weighted)
    )
    return (half.T @ jac).tocsr().T  # a transposed CSR is a CSC


@kernel
def linearized(
    poses: Pose, ends: Ints, measured: Pose, information: Cov, weights: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return (m, 2, 3, 3) derivatives J of errors by poses i and j, (n, 3) gradient J^T W e, (m,) squared distances."""
    m = len(ends)
    jacobians, gradient, distances = np.zeros((m, 2, 3, 3)), np.zeros((len(poses), 3)), np.zeros(m)
    error = np.empty(3)
    for k in range(m):
        i, j = ends[k, 0], ends[k, 1]
        c, s = math.cos(poses[i, 2]), math.sin(poses[i, 2])
        dx, dy = poses[j, 0] - poses[i, 0], poses[j, 1] - poses[i, 1]
        x, y = c * dx + s * dy, c * dy - s * dx
        error[0], error[1] = x - measured[k, 0], y - measured[k, 1]
        error[2] = wrap_angle(poses[j, 2] - poses[i, 2] - measured[k, 2])
        by_i, by_j = jacobians[k, 0], jacobians[k, 1]
        by_j[0, 0], by_j[0, 1], by_j[1, 0], by_j[1, 1], by_j[2, 2] = c, s, -s, c, 1.0
        by_i[0, 0], by_i[0, 1], by_i[1, 0], by_i[1, 1], by_i[2, 2] = -c, -s, s, -c, -1.0
        by_i[0, 2], by_i[1, 2] = y, -x
        for row in range(3):
            pull = 0.0
            for q in range(3):
                pull += information[k, row, q] * error[q]
            distances[k] += error[row] * pull
            for q in range(3):
                gradient[i, q] += weights[k] * pull * by_i[row, q]
                gradient[j, q] += weights[k] * pull * by_j[row, q]
    return jacobians, gradient, distances


def elimination_order(ends: Ints, n_poses: int) -> Ints:
    """Return (n_poses,) poses in an order in which the normal equations of edges fill in little: minimum degree."""
    from scipy.sparse import coo_array, eye_array

    i, j = ends.T
    links = coo_array((np.ones(2 * len(i)), (np.concatenate((i, j)), np.concatenate((j, i)))), shape=(n_poses, n_poses))
    # diagonally dominant, so that it has a factorization
    laplacian = eye_array(n_poses, format="csc") * (2.0 * len(i) + 1.0) - links.tocsc()
    return np.argsort(factorized(laplacian).perm_c).astype(np.int64)


def factorized(matrix: Any, order: str = "MMD_AT_PLUS_A") -> Any:
    """Return SciPy's SuperLU object of a symmetric positive definite matrix, factorized without pivoting."""
    from scipy.sparse.linalg import splu

    return splu(matrix.tocsc(), permc_spec=order, diag_pivot_thresh=0.0, options={"SymmetricMode": True})
