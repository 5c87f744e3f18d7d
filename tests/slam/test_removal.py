"""Removal of a pose: the others stay where they are, and are known no better than before."""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph
from curvescan.slam.pose_graph.marginals import marginal_covariances
from curvescan.slam.pose_graph.optimization import Edges, normal_equations, optimize
from curvescan.slam.pose_graph.removal import carry_over, heir_of
from tests.slam.graphs import dead_reckoning, ladder, loop, measured_edges

_N = 40


def _graph(seed: int) -> tuple[PoseGraph, np.ndarray]:
    truth = loop(_N)
    edges = measured_edges(truth, ladder(_N), seed)
    graph = PoseGraph()
    for pose in dead_reckoning(edges, _N):
        graph.add_pose(pose)
    covariances = np.linalg.inv(edges.information)
    for k, (i, j) in enumerate(edges.ends.tolist()):
        kind = EdgeKind.MATCH if j == i + 1 else EdgeKind.CLOSURE
        graph.add_edge(i, j, edges.measured[k], covariances[k], kind)
    _optimize(graph)
    return graph, truth


def _optimize(graph: PoseGraph) -> np.ndarray:
    edges = Edges.of(graph.ends, graph.measured, graph.covariances)
    graph.poses[:] = optimize(graph.poses, edges, graph.weights, np.array([0])).poses
    information, _, _ = normal_equations(graph.poses, edges, graph.weights, np.array([0]))
    return marginal_covariances(information, np.array([0]))


def test_the_heir_is_one_of_the_place_that_a_closure_ties_best() -> None:
    graph, _ = _graph(0)
    assert heir_of(graph, 3, np.array([3 + _N // 2, 30])) == 3 + _N // 2
    assert heir_of(graph, 4, np.array([30])) is None


def test_the_poses_that_stay_move_by_less_than_they_are_uncertain() -> None:
    graph, truth = _graph(1)
    before, sigma = graph.poses.copy(), np.sqrt(np.trace(_optimize(graph)[-1][:2, :2]))
    is_kept = np.ones(_N, dtype=np.bool_)
    for v in (3, 6, 9, 12):
        seen = carry_over(graph, v, v + _N // 2)
        by_heir = se2.compose(graph.poses[v + _N // 2], seen.pose)
        # the heir's closure errs by two or three hundredths
        assert np.hypot(*(by_heir - graph.poses[v])[:2]) < 0.15
        is_kept[v] = False
    graph.keep_poses(is_kept)
    assert graph.n_poses == _N - 4
    assert graph.ends.max() == _N - 5
    covariances = _optimize(graph)
    moved = np.hypot(*(graph.poses - before[is_kept])[:, :2].T)
    assert moved.max() < sigma
    true = truth[is_kept]
    errors = np.hypot(*(graph.poses - true)[:, :2].T)
    assert errors.max() < 4.0 * np.sqrt(np.trace(covariances[-1][:2, :2]))


def test_what_is_left_is_known_no_better_than_before() -> None:
    graph, _ = _graph(2)
    before = _optimize(graph)
    is_kept = np.ones(_N, dtype=np.bool_)
    carry_over(graph, 9, 9 + _N // 2)
    is_kept[9] = False
    graph.keep_poses(is_kept)
    after = _optimize(graph)
    grown = np.trace(after, axis1=1, axis2=2)[1:] / np.trace(before[is_kept], axis1=1, axis2=2)[1:]
    assert grown.min() > 0.98
    assert np.linalg.eigvalsh(after[1:]).min() > 0.0
