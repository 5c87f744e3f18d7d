"""Curvature functions (eqs. 3-5) against their slow twin, and the laws they obey."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from curvescan import InvalidArgumentError, se2
from curvescan.matchers.cfsma.config import CurvatureConfig
from curvescan.matchers.cfsma.curvature import curvature_functions
from tests.reference import cfsma as twin
from tests.scenes import rough_polyline

seeds = st.integers(0, 10_000)
# the twin adds arc lengths in another order than the running walk: rounding, nothing else
ROUNDING = 1e-9


def functions_of(points, tolerance, starts=None, stops=None):
    return curvature_functions(
        points,
        np.array(starts if starts is not None else [0]),
        np.array(stops if stops is not None else [len(points)]),
        CurvatureConfig(arc_tolerance=tolerance),
    )


@given(seeds, st.floats(0.005, 0.1), st.integers(8, 40))
def test_agrees_with_the_slow_twin(seed, tolerance, n):
    points = rough_polyline(seed, n=n, n_corners=1)
    eta, reach = functions_of(points, tolerance)
    slow_eta, slow_reach = twin.curvature(points, tolerance)
    np.testing.assert_array_equal(reach, slow_reach)
    np.testing.assert_allclose(eta, slow_eta, atol=ROUNDING)


def test_segments_do_not_see_one_another():
    first, second = rough_polyline(1), rough_polyline(2)
    stray = np.zeros((3, 2))
    eta, reach = functions_of(np.concatenate([first, stray, second]), 0.03, starts=[0, 43], stops=[40, 83])
    for part, points in ((slice(0, 40), first), (slice(43, 83), second)):
        alone_eta, alone_reach = functions_of(points, 0.03)
        np.testing.assert_array_equal(eta[part], alone_eta)
        np.testing.assert_array_equal(reach[part], alone_reach)
    assert not eta[40:43].any()
    assert not reach[40:43].any()


@given(seeds, st.floats(-math.pi, math.pi), st.floats(-20, 20), st.floats(-20, 20))
def test_turning_and_moving_the_sensor_changes_nothing(seed, theta, x, y):
    points = rough_polyline(seed)
    eta, reach = functions_of(points, 0.03)
    moved_eta, moved_reach = functions_of(se2.transform([x, y, theta], points), 0.03)
    np.testing.assert_array_equal(moved_reach, reach)
    # 20 m over a chord of 5 cm leaves 13 digits of 16
    np.testing.assert_allclose(se2.wrap(moved_eta - eta), 0.0, atol=1e-10)


def test_a_line_is_zero_an_arc_is_flat_a_corner_is_a_peak_of_its_angle():
    line = np.stack([np.linspace(0, 4, 80), np.linspace(0, 1, 80)], axis=1)
    eta, reach = functions_of(line, 0.03)
    np.testing.assert_allclose(eta, 0.0, atol=1e-9)
    assert reach[0] == 79

    angles = np.linspace(0, 2, 200)
    arc = 2.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    eta, _ = functions_of(arc, 0.03)
    # away from the end, where the walk is cut short, all chords are alike: each turns by one step
    np.testing.assert_allclose(eta[:100], angles[1], rtol=1e-6)

    side = np.linspace(0, 2, 50)
    corner = np.concatenate([np.stack([side, 0 * side], 1), np.stack([0 * side + 2, side + side[1]], 1)])
    eta, _ = functions_of(corner, 0.03)
    assert eta.sum() == pytest.approx(math.pi / 2, abs=1e-6)
    assert abs(int(np.argmax(eta)) - 49) <= 2
    assert eta.max() > 0.2


def test_tolerance_must_be_positive():
    with pytest.raises(InvalidArgumentError, match="arc_tolerance must be > 0 m, got 0"):
        CurvatureConfig(arc_tolerance=0)
