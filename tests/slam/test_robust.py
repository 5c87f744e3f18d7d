"""Robust optimization: false closures lose their weight, true ones keep it."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan import se2
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph
from curvescan.slam.pose_graph.optimization import Edges
from curvescan.slam.pose_graph.robust import optimized, tls_weights
from tests.slam.graphs import SIGMAS, dead_reckoning, graph_of, ladder, loop, measured_edges


def _with_outliers(edges: Edges, n: int, share: float, seed: int) -> tuple[Edges, np.ndarray]:
    """Replace that share of the closures by random ones; return which edges are false."""
    rng = np.random.default_rng(seed)
    measured = edges.measured.copy()
    closures = np.arange(n - 1, len(measured))
    false = rng.choice(closures, round(share * len(closures)), replace=False)
    measured[false] = rng.uniform([-8, -8, -3], [8, 8, 3], (len(false), 3))
    is_false = np.zeros(len(measured), dtype=np.bool_)
    is_false[false] = True
    return edges._replace(measured=measured), is_false


@pytest.mark.parametrize("share", [0.2, 0.4, 0.6])
def test_it_keeps_the_true_closures_and_no_false_one(share: float) -> None:
    n = 120
    truth = loop(n)
    edges, is_false = _with_outliers(measured_edges(truth, ladder(n), seed=1), n, share, seed=2)
    found = optimized(graph_of(dead_reckoning(edges, n), edges, EdgeKind.BY_HAND), weights=None)
    assert found.weights[is_false].max() == 0.0
    assert found.weights[~is_false].min() > 0.99
    off = se2.between(truth, found.poses)
    assert np.hypot(off[:, 0], off[:, 1]).max() < 10.0 * SIGMAS[1]


def test_an_edge_wins_its_vote_back() -> None:
    n = 60
    truth = loop(n)
    edges = measured_edges(truth, ladder(n), seed=3)
    lost = 1.0 * (np.arange(len(edges.ends)) < n - 1)
    found = optimized(graph_of(truth, edges, EdgeKind.BY_HAND), weights=lost)
    assert found.weights.min() == 1.0


def test_a_step_that_slipped_gives_way_and_keeps_its_least_weight() -> None:
    n = 60
    truth = loop(n)
    edges = measured_edges(truth, ladder(n), seed=3)
    slipped = edges.measured.copy()
    slipped[25, 0] += 2.0
    found = optimized(graph_of(dead_reckoning(edges, n), edges._replace(measured=slipped)), weights=None)
    # between two closures nothing tells which of three steps it was
    [lost] = np.flatnonzero(found.weights < 0.5).tolist()
    assert lost in (24, 25, 26)
    assert found.weights[lost] == 1e-4
    off = np.delete(se2.between(truth, found.poses), [25, 26], axis=0)
    assert np.hypot(off[:, 0], off[:, 1]).max() < 10.0 * SIGMAS[1]


def test_weights_of_truncated_least_squares() -> None:
    weights = tls_weights(np.array([0.0, 1.0, 16.0, 1e9]), 16.0, 1.0)
    # inner bound 8, outer 32; between them sqrt(limit mu (mu + 1) / d) - mu
    assert weights == pytest.approx([1.0, 1.0, np.sqrt(2.0) - 1.0, 0.0])


@pytest.mark.parametrize(("sigmas_off", "is_kept"), [(5.0, True), (10.0, False)])
def test_a_step_is_given_up_where_a_slip_that_may_lead_anywhere_is_likelier(sigmas_off: float, is_kept: bool) -> None:
    graph, spread = PoseGraph(), np.diag([0.12, 0.12, 0.01]) ** 2  # a slip anywhere: 16 + 2 log(10^2 / 0.12^2) = 33.7
    for x in (0.0, 0.5):
        graph.add_pose(np.array([x, 0.0, 0.0]))
    graph.add_edge(0, 1, np.array([0.5, 0.0, 0.0]), spread, EdgeKind.MOTION)
    for _ in range(8):
        graph.add_edge(0, 1, np.array([0.5 + 0.12 * sigmas_off, 0.0, 0.0]), 1e-4 * np.eye(3), EdgeKind.CLOSURE)
    weights = optimized(graph, weights=None).weights
    assert weights[1:].min() == 1.0
    assert bool(weights[0] == 1.0) is is_kept
