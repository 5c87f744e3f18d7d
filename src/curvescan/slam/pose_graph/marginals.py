"""Marginal covariances of a pose graph: how well each pose is known, and how well two are known to each other.

The joint covariance is the inverse of the information matrix, and dense. Of it are needed the diagonal blocks, which
the recursion of Takahashi, Fagan and Chen (1973) takes from the factorization without ever forming the rest.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from curvescan import se2
from curvescan._jit import kernel
from curvescan.slam.pose_graph.optimization import factorized
from curvescan.types import Cov, Floats, Ints, Pose


def marginal_covariances(information: Any, anchors: Ints) -> Cov:
    """Return (n, 3, 3) covariance of each pose with the anchors, (k,), known exactly, by the information matrix in CSC.

    Anchored at the pose in question, these are the covariances of all others seen from it, with no cancellation of
    large numbers: what a chain of keyframes has in common is not in them.
    """
    lu = factorized(information)
    lower = lu.L.tocsc()
    lower.sort_indices()
    # L U = A with U = D L^T: the matrix is symmetric and was not pivoted
    order = lu.perm_c.astype(np.int64)
    indptr, indices, values = closed_factor(lower, information, order)
    blocks = inverse_blocks(indptr, indices, values, lu.U.diagonal(), order)
    blocks[anchors] = 0.0
    return blocks


def seen_from(poses: Pose, covariances: Cov, k: int) -> tuple[Pose, Cov]:
    """Return pose k seen from each pose, (n, 3) and (n, 3, 3), from covariances that take pose k as known exactly."""
    relative = se2.between(poses, poses[k])
    # by the pose that sees: d/dx_i of R_i^T (t_k - t_i)
    c, s = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    jac = np.zeros((len(poses), 3, 3))
    jac[:, 0, 0], jac[:, 0, 1], jac[:, 0, 2] = -c, -s, relative[:, 1]
    jac[:, 1, 0], jac[:, 1, 1], jac[:, 1, 2] = s, -c, -relative[:, 0]
    jac[:, 2, 2] = -1.0
    return relative, jac @ covariances @ jac.transpose(0, 2, 1).copy()


def closed_factor(lower: Any, matrix: Any, order: Ints) -> tuple[Ints, Ints, Floats]:
    """Return L in CSC with the entries that are zero by chance, which SciPy drops and the recursion needs.

    lower: L as SciPy has it, CSC, sorted; matrix: A; order (3n,): row of the factorization of each row of A.
    """
    where = matrix.indptr.astype(np.int64), matrix.indices.astype(np.int64), order, np.argsort(order)
    n_below, nothing = np.zeros(len(order) + 1, dtype=np.int64), np.empty(0, dtype=np.int64)
    fill_columns(*where, n_below[1:], nothing)
    indptr = np.cumsum(n_below)
    indices = np.empty(indptr[-1], dtype=np.int64)
    fill_columns(*where, indptr[:-1].copy(), indices)
    values = scattered(lower.indptr.astype(np.int64), lower.indices.astype(np.int64), lower.data, indptr, indices)
    return indptr, indices, values


@kernel
def fill_columns(indptr: Ints, indices: Ints, order: Ints, row_of: Ints, end: Ints, found: Ints) -> None:
    """Write the rows of each column of L, sorted, to `found` from `end` on, and move `end`; an empty one only counts.

    indptr, indices: of A, symmetric; order, row_of: row of L of each row of A, and back. Row i of L has the columns of
    row i of A and, of each, the first row below its diagonal as far as i (Davis, Algorithm 849, 2005).
    """
    size = len(order)
    parent, mark = np.full(size, size, dtype=np.int64), np.full(size, size, dtype=np.int64)
    for i in range(size):
        row = row_of[i]
        for a in range(indptr[row] - 3, indptr[row + 1]):
            # the 3 by 3 blocks on the diagonal of A stand, too, zeros and all
            column = order[indices[a] if a >= indptr[row] else row - row % 3 + indptr[row] - 1 - a]
            while column <= i and mark[column] != i:
                mark[column] = i
                if len(found):
                    found[end[column]] = i
                end[column] += 1
                if column < i and parent[column] == size:
                    parent[column] = i
                column = parent[column]


@kernel
def scattered(indptr: Ints, indices: Ints, values: Floats, wider_indptr: Ints, wider_indices: Ints) -> Floats:
    """Return the values of a matrix in CSC in a pattern that contains its own, rows sorted in both."""
    found = np.zeros(len(wider_indices))
    for j in range(len(indptr) - 1):
        p = wider_indptr[j]
        for a in range(indptr[j], indptr[j + 1]):
            while wider_indices[p] != indices[a]:
                p += 1
            found[p] = values[a]
    return found


@kernel
def inverse_blocks(indptr: Ints, indices: Ints, lower: Floats, pivots: Floats, order: Ints) -> Cov:
    """Return (n, 3, 3) diagonal blocks of the inverse of A, from its factorization P A P^T = L D L^T.

    L in CSC, rows sorted, with its unit diagonal; pivots (3n,): the diagonal of D; order (3n,): row of the
    factorization of each row of A.
    """
    size = len(pivots)
    z = np.zeros(len(indices))  # the inverse on the pattern of L
    column = np.zeros(size)
    for j in range(size - 1, -1, -1):
        start, stop = indptr[j], indptr[j + 1]
        # row indices below the diagonal; z_ij = -sum_k l_kj z_ik over k in the pattern of column j
        for a in range(start + 1, stop):
            column[indices[a]] = 0.0
        for b in range(start + 1, stop):
            k, weight = indices[b], lower[b]
            # column k holds z_ik for i >= k; those of i < k stand in column i at row k, which the symmetric step takes
            p = indptr[k]
            column[k] -= weight * z[p]
            q = b + 1
            p += 1
            while q < stop and p < indptr[k + 1]:
                if indices[p] == indices[q]:
                    column[indices[q]] -= weight * z[p]
                    column[k] -= lower[q] * z[p]
                    q += 1
                    p += 1
                elif indices[p] < indices[q]:
                    p += 1
                else:
                    q += 1
        on_diagonal = 1.0 / pivots[j]
        for a in range(start + 1, stop):
            z[a] = column[indices[a]]
            on_diagonal -= lower[a] * z[a]
        z[start] = on_diagonal
    n = size // 3
    blocks = np.zeros((n, 3, 3))
    for i in range(n):
        for r in range(3):
            for c in range(r, 3):
                low, high = (min(order[3 * i + r], order[3 * i + c]), max(order[3 * i + r], order[3 * i + c]))
                p = indptr[low]
                while indices[p] != high:
                    p += 1
                blocks[i, r, c] = blocks[i, c, r] = z[p]
    return blocks
