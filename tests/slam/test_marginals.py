"""Marginals: against the dense inverse of the information matrix."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan import se2
from curvescan.slam.loops.marginals import Marginals
from curvescan.slam.pose_graph.optimization import marginal_covariances
from tests.slam.graphs import SIGMAS, dense_information, ladder, loop, measured_edges


@pytest.mark.parametrize("anchor", [0, 7, 19])
def test_they_are_the_blocks_of_the_dense_inverse(anchor: int) -> None:
    truth = loop(20)
    edges = measured_edges(truth, ladder(20), seed=1)
    anchors = np.array([anchor])
    weights = np.ones(len(edges.ends))
    found = marginal_covariances(truth, edges, weights, anchors)
    dense = np.linalg.inv(dense_information(truth, edges, weights, anchors))
    for k in range(20):
        wanted = np.zeros((3, 3)) if k == anchor else dense[3 * k : 3 * k + 3, 3 * k : 3 * k + 3]
        assert found[k] == pytest.approx(wanted, rel=1e-9, abs=1e-15)


def test_entries_that_are_zero_by_chance_do_no_harm() -> None:
    # a straight chain of unturned poses: many entries of the factor vanish
    truth = np.column_stack((np.arange(10.0), np.zeros(10), np.zeros(10)))
    edges = measured_edges(truth, [*[(k, k + 1) for k in range(9)], (0, 9), (2, 7)], seed=2)
    found = marginal_covariances(truth, edges, np.ones(11), np.array([0]))
    dense = np.linalg.inv(dense_information(truth, edges, np.ones(11), np.array([0])))
    assert found[9] == pytest.approx(dense[27:, 27:], rel=1e-9)


def test_the_relative_covariance_of_two_poses_joined_by_one_edge_is_that_of_the_edge() -> None:
    truth = loop(6)
    edges = measured_edges(truth, [(k, k + 1) for k in range(5)], seed=3)
    relative, covariances = Marginals.of(truth, marginal_covariances(truth, edges, np.ones(5), np.array([5])))
    assert relative[4] == pytest.approx(se2.between(truth[4], truth[5]))
    assert covariances[4] == pytest.approx(np.diag(SIGMAS**2), rel=1e-9, abs=1e-15)
