"""What is expected of the next scan: the last motion, or what the wheels say."""

from __future__ import annotations

import math

import numpy as np
import pytest

from curvescan.odometry import MotionConfig
from curvescan.odometry.motion_model import MotionModel
from curvescan.se2.uncertain import UncertainPose

SEEN = UncertainPose(np.array([0.1, 0.01, 0.05]), np.diag([1e-6, 1e-6, 1e-8]))


def told(config=None, n=1, motion=SEEN):
    one = MotionModel(config or MotionConfig())
    for k in range(n):
        one.predict(0.1 * k, None)
        one.update(motion, is_plausible=True, is_fully_observed=True)
    return one


def test_the_last_motion_is_expected_again():
    expected = told().predict(0.1, None)
    np.testing.assert_array_equal(expected.pose, SEEN.pose)


def test_a_steady_motion_is_expected_ever_more_surely_and_a_jerky_one_less():
    config = MotionConfig()
    steady = told(n=100).predict(10.0, None).cov
    assert math.sqrt(steady[0, 0]) == pytest.approx(config.least_sigma_m, rel=0.01)
    assert math.sqrt(steady[2, 2]) == pytest.approx(config.least_sigma_rad, rel=0.01)
    jerky = MotionModel(config)
    for k in range(100):
        jerky.predict(0.1 * k, None)
        jerky.update(
            UncertainPose((-1) ** k * SEEN.pose, SEEN.cov),
            is_plausible=True,
            is_fully_observed=True,
        )
    cov = jerky.predict(10.0, None).cov
    # a change of 0.2 m and 0.1 rad each step
    assert math.sqrt(cov[0, 0]) == pytest.approx(0.2 / math.sqrt(2), rel=0.1)
    assert math.sqrt(cov[2, 2]) == pytest.approx(0.1, rel=0.1)


def test_a_long_pause_makes_less_certain_and_a_clock_that_goes_back_does_not():
    usual = told(n=50)
    after = np.trace(usual.predict(5.0 + 0.8, None).cov)
    before = np.trace(told(n=50).predict(5.0, None).cov)
    assert after > 20 * before
    backwards = np.trace(told(n=50).predict(1.0, None).cov)
    assert backwards == pytest.approx(before, rel=1e-6)


def test_what_no_match_shows_is_expected_less_surely_with_each_step():
    one = MotionModel(MotionConfig())
    sigmas = []
    for k in range(5):
        expected = one.predict(0.1 * k, None)
        sigmas.append(expected.cov[0, 0])
        one.update(expected, is_plausible=True, is_fully_observed=False)
    assert (np.diff(sigmas) > 0.009).all()


def test_a_motion_that_is_not_plausible_is_not_repeated():
    one = told()
    one.predict(0.1, None)
    leap = UncertainPose(np.array([2.0, 0.0, 1.0]), SEEN.cov)
    one.update(leap, is_plausible=False, is_fully_observed=True)
    np.testing.assert_array_equal(one.predict(0.2, None).pose, 0.0)


def test_failures_repeat_the_motion_only_so_often():
    one = told(MotionConfig(max_repeats=2))
    held = [one.predict_without_match(one.predict(0.1 * k, None)) for k in range(4)]
    assert [is_held for _, is_held in held] == [False, False, True, True]
    np.testing.assert_array_equal(held[1][0].pose, SEEN.pose)
    np.testing.assert_array_equal(held[2][0].pose, 0.0)


def test_wheels_are_taken_as_far_as_they_are_known():
    one = told()
    one.predict(0.1, np.array([5.0, 1.0, 0.5]))
    expected = one.predict(0.2, np.array([5.0, 1.2, 0.5]))
    np.testing.assert_allclose(
        expected.pose, [0.2 * math.sin(0.5), 0.2 * math.cos(0.5), 0.0], atol=1e-12
    )
    config = MotionConfig()
    assert expected.cov[0, 0] == pytest.approx(0.003**2 + (config.wheel_share * 0.2) ** 2)
    assert expected.cov[2, 2] == pytest.approx(0.003**2 + (config.wheel_drift * 0.2) ** 2)
    # wheels go on telling where matches fail: the sensor is not taken to stand
    assert not any(one.predict_without_match(expected)[1] for _ in range(20))


def test_a_gyro_tells_the_turn_alone():
    one = told()
    one.predict(0.1, np.array([np.nan, np.nan, 3.1]))
    expected = one.predict(0.2, np.array([np.nan, np.nan, -3.1]))
    np.testing.assert_allclose(expected.pose, [0.1, 0.01, 2 * np.pi - 6.2], atol=1e-12)
    assert expected.cov[2, 2] < 0.03**2
    assert expected.cov[0, 0] > 0.05**2


def test_wheels_that_fail_for_a_scan_are_done_without():
    one = told()
    one.predict(0.1, np.array([1.0, 0.0, 0.0]))
    expected = one.predict(0.2, np.full(3, np.nan))
    np.testing.assert_array_equal(expected.pose, SEEN.pose)
