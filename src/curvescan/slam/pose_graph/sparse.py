"""Sparse symmetric systems: the pattern of a pose graph's normal equations, and their factorization.

The pattern is built once for a set of edges; each iteration only fills in numbers. SciPy's SuperLU factorizes; where
the package `qdldl` is installed its LDL^T does, in about half the time.
"""

from __future__ import annotations

import importlib.util
from dataclasses import dataclass
from functools import cache
from typing import Any, Protocol, cast

import numpy as np

from curvescan.types import Floats, Ints


class Factor(Protocol):
    """A factorized symmetric positive definite matrix."""

    def solve(self, right: Floats) -> Floats:
        """Return x of A x = right, (n,) or (n, k)."""
        ...


@dataclass(frozen=True, eq=False, kw_only=True)
class BlockPattern:
    """Where the (b, b) blocks of a symmetric matrix lie in the arrays of a CSC matrix."""

    size: int  # side b of a block
    # of the CSC matrix; both triangles are stored
    indptr: Ints
    indices: Ints
    diagonal: Ints  # (n,): number of the diagonal block of each node
    # (m,): number of block (i, j) and of block (j, i) of each edge
    upper: Ints
    lower: Ints
    # (n_blocks,): A block's entry (r, c) is ``data[first + c * stride + r]``
    first: Ints
    stride: Ints

    @property
    def n_entries(self) -> int:
        """Stored entries of the matrix."""
        return len(self.indices)


def block_pattern(n_nodes: int, ends: Ints, size: int) -> BlockPattern:
    """Return the pattern of a matrix with a diagonal block a node and two off-diagonal blocks an edge.

    ends (m, 2).
    """
    nodes = np.arange(n_nodes, dtype=np.int64)
    i, j = ends[:, 0], ends[:, 1]
    # a block's key: column first, as CSC has it
    keys = np.concatenate((nodes * n_nodes + nodes, j * n_nodes + i, i * n_nodes + j))
    unique, place = np.unique(keys, return_inverse=True)
    place = place.astype(np.int64)
    column, row = np.divmod(unique, n_nodes)
    n_in_column = np.bincount(column, minlength=n_nodes)
    start = np.concatenate(([0], np.cumsum(n_in_column)))
    stride = size * n_in_column[column]
    within = np.arange(len(unique)) - start[column]
    first = size * size * start[column] + size * within
    lengths = np.repeat(size * n_in_column, size)
    indptr = np.concatenate(([0], np.cumsum(lengths)))
    indices = np.empty(size * size * len(unique), dtype=np.int64)
    for c in range(size):
        for r in range(size):
            indices[first + c * stride + r] = size * row + r
    m = len(ends)
    return BlockPattern(
        size=size,
        indptr=indptr.astype(np.int64),
        indices=indices,
        diagonal=place[:n_nodes],
        upper=place[n_nodes : n_nodes + m],
        lower=place[n_nodes + m :],
        first=first.astype(np.int64),
        stride=stride.astype(np.int64),
    )


def factorize(pattern: BlockPattern, data: Floats) -> Factor:
    """Return a factorization of a symmetric positive definite matrix.

    data (n_entries,).
    """
    if has_qdldl():
        return _Qdldl(_matrix(pattern, data))
    return cast(Factor, lu_of(pattern, data))


def lu_of(pattern: BlockPattern, data: Floats) -> Any:
    """Return SciPy's SuperLU object of a symmetric positive definite matrix, factorized without pivoting."""
    from scipy.sparse.linalg import splu

    return splu(
        _matrix(pattern, data), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True}
    )


def _matrix(pattern: BlockPattern, data: Floats) -> Any:
    from scipy.sparse import csc_matrix

    n = len(pattern.indptr) - 1
    return csc_matrix((data, pattern.indices, pattern.indptr), shape=(n, n))


@cache
def has_qdldl() -> bool:
    """Return whether the optional package `qdldl` is installed."""
    return importlib.util.find_spec("qdldl") is not None


class _Qdldl:
    """LDL^T by QDLDL, which solves for one right-hand side at a time."""

    def __init__(self, matrix: Any) -> None:
        import qdldl

        self._solver = qdldl.Solver(matrix)

    def solve(self, right: Floats) -> Floats:
        if right.ndim == 1:
            return cast(Floats, self._solver.solve(right))
        return np.column_stack([self._solver.solve(np.ascontiguousarray(c)) for c in right.T])
