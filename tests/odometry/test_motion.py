"""Motion: what wheels and gyroscopes add to what the last motion tells, and what is learned of either."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan.odometry import MotionConfig
from curvescan.odometry.motion import MotionModel
from curvescan.odometry.track import Track
from curvescan.se2.uncertain import identity

REST = np.zeros(3)


def model(**config):
    return MotionModel.at_start(MotionConfig(**config)).advanced(REST, True, REST)


def track(speed):
    return Track.at(identity(), identity(), np.asarray(speed, dtype=float), np.eye(3) * 4.0)


def test_wheels_decide_on_the_speed():
    wheels = model().measured(np.array([0.2, 0.0, 0.1]), REST)
    found = wheels.on(track(REST), 0.1)
    np.testing.assert_allclose(found.speed, [2.0, 0.0, 1.0], rtol=0.2, atol=1e-9)
    assert found.speed_cov[1, 1] < 0.1  # sideways nothing: that is measured, too


def test_a_gyroscope_tells_the_turn_alone():
    gyro = MotionModel.at_start(MotionConfig()).advanced(np.array([np.nan, np.nan, 3.1]), True, REST)
    wheels = gyro.measured(np.array([np.nan, np.nan, -3.1]), REST)
    assert not wheels.is_complete
    found = wheels.on(track([0.3, 0.0, 0.0]), 0.1)
    assert found.speed[2] == pytest.approx((2 * np.pi - 6.2) / 0.1, rel=0.3)  # the short way round
    np.testing.assert_array_equal(found.speed[:2], [0.3, 0.0])


def test_wheels_that_were_not_updated_say_nothing_and_then_all_of_it():
    wheels, moved = np.array([0.2, 0.0, 0.0]), np.array([0.2, 0.0, 0.0])
    late = model().advanced(wheels, True, moved)
    assert late.measured(wheels.copy(), moved) is None
    waited = late.advanced(wheels, False, moved)
    np.testing.assert_allclose(waited.measured(np.array([0.6, 0.0, 0.0]), moved).motion, [0.2, 0.0, 0.0], atol=1e-12)
    # at rest the same pose is a measurement
    np.testing.assert_array_equal(late.measured(wheels.copy(), REST).motion, REST)


def test_changes_are_learned_but_never_none_and_never_from_one_leap():
    quiet, wild = model(), model()
    for _ in range(300):
        quiet = quiet.learned(track(REST), track(REST), None, 0.1)
    assert 0.0 < quiet.variances[0] < model().variances[0]
    wild = wild.learned(track(REST), track([50.0, 0.0, 0.0]), None, 0.1)
    assert wild.variances[0] <= 2.0 * model().variances[0]


def test_wheels_that_err_more_are_given_less_say():
    one = model()
    for _ in range(40):
        wheels = one.measured(np.array([0.1, 0.0, 0.0]), REST)
        one = one.learned(track(REST), track([3.0, 0.0, 0.0]), wheels, 0.1)
    assert one.noise[0] > 5.0
    assert one.measured(np.array([0.1, 0.0, 0.0]), REST).variances[0] > 5.0 * wheels.variances[0] / one.noise[0]


def test_the_reach_of_a_sensor_grows_with_time_and_is_bounded_in_heading():
    near, far = model().reach(REST, 0.1), model().reach(REST, 60.0)
    assert np.sqrt(near.cov[0, 0]) < 1.0
    assert np.sqrt(far.cov[0, 0]) == pytest.approx(120.0, rel=0.01)
    assert np.sqrt(far.cov[2, 2]) <= np.pi
