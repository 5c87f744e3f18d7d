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
        if longest > _SHORT:
            solver = factorized(information_matrix(poses, edges, weights, anchors), order="NATURAL")
        step = solver.solve(-gradient(poses, edges, weights, anchors)).reshape(-1, 3)
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
    from scipy.sparse import bsr_array, diags_array  # load for a good part of a second

    n, m = len(poses), len(edges.ends)
    seen, _ = _errors(poses, edges)
    is_held = np.zeros(n, dtype=np.bool_)
    is_held[anchors] = True
    jacobians = _jacobians(poses[edges.ends[:, 0], 2], seen)
    jacobians[is_held[edges.ends]] = 0.0
    weighted = weights[:, np.newaxis, np.newaxis] * edges.information
    # two blocks a row: those of the poses that an edge joins
    where = edges.ends.ravel(), 2 * np.arange(m + 1)
    jac, half = (
        bsr_array((blocks.reshape(-1, 3, 3), *where), shape=(3 * m, 3 * n))
        for blocks in (jacobians, weighted[:, np.newaxis] @ jacobians)
    )
    held = diags_array(np.repeat(is_held.astype(np.float64), 3)).tocsc()
    return (half.T @ jac).tocsr().T + held  # a transposed CSR is a CSC


def gradient(poses: Pose, edges: Edges, weights: Floats, anchors: Ints) -> Floats:
    """Return the gradient at the poses, J^T W e, (3n,); zero at the anchors."""
    seen, error = _errors(poses, edges)
    pull = weights[:, np.newaxis] * np.einsum("mij,mj->mi", edges.information, error)
    at_ends = np.einsum("mkij,mi->mkj", _jacobians(poses[edges.ends[:, 0], 2], seen), pull).reshape(-1, 3)
    ends = edges.ends.ravel()
    found = np.empty((len(poses), 3))
    for k in range(3):
        found[:, k] = np.bincount(ends, at_ends[:, k], len(poses))
    found[anchors] = 0.0
    return found.ravel()


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
