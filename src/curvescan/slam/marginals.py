"""Marginal covariances of a pose graph: how well each pose is known, and how well two are known to each other.

The joint covariance is the inverse of the information matrix, and dense. Of it are needed the diagonal blocks, which the recursion of
Takahashi, Fagan and Chen (1973; Golub and Plemmons 1980) takes from the factorization without ever forming the rest, and a few
columns, which are solved for.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from curvescan._jit import kernel
from curvescan.slam.sparse import BlockPattern, lu_of
from curvescan.types import Cov, Floats, Ints, Pose


class Marginals:
    """Covariances at the optimum of a pose graph, relative to its anchors.

    Parameters
    ----------
    poses : (n, 3) float64
        Poses at which the information matrix was made.
    pattern : BlockPattern
        Where its blocks lie.
    data : (n_entries,) float64
        Its entries; see :func:`optimization.normal_equations`.

    Attributes
    ----------
    poses : (n, 3) float64
        As given.
    diagonal : (n, 3, 3) float64
        Covariance of each pose, x, y, theta.
    """

    def __init__(self, poses: Pose, pattern: BlockPattern, data: Floats) -> None:
        self.poses = poses
        self._lu: Any = lu_of(pattern, data)
        self.diagonal = self._diagonal()

    def __len__(self) -> int:
        return len(self.poses)

    def with_all(self, k: int) -> Cov:
        """Return (n, 3, 3) covariances of every pose with pose k: rows of the one, columns of the other."""
        right = np.zeros((3 * len(self.poses), 3))
        right[3 * k + np.arange(3), np.arange(3)] = 1.0
        column: Floats = self._lu.solve(right)
        return np.ascontiguousarray(column.reshape(-1, 3, 3))

    def between(self, k: int) -> tuple[Pose, Cov]:
        """Return (n, 3) pose of pose k seen from every pose, and (n, 3, 3) its covariance."""
        return relative_poses(self.poses, self.diagonal, self.with_all(k), k)

    def _diagonal(self) -> Cov:
        lu = self._lu
        lower = lu.L.tocsc()
        lower.sort_indices()
        # L U = A with U = D L^T: the matrix is symmetric and was not pivoted
        order = lu.perm_c.astype(np.int64)
        indptr, indices, values = closed_factor(
            lower.indptr.astype(np.int64), lower.indices.astype(np.int64), lower.data, order
        )
        return inverse_blocks(indptr, indices, values, lu.U.diagonal(), order)


def relative_poses(poses: Pose, diagonal: Cov, with_k: Cov, k: int) -> tuple[Pose, Cov]:
    """Return (n, 3) pose of pose k seen from every pose and (n, 3, 3) its covariance, from their joint covariance.

    Parameters
    ----------
    poses : (n, 3) float64
        Poses.
    diagonal : (n, 3, 3) float64
        Covariance of each.
    with_k : (n, 3, 3) float64
        Covariance of each with pose k.
    k : int
        The pose that is seen.
    """
    return _relative(np.ascontiguousarray(poses), diagonal, with_k, k)


@kernel
def _relative(poses: Pose, diagonal: Cov, with_k: Cov, k: int) -> tuple[Pose, Cov]:
    n = len(poses)
    relative, covariances = np.empty((n, 3)), np.empty((n, 3, 3))
    jac = np.zeros((3, 6))
    joint, half = np.empty((6, 6)), np.empty((3, 6))
    jac[2, 2], jac[2, 5] = -1.0, 1.0
    for i in range(n):
        c, s = np.cos(poses[i, 2]), np.sin(poses[i, 2])
        dx, dy = poses[k, 0] - poses[i, 0], poses[k, 1] - poses[i, 1]
        x, y = c * dx + s * dy, -s * dx + c * dy
        angle = poses[k, 2] - poses[i, 2]
        relative[i, 0], relative[i, 1] = x, y
        relative[i, 2] = angle - 2.0 * np.pi * np.floor((angle + np.pi) / (2.0 * np.pi))
        jac[0, 0], jac[0, 1], jac[0, 2], jac[0, 3], jac[0, 4] = -c, -s, y, c, s
        jac[1, 0], jac[1, 1], jac[1, 2], jac[1, 3], jac[1, 4] = s, -c, -x, -s, c
        for r in range(3):
            for q in range(3):
                joint[r, q] = diagonal[i, r, q]
                joint[r, q + 3] = with_k[i, r, q]
                joint[q + 3, r] = with_k[i, r, q]
                joint[r + 3, q + 3] = diagonal[k, r, q]
        for r in range(3):
            for q in range(6):
                half[r, q] = 0.0
                for p in range(6):
                    half[r, q] += jac[r, p] * joint[p, q]
        for r in range(3):
            for q in range(r, 3):
                value = 0.0
                for p in range(6):
                    value += half[r, p] * jac[q, p]
                covariances[i, r, q] = covariances[i, q, r] = value
    return relative, covariances


@kernel
def closed_factor(
    indptr: Ints, indices: Ints, lower: Floats, order: Ints
) -> tuple[Ints, Ints, Floats]:
    """Return L in CSC with the entries that are zero by chance, which SciPy drops and the recursion needs.

    If rows i > p > j stand in column j, p its first below the diagonal, then row i stands in column p. The 3 by 3 blocks on the
    diagonal of A stand, too.
    """
    size = len(indptr) - 1
    head, following = np.full(size, -1, dtype=np.int64), np.full(size, -1, dtype=np.int64)
    mark = np.full(size, -1, dtype=np.int64)
    extra = np.full((size, 2), -1, dtype=np.int64)
    for i in range(size // 3):
        for r in range(3):
            n = 0
            for c in range(3):
                if order[3 * i + c] > order[3 * i + r]:
                    extra[order[3 * i + r], n] = order[3 * i + c]
                    n += 1
    new_indptr = np.zeros(size + 1, dtype=np.int64)
    new_indices = np.empty(2 * len(indices) + 16, dtype=np.int64)
    n = 0
    for j in range(size):
        start = n
        if n + size - j > len(new_indices):
            wider = np.empty(2 * len(new_indices) + size, dtype=np.int64)
            wider[:n] = new_indices[:n]
            new_indices = wider
        mark[j] = j
        new_indices[n] = j
        n += 1
        for a in range(indptr[j], indptr[j + 1]):
            if mark[indices[a]] != j:
                mark[indices[a]] = j
                new_indices[n] = indices[a]
                n += 1
        for a in range(2):
            if extra[j, a] >= 0 and mark[extra[j, a]] != j:
                mark[extra[j, a]] = j
                new_indices[n] = extra[j, a]
                n += 1
        child = head[j]
        while child >= 0:
            for a in range(new_indptr[child], new_indptr[child + 1]):
                if new_indices[a] > j and mark[new_indices[a]] != j:
                    mark[new_indices[a]] = j
                    new_indices[n] = new_indices[a]
                    n += 1
            child = following[child]
        new_indices[start:n].sort()
        new_indptr[j + 1] = n
        if n > start + 1:
            parent = new_indices[start + 1]
            following[j], head[parent] = head[parent], j
    values = np.zeros(n)
    for j in range(size):
        p = new_indptr[j]
        for a in range(indptr[j], indptr[j + 1]):
            while new_indices[p] != indices[a]:
                p += 1
            values[p] = lower[a]
    return new_indptr, new_indices[:n].copy(), values


@kernel
def inverse_blocks(
    indptr: Ints, indices: Ints, lower: Floats, pivots: Floats, order: Ints
) -> Cov:
    """Return (n, 3, 3) diagonal blocks of the inverse of A, from its factorization P A P^T = L D L^T.

    Parameters
    ----------
    indptr, indices, lower
        L in CSC, rows sorted, with its unit diagonal.
    pivots : (3n,) float64
        The diagonal of D.
    order : (3n,) int64
        Row of the factorization of each row of A.
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
                low, high = min(order[3 * i + r], order[3 * i + c]), max(order[3 * i + r], order[3 * i + c])
                p = indptr[low]
                while indices[p] != high:
                    p += 1
                blocks[i, r, c] = blocks[i, c, r] = z[p]
    return blocks
