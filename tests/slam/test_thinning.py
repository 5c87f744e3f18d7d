"""Thinning: a place that is seen over and over keeps few keyframes, and every scan still has its pose.

When a pose goes, the others stay where they are, and are known no better than before.
"""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.odometry.gaps import LOST_COVARIANCE
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam.config import PlacesConfig, SlamConfig
from curvescan.slam.pose_graph.cholesky import Elimination
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph
from curvescan.slam.pose_graph.optimization import Edges, marginal_covariances, optimize
from curvescan.slam.thinning import Removed, Tie, best_tie, carry_over, pairs_alike, with_gone
from tests.slam.graphs import dead_reckoning, graph_of, ladder, loop, measured_edges

_N = 40


@pytest.mark.slow
def test_memory_follows_the_area_and_not_the_time() -> None:
    made = cs.simulate("room", seed=2, n_scans=260, odometry_noise=None)
    out = list(made)
    there, truth = [*out, *out[::-1]], np.concatenate((made.truth.poses, made.truth.poses[::-1]))
    n_laps, counts, edges = 4, [], []
    slam = cs.Slam(config=SlamConfig(places=PlacesConfig(n_keyframes=2)))
    for _ in range(n_laps):
        for scan in there:
            slam.add(scan)
        counts.append(len(slam.keyframes))
        edges.append(len(slam.graph.ends))
    trajectory = slam.finish()
    assert slam.keyframes.numbers[-1] >= len(slam.keyframes)
    # what comes after the second lap adds next to nothing: the newest thirty stay in any case
    assert counts[-1] < 1.15 * counts[1] + 10
    assert edges[-1] < 1.4 * edges[1]
    assert len(slam.map) == slam.graph.n_poses == len(slam.keyframes.index)
    true = se2.between(truth[0], np.concatenate([truth] * n_laps))
    assert len(trajectory) == len(true)
    assert np.hypot(*(trajectory.poses - true)[:, :2].T).max() < 0.1
    assert trajectory.covariances is not None
    assert np.isfinite(trajectory.covariances).all()


@pytest.mark.slow
def test_without_a_place_seen_often_nothing_goes() -> None:
    made = cs.simulate("office", seed=1, n_scans=200, odometry_noise=None)
    slam = cs.run(list(made), "slam").engine
    assert slam.keyframes.numbers[-1] == len(slam.keyframes) - 1


def test_poses_of_one_place_are_those_of_a_fragment_that_look_one_way() -> None:
    rng = np.random.default_rng(4)
    poses = rng.uniform(-1.5, 1.5, (120, 3)) * (1.0, 1.0, 0.5)
    poses[:, 2] = se2.wrap(poses[:, 2] + np.pi)
    fragments = rng.integers(0, 2, 120)
    off = poses - poses[:, np.newaxis]
    near = (np.hypot(off[..., 0], off[..., 1]) < 0.8) & (np.abs(se2.wrap(off[..., 2])) < 0.8)
    near &= fragments == fragments[:, np.newaxis]
    pairs = pairs_alike(poses, fragments, 0.8)
    assert (np.diff(pairs[:, 0]) >= 0).all()
    assert set(map(tuple, pairs.tolist())) == set(zip(*np.nonzero(np.triu(near, 1)), strict=True))
    assert 100 < len(pairs) < 2000


def _graph(seed: int) -> tuple[PoseGraph, np.ndarray]:
    truth = loop(_N)
    edges = measured_edges(truth, ladder(_N), seed)
    graph = graph_of(dead_reckoning(edges, _N), edges)
    _optimize(graph)
    return graph, truth


def _optimize(graph: PoseGraph) -> np.ndarray:
    edges = Edges.of(graph.ends, graph.measured, graph.edge_covariances)
    graph.poses[:] = optimize(
        graph.poses, edges, graph.weights, np.array([0]), Elimination.of(edges.ends, len(graph.poses))
    )
    return marginal_covariances(graph.poses, edges, graph.weights, np.array([0]))


def test_the_heir_is_one_of_the_place_that_a_closure_ties_best() -> None:
    graph, _ = _graph(0)
    tie = best_tie(graph, 3, np.array([3 + _N // 2, 30]))
    assert tie is not None
    assert graph.ends[tie].tolist() == [3, 3 + _N // 2]
    assert best_tie(graph, 4, np.array([30])) is None
    # one behind which the track was lost keeps the step that says so
    rows = (graph.ends == [3, 4]).all(axis=1)
    assert rows.any()
    graph.edge_covariances[rows] += LOST_COVARIANCE
    assert best_tie(graph, 3, np.array([3 + _N // 2, 30])) is None


def _without(graph: PoseGraph, v: int) -> UncertainPose:
    """Carry the edges of a pose over to that of the second lap, and return how the one lies to the other."""
    tie = best_tie(graph, v, np.array([v + _N // 2]))
    assert tie is not None
    (other, seen), _ = carry_over(graph, v, tie)
    assert other == v + _N // 2
    return seen


def test_the_poses_that_stay_move_by_less_than_they_are_uncertain() -> None:
    graph, truth = _graph(1)
    before, sigma = graph.poses.copy(), np.sqrt(np.trace(_optimize(graph)[-1][:2, :2]))
    is_kept = np.ones(_N, dtype=np.bool_)
    for v in (3, 6, 9, 12):
        seen = _without(graph, v)
        by_heir = se2.compose(graph.poses[v + _N // 2], seen.pose)
        # the representative's closure errs by two or three hundredths
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
    _without(graph, 9)
    is_kept[9] = False
    graph.keep_poses(is_kept)
    after = _optimize(graph)
    grown = np.trace(after, axis1=1, axis2=2)[1:] / np.trace(before[is_kept], axis1=1, axis2=2)[1:]
    assert grown.min() > 0.98
    assert np.linalg.eigvalsh(after[1:]).min() > 0.0


def test_closures_of_a_pose_that_goes_lead_to_its_heir() -> None:
    truth, graph = loop(8), PoseGraph()
    for pose in truth:
        graph.add_pose(pose)
    for i, j in [*((k, k + 1) for k in range(7)), (2, 5), (2, 7), (0, 2)]:
        kind = EdgeKind.MATCH if j == i + 1 else EdgeKind.CLOSURE
        graph.add_edge(i, j, se2.between(truth[i], truth[j]), np.diag([1e-4, 1e-4, 1e-5]), kind)
    tie = best_tie(graph, 2, np.array([5]))
    assert tie is not None
    (other, seen), _ = carry_over(graph, 2, tie)
    np.testing.assert_allclose(se2.compose(truth[other], seen.pose), truth[2], atol=1e-12)
    assert not (graph.ends == 2).any()
    assert graph.ends[-3:].tolist() == [[1, 3], [5, 7], [0, 5]]
    i, j = graph.ends.T
    np.testing.assert_allclose(graph.measured, se2.between(truth[i], truth[j]), atol=1e-12)


def test_a_keyframe_that_went_by_a_false_match_lies_where_the_way_has_it() -> None:
    """Two doors look alike: the map is put right later, and what hangs on the match would stay 3 m off."""
    poses = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 3.0, 0.0]])
    sure, way = 1e-4 * np.eye(3), 1e-2 * np.eye(3)
    step = Tie(0, UncertainPose(np.array([0.5, 0.0, 0.0]), way))
    right, false = (Tie(2, UncertainPose(np.array([0.02, y, 0.0]), sure)) for y in (-3.0, 0.0))
    for tie, expected in ((right, [0.52, 0.0, 0.0]), (false, [0.5, 0.0, 0.0])):
        placed, _ = with_gone([Removed(3, tie, step)], np.arange(3), poses, np.zeros((3, 3, 3)), sure)
        np.testing.assert_allclose(placed[3], expected, atol=1e-12)
