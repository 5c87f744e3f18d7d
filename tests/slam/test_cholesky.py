"""The block factorization: against the dense one."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan.slam.pose_graph.cholesky import Elimination, factorized, inverse_blocks, solved
from curvescan.slam.pose_graph.optimization import linearized
from tests.slam.graphs import dense_information, ladder, loop, measured_edges

_N = 30
_LINKS = [*ladder(_N), (3, 17), (25, 4), (11, 28)]


def _blocks(matrix: np.ndarray, i: int, j: int) -> np.ndarray:
    return matrix[3 * i : 3 * i + 3, 3 * j : 3 * j + 3]


@pytest.mark.parametrize("held", [[0], [4, 29]])
def test_it_solves_and_inverts_as_the_dense_matrix(held: list[int]) -> None:
    truth = loop(_N)
    edges = measured_edges(truth, _LINKS, seed=1)
    weights = np.linspace(0.1, 1.0, len(edges.ends))
    anchors, is_held = np.array(held, dtype=np.int64), np.isin(np.arange(_N), held)
    dense = dense_information(truth, edges, weights, anchors)
    order, *pattern = Elimination.of(edges.ends, _N)
    rank = np.argsort(order)
    jacobians = linearized(truth, *edges, weights)[0]
    weighted = weights[:, np.newaxis, np.newaxis] * edges.information
    given = *pattern, rank[edges.ends], jacobians, weighted, is_held[order]
    blocks, right = factorized(*given), np.random.default_rng(2).normal(size=(_N, 3))
    found = solved(*pattern, blocks, right[order])[rank]
    assert found.ravel() == pytest.approx(np.linalg.solve(dense, right.ravel()), rel=1e-8, abs=1e-12)
    inverse, found = np.linalg.inv(dense), inverse_blocks(*pattern, blocks)[pattern[0][rank]]
    for i in range(_N):
        assert found[i] == pytest.approx(_blocks(inverse, i, i), rel=1e-8, abs=1e-12)


def test_the_pattern_is_closed_along_a_chain_of_any_length() -> None:
    n = 5_000
    chain = np.column_stack((np.arange(n - 1), np.arange(1, n)))
    ends = np.concatenate((chain, [(0, n - 1), (10, n - 500), (700, 4_000), (2_000, 4_900)]))
    _, indptr, rows = Elimination.of(ends, n)
    assert np.array_equal(rows[indptr[:-1]], np.arange(n))
    for j in range(n):
        column = rows[indptr[j] : indptr[j + 1]].tolist()
        if len(column) > 2:  # the first row below the diagonal has all others: Liu's elimination tree
            k = column[1]
            assert set(column[2:]) <= set(rows[indptr[k] : indptr[k + 1]].tolist())
