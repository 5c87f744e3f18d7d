"""Posterior covariances: what residuals, shared scans and the keyframes' own noise make of the marginals."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan import se2
from curvescan.slam.config import NoiseConfig
from curvescan.slam.pose_graph.cholesky import Elimination
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph
from curvescan.slam.pose_graph.optimization import optimize, squared_distances
from curvescan.slam.pose_graph.posterior import (
    covariances_seen_from,
    design_effect,
    heading_drift,
    own_noise,
    variance_factor,
    with_own_noise,
    without_floor,
)
from tests.slam.graphs import SIGMAS, loop, measured_edges

N = 60
ENDS = [(i, j) for i in range(N) for j in range(i + 1, min(i + 6, N))]


def test_matches_of_one_scan_say_less_the_more_alike_they_err() -> None:
    chain = np.array([(k, k + 1) for k in range(9)])
    assert np.array_equal(design_effect(chain, np.ones(9, dtype=bool), 10, 0.6), np.ones(9))
    ends = np.array(ENDS)
    # in the middle five edges to earlier keyframes, five to later ones
    middle = (ends[:, 0] > 10) & (ends[:, 1] < N - 10)
    for correlation, expected in ((0.0, 1.0), (0.6, 3.4), (1.0, 5.0)):
        found = design_effect(ends, np.ones(len(ends), dtype=bool), N, correlation)
        np.testing.assert_allclose(found[middle], expected)


def test_edges_that_are_no_matches_have_no_design_effect() -> None:
    ends = np.array([(0, 1), (0, 1), (0, 1)])
    is_match = np.array([True, True, False])
    assert design_effect(ends, is_match, 2, 1.0).tolist() == [1.0, 1.0, 1.0]


def test_the_floor_is_taken_out_again_and_leaves_covariances_positive() -> None:
    floor = np.diag(np.square([5e-3, 5e-3, 2e-3]))
    turned = np.array([[4e-6, 1e-6, 0.0], [1e-6, 9e-6, 2e-7], [0.0, 2e-7, 1e-6]])
    found = without_floor(np.stack([turned + floor, 0.5 * floor]), floor)
    np.testing.assert_allclose(found[0], turned, atol=1e-12)
    np.testing.assert_allclose(found[1], 1e-8 * np.eye(3), atol=1e-15)


@pytest.mark.parametrize("scale", [0.25, 1.0, 9.0])
def test_residuals_tell_by_what_the_covariances_are_wrong(scale: float) -> None:
    edges = measured_edges(loop(N), ENDS, seed=3)
    # the noise is that of SIGMAS, the covariances are not
    edges = edges._replace(information=edges.information * scale)
    optimum = optimize(loop(N), edges, np.ones(len(ENDS)), np.array([0]), Elimination.of(edges.ends, N))
    found = variance_factor(squared_distances(optimum, edges), N - 1)
    # 3 (285 - 59) = 678 degrees of freedom: 5 % standard deviation; 30 of them count as no change
    assert found == pytest.approx((678.0 * scale + 30.0) / 708.0, rel=0.15)


def test_without_redundancy_nothing_is_concluded() -> None:
    assert variance_factor(np.array([900.0]), 1) == 1.0


def test_the_noise_of_the_first_scan_turns_all_others_about_it() -> None:
    poses = np.array([[1.0, 2.0, 0.5], [4.0, 2.0, 0.1], [1.0, 6.0, -2.0]])
    own = np.zeros((3, 3, 3))
    own[0, 2, 2] = 1e-6
    found = with_own_noise(np.zeros((3, 3, 3)), poses, own, 0)
    assert np.array_equal(found[0], np.zeros((3, 3)))
    for k in (1, 2):
        eps = 1e-6
        turned = se2.compose(poses[0] + [0.0, 0.0, eps], se2.between(poses[0], poses[k]))
        slope = (turned - poses[k]) / eps
        np.testing.assert_allclose(found[k], 1e-6 * np.outer(slope, slope), atol=1e-10)


def test_the_own_noise_is_that_of_the_best_match_in_the_axes_of_the_map() -> None:
    poses = np.array([[0.0, 0.0, np.pi / 2], [0.0, 1.0, np.pi / 2], [0.0, 2.0, np.pi / 2]])
    ends = np.array([(0, 1), (1, 2), (0, 2)])
    along = np.diag(np.square([3.0, 1.0, 1.0]) * SIGMAS[0] ** 2)
    covariances = np.stack([along, 4.0 * along, 9.0 * along])
    found = own_noise(poses, ends, covariances, np.array([True, True, True]))
    across = np.diag(np.square([1.0, 3.0, 1.0]) * SIGMAS[0] ** 2)
    np.testing.assert_allclose(found, np.stack([across, across, 4.0 * across]), atol=1e-12)
    assert not own_noise(poses, ends, covariances, np.zeros(3, dtype=bool)).any()


def test_edges_side_by_side_do_not_average_the_drift_of_the_heading() -> None:
    poses = np.column_stack((0.5 * np.arange(N), np.zeros(N), np.zeros(N)))
    for reach in (1, 3):
        ends = np.array([(i, j) for i in range(N) for j in range(i + 1, min(i + 1 + reach, N))])
        drift = heading_drift(ends, se2.between(poses[ends[:, 0]], poses[ends[:, 1]]), N)
        # the heading alone: a chain of scalars, pose 0 known
        information = np.zeros((N, N))
        for (i, j), variance in zip(ends.tolist(), drift.tolist(), strict=True):
            information[[i, j], [i, j]] += 1.0 / variance
            information[[i, j], [j, i]] -= 1.0 / variance
        at_end = np.linalg.inv(information[1:, 1:])[-1, -1]
        np.testing.assert_allclose(at_end, 1e-6 * 0.5 * (N - 1), rtol=0.15)


def test_closures_of_loops_do_not_drift() -> None:
    assert heading_drift(np.array([[0, 30]]), np.array([[1.0, 0.0, 0.0]]), 40).tolist() == [0.0]


def test_steps_of_a_row_that_no_match_measures_slip_alike() -> None:
    kinds = [EdgeKind.MOTION] * 4 + [EdgeKind.MATCH] + [EdgeKind.MOTION]
    graph = PoseGraph()
    for k in range(len(kinds) + 1):
        graph.add_pose(np.array([float(k), 0.0, 0.0]))
    for k, kind in reversed(list(enumerate(kinds))):
        variance = 0.01 if kind == EdgeKind.MOTION else 1e-4
        graph.add_edge(k, k + 1, np.array([1.0, 0.0, 0.0]), np.diag([variance, 1e-6, 1e-8]), kind)
    alone, alike = (covariances_seen_from(graph, 0, NoiseConfig(), in_row=share)[:, 0, 0] for share in (0.0, 1.0))
    np.testing.assert_allclose(alone[1:5], 0.01 * np.arange(1, 5), rtol=0.02)
    assert alike[4] == pytest.approx(0.01 * 16, rel=0.02)
    assert alike[6] - alike[5] == pytest.approx(alone[6] - alone[5], rel=0.02)
