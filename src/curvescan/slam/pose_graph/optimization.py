"""Least squares over a pose graph: Gauss-Newton on the sparse normal equations.

Grisetti, Kümmerle, Stachniss and Burgard, "A tutorial on graph-based SLAM", 2010. The error of an edge is taken where
the matcher's covariance lives, in the frame of its first pose: e = [R_i^T (t_j - t_i) - t_ij; theta_j - theta_i -
theta_ij].
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from curvescan import se2
from curvescan.types import Cov, Floats, Ints, Pose


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
    for _ in range(max_iterations):
        matrix, gradient = normal_equations(poses, edges, weights, anchors)
        step = factorized(matrix, order="NATURAL").solve(-gradient).reshape(-1, 3)
        poses = poses + step
        if not np.abs(step).max(initial=0.0) > tolerance:
            break
    poses[:, 2] = se2.wrap(poses[:, 2])
    return poses[rank]


def normal_equations(poses: Pose, edges: Edges, weights: Floats, anchors: Ints) -> tuple[Any, Floats]:
    """Return the information matrix at the poses in CSC, J^T W J, and the gradient J^T W e, (3n,).

    Poses that are anchored stand for themselves: their rows and columns are those of the identity.
    """
    from scipy.sparse import bsr_array, diags_array  # load for a good part of a second

    n, m = len(poses), len(edges.ends)
    seen, error = _errors(poses, edges)
    is_held = np.zeros(n, dtype=np.bool_)
    is_held[anchors] = True
    jacobians = _jacobians(poses[edges.ends[:, 0], 2], seen)
    jacobians[is_held[edges.ends]] = 0.0
    weighted = weights[:, np.newaxis, np.newaxis] * edges.information
    pull = np.einsum("mij,mj->mi", weighted, error)
    # two blocks a row: those of the poses that an edge joins
    where = edges.ends.ravel(), 2 * np.arange(m + 1)
    jac, half = (
        bsr_array((blocks.reshape(-1, 3, 3), *where), shape=(3 * m, 3 * n))
        for blocks in (jacobians, weighted[:, np.newaxis] @ jacobians)
    )
    held = diags_array(np.repeat(is_held.astype(np.float64), 3)).tocsc()
    matrix = (half.T @ jac).tocsr().T + held  # a transposed CSR is a CSC
    return matrix, jac.T @ pull.ravel()


def squared_distances(poses: Pose, edges: Edges) -> Floats:
    """Return (m,) squared Mahalanobis distances of the edges at the poses."""
    _, error = _errors(poses, edges)
    return np.asarray(np.einsum("mi,mij,mj->m", error, edges.information, error))


def _errors(poses: Pose, edges: Edges) -> tuple[Pose, Floats]:
    """Return (m, 3) where edges have pose j in the frame of i, and by how much that is not what was measured."""
    i, j = edges.ends.T
    seen = se2.between(poses[i], poses[j])
    error = seen - edges.measured
    error[:, 2] = se2.wrap(error[:, 2])
    return seen, error


def _jacobians(headings: Floats, seen: Pose) -> Floats:
    """Return (m, 2, 3, 3) derivatives of the errors by poses i, of headings (m,), and j."""
    found = np.zeros((len(seen), 2, 3, 3))
    by_i, by_j = found[:, 0], found[:, 1]
    c, s = np.cos(headings), np.sin(headings)
    by_j[:, 0, 0], by_j[:, 0, 1], by_j[:, 1, 0], by_j[:, 1, 1] = c, s, -s, c
    by_i[:, :2, :2] = -by_j[:, :2, :2]
    by_i[:, 0, 2], by_i[:, 1, 2] = seen[:, 1], -seen[:, 0]
    by_i[:, 2, 2], by_j[:, 2, 2] = -1.0, 1.0
    return found


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
