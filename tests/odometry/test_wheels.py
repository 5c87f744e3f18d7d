"""Wheels: their scale, their noise and their slip are learned from what matches measure."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan import se2
from curvescan.odometry import MotionConfig
from curvescan.odometry.motion_model import MotionModel
from curvescan.odometry.wheels import Wheels
from curvescan.se2.uncertain import UncertainPose

CONFIG = MotionConfig()
STEP = np.array([0.1, 0.0, 0.03])


def driven(slips, scale=1.0, fully=None):
    """What is known of wheels after a drive: slips (n, 2) is what they err by at each step, metres; truth turns."""
    model, at = MotionModel.at_start(CONFIG), np.zeros(3)
    for k, slip in enumerate(slips):
        found = UncertainPose(STEP, 1e-6 * np.eye(3))
        at = se2.compose(at, [(STEP[0] + slip[0]) / scale, (STEP[1] + slip[1]) / scale, STEP[2]])
        is_fully_observed = fully is None or bool(fully[k])
        model = model.updated(model.predict(0.1 * k, at), found, is_fully_observed=is_fully_observed)
    return model.wheels


def at_rest():
    """A model that has seen a step, and wheels since."""
    model = MotionModel.at_start(CONFIG)
    for stamp in (0.0, 0.1):
        found = UncertainPose(np.array([0.1, 0.01, 0.05]), 1e-6 * np.eye(3))
        model = model.updated(model.predict(stamp, np.zeros(3)), found, is_fully_observed=False)
    return model


def slipping(share, n, seed=1):
    """Slips of n steps that go on for ten metres each, and have the share as their standard deviation, an axis."""
    rng = np.random.default_rng(seed)
    return np.repeat(rng.normal(0.0, share * STEP[0], (n // 100, 2)), 100, axis=0)


@pytest.mark.parametrize("share", [0.01, 0.03, 0.08])
def test_what_wheels_slip_is_learned(share):
    found = [driven(slipping(share, 2000, seed)).slip for seed in range(10)]
    assert np.mean(found) == pytest.approx(share, rel=0.25)


def test_wheels_that_measure_well_slip_by_little_and_such_of_a_wrong_size_too():
    assert driven(np.zeros((6000, 2))).slip < 0.001
    wrong = driven(np.zeros((6000, 2)), scale=1.05)
    assert wrong.scale == pytest.approx(1.05, rel=0.002)
    assert wrong.slip < 0.01


def test_before_matches_tell_it_is_as_configured():
    assert driven(np.zeros((15, 2))).slip == CONFIG.wheel_slip  # 1.5 m
    assert driven(np.zeros((22, 2))).slip < CONFIG.wheel_slip


def test_stretches_that_matches_do_not_measure_whole_say_nothing():
    slips, fully = slipping(0.1, 4000), np.arange(4000) % 15 > 0  # every 1.5 m a motion is open
    assert driven(slips, fully=fully).slip == CONFIG.wheel_slip


def test_a_leap_is_no_slip():
    slips = np.zeros((400, 2))
    slips[::100, 0] = 50.0
    assert driven(slips).slip < CONFIG.wheel_slip


def test_a_slip_counts_along_the_way_and_not_where_the_sensor_then_faces():
    """A circle of 10 m of wheels that always pull to one side of the sensor: over 2 m what they err by adds up."""
    aside = driven(np.tile([0.0, 0.002], (4000, 1)))
    assert aside.slip == pytest.approx(0.02 / np.sqrt(2.0), rel=0.1)


def test_wheels_without_an_error_do_not_stay_exact_for_ever():
    wheels = Wheels(slip=0.03)
    expected, config = UncertainPose(np.array([2.0, 0.0, 0.0]), 0.01 * np.eye(3)), MotionConfig(memory=1.0)
    for _ in range(3):
        wheels = wheels.learned(expected, expected.pose, config)
    assert 0.0 < wheels.slip < 1e-5
    assert wheels.learned(expected, np.array([2.1, 0.0, 0.0]), config).slip > wheels.slip


def test_what_is_learned_is_a_new_value():
    before = Wheels(slip=0.03)
    expected = UncertainPose(np.array([1.0, 0.0, 0.0]), 0.01 * np.eye(3))
    after = before.learned(expected, np.array([1.1, 0.0, 0.0]), CONFIG)
    assert before == Wheels(slip=0.03)
    assert after.stretch == 1.0
    assert after.behind == pytest.approx((0.1, 0.0))
    assert after.learned(expected, np.array([1.1, 0.0, 0.0]), CONFIG).slip > 0.03


def test_the_noise_of_wheels_after_one_error_of_theirs():
    """A mean over `memory` steps of the square of the error, in variances, both axes of a translation together."""
    config = MotionConfig()
    model = at_rest()
    prediction = model.predict(0.2, np.array([0.1, 0.0, 0.0]))
    cov = prediction.motion.covariance
    for error in (np.array([0.01, 0.012, 0.015]), np.array([0.2, 0.3, 0.01])):  # the second is more than two sigma off
        found = UncertainPose(prediction.motion.pose + error, 1e-6 * np.eye(3))
        square = 0.5 * (error[0] ** 2 + error[1] ** 2) / cov[0, 0], error[2] ** 2 / cov[2, 2]
        for learned, one in zip(
            model.updated(prediction, found, is_fully_observed=True).wheels.noise, square, strict=True
        ):
            assert learned == pytest.approx(1.0 + (min(one, 4.0) - 1.0) / config.memory, rel=1e-9)
    # and no less than a tenth of what the configuration says, at most what is seen
    variance = cov[0, 0], cov[2, 2]
    for off, limit in (((0.0, 0.0, 0.0), (0.1, 0.1)), ((0.0, 3.0, 2.0), (0.5 * 9.0 / variance[0], 4.0 / variance[1]))):
        model = at_rest()
        for k in range(400):
            prediction = model.predict(0.1 * k, np.array([0.1 * k, 0.0, 0.0]))
            motion = UncertainPose(prediction.motion.pose + np.array(off), 1e-6 * np.eye(3))
            model = model.updated(prediction, motion, is_fully_observed=True)
        assert model.wheels.noise == pytest.approx(limit, rel=0.05)
