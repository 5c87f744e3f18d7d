"""The loop of the iterated methods: when it stops, and which pairs its gates keep."""

from __future__ import annotations

import math

import numpy as np
import pytest

from curvescan.matchers.baselines.config import ConvergenceConfig, ShrinkConfig
from curvescan.matchers.baselines.iteration import iterate, keep_best, within_quantile

LIMITS = ConvergenceConfig(max_iterations=50, min_translation=1e-3, min_rotation=1e-3)


def test_it_stops_where_it_no_longer_moves():
    goal = np.array([1.0, -2.0, 0.5])
    way = iterate(np.zeros(3), lambda pose, _: pose + 0.5 * (goal - pose), LIMITS)
    assert way.has_converged
    assert not way.is_lost
    np.testing.assert_allclose(way.pose, goal, atol=2e-3)
    assert way.n_iterations == len(way.poses) - 1 == 12  # 2.24 m halved until under 1 mm


def test_it_does_not_stop_while_its_limits_shrink():
    way = iterate(np.zeros(3), lambda pose, _: pose, LIMITS, n_shrinking=9)
    assert way.has_converged
    assert way.n_iterations == 10


def test_it_ends_without_converging():
    way = iterate(np.zeros(3), lambda pose, _: np.add(pose, [0.1, 0.0, 0.0]), LIMITS)
    assert not way.has_converged
    assert way.n_iterations == 50


def test_a_jump_between_two_poses_is_convergence_too():
    pair = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0]])
    way = iterate(pair[0], lambda _, i: pair[(i + 1) % 2], LIMITS)
    assert way.has_converged
    assert way.n_iterations == 2


def test_a_full_turn_is_no_motion():
    way = iterate(np.array([0.0, 0.0, math.pi]), lambda pose, _: -pose, LIMITS)
    assert way.n_iterations == 1


def test_nothing_to_stand_on_is_lost():
    way = iterate(np.zeros(3), lambda pose, i: np.add(pose, [1.0, 0.0, 0.0]) if i < 2 else None, LIMITS)
    assert way.is_lost
    assert way.n_iterations == 2
    np.testing.assert_array_equal(way.pose, [2.0, 0.0, 0.0])


def test_the_best_share_of_the_pairs_is_kept():
    squared = np.array([4.0, math.inf, 1.0, 9.0, 0.0, math.inf])
    np.testing.assert_array_equal(np.flatnonzero(keep_best(squared, 1.0)), [0, 2, 3, 4])
    np.testing.assert_array_equal(np.flatnonzero(keep_best(squared, 0.75)), [0, 2, 4])
    np.testing.assert_array_equal(np.flatnonzero(keep_best(squared, 0.01)), [4])
    assert not keep_best(np.full(3, math.inf), 0.5).any()


def test_pairs_far_beyond_the_quantile_are_outliers():
    squared = np.array([1.0, 1.0, 4.0, 100.0, math.inf])
    kept = keep_best(squared, 1.0)
    np.testing.assert_array_equal(np.flatnonzero(within_quantile(squared, kept, 0.5, 2.0)), [0, 1, 2])
    np.testing.assert_array_equal(within_quantile(squared, kept, 1.0, 1.0), kept)
    nothing = np.zeros(5, dtype=bool)
    assert not within_quantile(squared, nothing, 0.5, 2.0).any()


def test_a_limit_shrinks_to_its_last_value():
    limit = ShrinkConfig(first=2.0, last=0.1, decay=0.25)
    assert limit.at(0) == 2.0
    assert limit.at(4) == pytest.approx(2.0 / math.e)
    assert limit.at(limit.n_shrinking - 1) > limit.at(limit.n_shrinking) == 0.1
    assert ShrinkConfig(first=1.0, last=1.0, decay=1.0).n_shrinking == 0
