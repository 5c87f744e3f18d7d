"""Point-to-line least squares and its covariance, against a general solver and a Monte Carlo."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from curvescan import se2
from curvescan.matchers.baselines.iteration import is_constrained, jacobian, point_to_line_step, propagated_covariance
from curvescan.matchers.cfsma.covariance import LEAST_SIGMA
from tests.reference import baselines as twin

poses = st.tuples(st.floats(-3, 3), st.floats(-3, 3), st.floats(-3.14, 3.14)).map(np.array)


def scene(seed, pose, n=60, sigma=0.0):
    """Points of cur on lines of ref in many directions."""
    rng = np.random.default_rng(seed)
    cur = rng.uniform(-4, 4, (n, 2))
    angles = rng.uniform(-math.pi, math.pi, n)
    normals = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    along = rng.uniform(-1, 1, n)[:, None] * np.stack([-normals[:, 1], normals[:, 0]], axis=1)
    anchors = se2.transform(pose, cur) + along + sigma * rng.standard_normal((n, 1)) * normals
    return cur, anchors, normals


@given(st.integers(0, 1000), poses)
def test_rows_are_the_derivative(seed, pose):
    cur, anchors, normals = scene(seed, pose, n=10)
    rows = jacobian(cur, normals, pose)
    for k in range(3):
        step = np.zeros(3)
        step[k] = 1e-6
        ahead = twin.normal_distances(pose + step, cur, anchors, normals)
        behind = twin.normal_distances(pose - step, cur, anchors, normals)
        np.testing.assert_allclose(rows[:, k], (ahead - behind) / 2e-6, atol=1e-7)


@given(st.integers(0, 1000), poses, st.floats(-0.3, 0.3), st.floats(-0.3, 0.3), st.floats(-0.3, 0.3))
def test_exact_lines_give_back_the_pose(seed, pose, dx, dy, turn):
    cur, anchors, normals = scene(seed, pose)
    found = np.add(pose, [dx, dy, turn])
    for _ in range(20):
        found = point_to_line_step(cur, anchors, normals, found)
    np.testing.assert_allclose(found[:2], pose[:2], atol=1e-8)
    assert abs(se2.wrap(found[2] - pose[2])) < 1e-9
    assert -math.pi < found[2] <= math.pi


def test_no_other_pose_has_smaller_distances():
    pose = np.array([0.4, -0.2, 0.3])
    cur, anchors, normals = scene(5, pose, sigma=0.05)
    found = pose
    for _ in range(20):
        found = point_to_line_step(cur, anchors, normals, found)
    least = np.sum(twin.normal_distances(found, cur, anchors, normals) ** 2)
    for change in 1e-4 * np.vstack([np.eye(3), -np.eye(3)]):
        assert np.sum(twin.normal_distances(found + change, cur, anchors, normals) ** 2) > least


def wall(n=100):
    """Readings of one wall along y, 2 m ahead."""
    cur = np.column_stack([np.full(n, 2.0), np.linspace(-1, 1, n)])
    return cur, np.add(cur, [0.1, 0.0]), np.tile([1.0, 0.0], (n, 1))


def test_one_wall_moves_what_it_holds_and_nothing_else():
    cur, anchors, normals = wall()
    found = np.zeros(3)
    for _ in range(5):
        found = point_to_line_step(cur, anchors, normals, found)
    np.testing.assert_allclose(found, [0.1, 0.0, 0.0], atol=1e-6)


def test_nothing_to_solve_is_no_pose():
    cur = np.zeros((4, 2))
    assert point_to_line_step(cur, cur, np.full((4, 2), np.nan), np.zeros(3)) is None


@pytest.mark.parametrize("origin", [(0.0, 0.0), (30.0, -20.0)])
def test_walls_corridors_and_round_rooms_leave_a_motion_free(origin):
    rng = np.random.default_rng(0)

    def fixed(points, angles):
        angles = angles + 0.04 * rng.standard_normal(len(points))  # what noise does to a tangent
        normals = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        points = points + origin
        return is_constrained(jacobian(points, normals, np.zeros(3)), points)

    along = np.linspace(-4, 4, 200)
    sides = np.column_stack([along, np.repeat([1.0, -1.0], 100)])
    assert not fixed(np.column_stack([along, np.full(200, 2.0)]), np.full(200, math.pi / 2))
    assert not fixed(sides, np.full(200, math.pi / 2))
    turn = np.linspace(-3, 3, 200)
    assert not fixed(3.0 * np.column_stack([np.cos(turn), np.sin(turn)]) + [1.0, 0.5], turn)
    ended = np.where(np.arange(200) % 20 == 0, 0.0, math.pi / 2)  # a corridor with something across
    assert fixed(sides, ended)
    assert not is_constrained(np.zeros((2, 3)), np.zeros((2, 2)))


def test_the_covariance_agrees_with_a_monte_carlo():
    # each line belongs to one reading of the reference and is used by five of the current scan
    rng = np.random.default_rng(3)
    pose, sigma, n_runs = np.array([0.2, -0.1, 0.15]), 0.01, 4000
    cur, exact, normals = scene(7, pose, n=60)
    line_of = np.repeat(np.arange(12), 5)
    normals, weights = normals[line_of], np.full(60, 0.8)
    exact = se2.transform(pose, cur)
    errors, mean = np.empty((n_runs, 3)), np.zeros((3, 3))
    for run in range(n_runs):
        own, shared = sigma * rng.standard_normal(60), sigma * rng.standard_normal(12)
        off = own - weights * shared[line_of]
        found = point_to_line_step(cur, exact + off[:, None] * normals, normals, pose, repeats=3)
        errors[run] = found - pose
        rows = jacobian(cur, normals, found)
        left = twin.normal_distances(found, cur, exact + off[:, None] * normals, normals)
        sources = ((np.arange(60), np.ones(60)), (line_of, weights))
        mean += propagated_covariance(rows, left, sources) / n_runs
    sample = errors.T @ errors / n_runs
    scale = np.sqrt(np.outer(np.diag(sample), np.diag(sample)))
    # 4000 runs know a variance to 2.2 %; the shared noise takes up to a tenth of the errors' variance with it,
    # as 12 sources are fitted by 3 unknowns
    np.testing.assert_allclose(mean / scale, sample / scale, atol=0.2)
    # had the lines been taken for exact, five errors that agree would count as five
    blind = propagated_covariance(rows, left, ((np.arange(60), np.ones(60)),))
    assert np.trace(sample) > 1.7 * np.trace(blind)


def test_no_error_still_gives_a_positive_definite_matrix():
    cur, _, normals = scene(1, np.zeros(3))
    rows = jacobian(cur, normals, np.zeros(3))
    sources = ((np.arange(60), np.ones(60)),)
    small = propagated_covariance(rows, np.zeros(60), sources)
    assert (np.linalg.eigvalsh(small) > 0).all()
    np.testing.assert_array_equal(small, small.T)
    known = propagated_covariance(rows, np.zeros(60), sources, 0.01)
    np.testing.assert_allclose(known, small * (0.01 / LEAST_SIGMA) ** 2)
