"""The normal equations of a pose graph, factorized in blocks of a pose each, without pivoting: A = C C^T.

The columns of C stand one after the other, each with its rows rising from the diagonal on. There the block is W, the
inverse of that of C. The pattern is closed: where a column has two rows, that of the first has the second.
"""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from curvescan._jit import inlined, kernel
from curvescan.types import Bools, Cov, Floats, Ints

_LEAST_PIVOT = 1e-12
"""Of information: a matrix that is singular but for rounding gives large steps and not NaN."""


class Elimination(NamedTuple):
    """An order of n poses in which the normal equations fill in little, and the pattern of C."""

    order: Ints  # (n,): the poses
    indptr: Ints  # (n + 1,): first block of each column, and the number of blocks
    rows: Ints  # of each block

    @classmethod
    def of(cls, ends: Ints, n_poses: int) -> Elimination:
        """Return the order of minimum degree by the (m, 2) ends of edges."""
        return _eliminated(ends.tobytes(), n_poses)


@functools.lru_cache(maxsize=1)  # one graph is solved several times
def _eliminated(ends: bytes, n_poses: int) -> Elimination:
    from scipy.sparse import coo_array, dia_array  # loads for a good part of a second
    from scipy.sparse.linalg import splu

    rows = np.frombuffer(ends, dtype=np.int64).reshape(-1, 2)
    i, j = np.concatenate((rows, rows[:, ::-1])).T
    links = coo_array((np.ones(len(i)), (i, j)), shape=(n_poses, n_poses)).tocsc()
    # hardly more than singular: no entry of its factor is zero by chance, or fades away along a chain
    degrees = dia_array((np.bincount(i, minlength=n_poses) + 1e-6, 0), shape=links.shape)
    found = splu((degrees - links).tocsc(), "MMD_AT_PLUS_A", 0.0, options={"SymmetricMode": True})
    lower = found.L.tocsc()
    lower.sort_indices()
    return Elimination(np.argsort(found.perm_c), lower.indptr.astype(np.int64), lower.indices.astype(np.int64))


@kernel
def factorized(indptr: Ints, rows: Ints, ends: Ints, jacobians: Floats, information: Cov, is_held: Bools) -> Cov:
    """Return the blocks of C by m edges; poses (n,) that are held stand for themselves.

    ends (m, 2); jacobians (m, 2, 3, 3): by the poses i and j of each; information (m, 3, 3), weighted.
    """
    blocks = np.zeros((len(rows), 3, 3))
    for k in range(len(ends)):
        pulled = np.zeros((2, 3, 3))
        for u in range(2):
            column = ends[k, u]
            _add_transposed(information, k, jacobians[k], u, pulled, u)
            for v in range(2):
                row = ends[k, v]
                if column <= row and not (is_held[row] or is_held[column]):
                    p = indptr[column]
                    while rows[p] != row:
                        p += 1
                    _add_transposed(jacobians[k], v, pulled, u, blocks, p)
    for j in range(len(is_held)):
        start, stop = indptr[j], indptr[j + 1]
        if is_held[j]:
            blocks[start, 0, 0] = blocks[start, 1, 1] = blocks[start, 2, 2] = 1.0
        root = _inverse_root(blocks, start)
        for a in range(start + 1, stop):
            for r in range(3):
                x, y, z = _row(blocks, a, r)
                for c in range(3):
                    blocks[a, r, c] = x * root[c, 0] + y * root[c, 1] + z * root[c, 2]
        for a in range(start + 1, stop):
            p = indptr[rows[a]]
            (t, i, w), (x, y, z), (e, f, g) = _row(blocks, a, 0), _row(blocks, a, 1), _row(blocks, a, 2)
            for b in range(a, stop):
                while rows[p] != rows[b]:
                    p += 1
                for r in range(3):
                    h, m, n = _row(blocks, b, r)
                    blocks[p, r, 0] -= h * t + m * i + n * w
                    blocks[p, r, 1] -= h * x + m * y + n * z
                    blocks[p, r, 2] -= h * e + m * f + n * g
    return blocks


@kernel
def solved(indptr: Ints, rows: Ints, blocks: Cov, right: Floats) -> Floats:
    """Return the (n, 3) solution of A x = b, b (n, 3), by the blocks of C."""
    x = right.copy()
    for j in range(len(x)):
        w = blocks[indptr[j]]
        for r in range(2, -1, -1):
            x[j, r] = w[r, 0] * x[j, 0] + w[r, 1] * x[j, 1] + w[r, 2] * x[j, 2]
        for a in range(indptr[j] + 1, indptr[j + 1]):
            for r in range(3):
                for c in range(3):
                    x[rows[a], r] -= blocks[a, r, c] * x[j, c]
    for j in range(len(x) - 1, -1, -1):
        w = blocks[indptr[j]]
        for a in range(indptr[j] + 1, indptr[j + 1]):
            for r in range(3):
                for c in range(3):
                    x[j, r] -= blocks[a, c, r] * x[rows[a], c]
        for r in range(3):
            x[j, r] = w[0, r] * x[j, 0] + w[1, r] * x[j, 1] + w[2, r] * x[j, 2]
    return x


@kernel
def inverse_blocks(indptr: Ints, rows: Ints, blocks: Cov) -> Cov:
    """Return the blocks of the inverse of A in the pattern of C, after Takahashi, Fagan and Chen (1973).

    With S_I = sum_K Z_IK C_KJ over K in column J below its diagonal, Z_IJ = -S_I W and Z_JJ = W^T (1 + C^T S) W.
    """
    z = np.zeros_like(blocks)
    for j in range(len(indptr) - 2, -1, -1):
        start, stop = indptr[j], indptr[j + 1]
        for a in range(start + 1, stop):
            p = indptr[rows[a]]
            (e, f, g), (u, v, w), (h, i, k) = _row(blocks, a, 0), _row(blocks, a, 1), _row(blocks, a, 2)
            for b in range(a, stop):
                while rows[p] != rows[b]:
                    p += 1
                for r in range(3):
                    x, y, t = _row(z, p, r)
                    z[b, r, 0] += x * e + y * u + t * h
                    z[b, r, 1] += x * f + y * v + t * i
                    z[b, r, 2] += x * g + y * w + t * k
                if b > a:
                    _add_transposed(z, p, blocks, b, z, a)
        m = np.zeros((1, 3, 3))
        m[0, 0, 0] = m[0, 1, 1] = m[0, 2, 2] = 1.0
        for a in range(start + 1, stop):
            _add_transposed(blocks, a, z, a, m, 0)
            _multiply(z, a, blocks, start, -1.0)
        _multiply(m, 0, blocks, start, 1.0)
        _add_transposed(blocks, start, m, 0, z, start)
    return z


@kernel
def _inverse_root(blocks: Cov, k: int) -> Cov:
    """Put the inverse of its lower triangular root in the place of a block; a view."""
    (p, _, _), (a, q, _), (b, c, s) = _row(blocks, k, 0), _row(blocks, k, 1), _row(blocks, k, 2)
    w: Cov = blocks[k]
    w[0, 0] = 1.0 / math.sqrt(max(p, _LEAST_PIVOT))
    a, b = a * w[0, 0], b * w[0, 0]
    w[1, 1] = 1.0 / math.sqrt(max(q - a * a, _LEAST_PIVOT))
    c = (c - a * b) * w[1, 1]
    w[2, 2] = 1.0 / math.sqrt(max(s - b * b - c * c, _LEAST_PIVOT))
    w[1, 0], w[2, 1] = -a * w[0, 0] * w[1, 1], -c * w[1, 1] * w[2, 2]
    w[2, 0] = -(b * w[0, 0] + c * w[1, 0]) * w[2, 2]
    w[0, 1] = w[0, 2] = w[1, 2] = 0.0
    return w


@inlined
def _row(blocks: Cov, k: int, r: int) -> tuple[float, float, float]:
    return blocks[k, r, 0], blocks[k, r, 1], blocks[k, r, 2]


@kernel
def _multiply(blocks: Cov, k: int, right: Cov, i: int, sign: float) -> None:
    """Multiply blocks[k] by right[i] from the right, and by a sign."""
    for r in range(3):
        x, y, z = _row(blocks, k, r)
        for c in range(3):
            blocks[k, r, c] = sign * (x * right[i, 0, c] + y * right[i, 1, c] + z * right[i, 2, c])


@kernel
def _add_transposed(left: Cov, i: int, right: Cov, j: int, total: Cov, k: int) -> None:
    """Add left[i].T @ right[j] to total[k]."""
    for r in range(3):
        for c in range(3):
            product = left[i, 0, r] * right[j, 0, c] + left[i, 1, r] * right[j, 1, c] + left[i, 2, r] * right[j, 2, c]
            total[k, r, c] += product
