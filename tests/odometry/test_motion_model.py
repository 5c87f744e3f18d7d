"""What is expected of the next scan: the last motion, or what the wheels say."""

from __future__ import annotations

import math

import numpy as np
import pytest

from curvescan import se2
from curvescan.odometry import MotionConfig
from curvescan.odometry.motion_model import MotionModel
from curvescan.se2.uncertain import UncertainPose

SEEN = UncertainPose(np.array([0.1, 0.01, 0.05]), np.diag([1e-6, 1e-6, 1e-8]))


def updated(model, stamp=0.0, motion=SEEN, odometry_pose=None, **how):
    """The model after one more scan."""
    given = {"is_fully_observed": True} | how
    return model.updated(model.predict(stamp, odometry_pose), motion, **given)


def steady(config=None, n=1, motion=SEEN):
    model = MotionModel.at_start(config or MotionConfig())
    for k in range(n):
        model = updated(model, 0.1 * k, motion)
    return model


def test_the_last_motion_is_expected_again():
    expected = steady().predict(0.1, None).motion
    np.testing.assert_array_equal(expected.pose, SEEN.pose)


def test_a_prediction_changes_nothing():
    model = steady(n=20)
    first, second = model.predict(2.0, np.ones(3)), model.predict(2.0, np.ones(3))
    np.testing.assert_array_equal(first.motion.covariance, second.motion.covariance)
    assert first.deskewer == second.deskewer
    assert model.odometry_pose is None


def test_a_steady_motion_is_expected_ever_more_surely_and_a_jerky_one_less():
    config = MotionConfig()
    cov = steady(n=100).predict(10.0, None).motion.covariance
    assert math.sqrt(cov[0, 0]) == pytest.approx(config.least_sigma_m, rel=0.01)
    assert math.sqrt(cov[2, 2]) == pytest.approx(config.least_sigma_m, rel=0.01)
    jerky = MotionModel.at_start(config)
    for k in range(100):
        jerky = updated(jerky, 0.1 * k, UncertainPose((-1) ** k * SEEN.pose, SEEN.covariance))
    cov = jerky.predict(10.0, None).motion.covariance
    # a change of 0.2 m and 0.1 rad each step
    assert math.sqrt(cov[0, 0]) == pytest.approx(0.2 / math.sqrt(2), rel=0.1)
    assert math.sqrt(cov[2, 2]) == pytest.approx(0.1, rel=0.1)


def test_a_long_pause_makes_less_certain_and_a_clock_that_goes_back_does_not():
    model = steady(n=50)
    after = np.trace(model.predict(5.0 + 0.8, None).motion.covariance)
    before = np.trace(model.predict(5.0, None).motion.covariance)
    assert after > 20 * before
    backwards = np.trace(model.predict(1.0, None).motion.covariance)
    assert backwards == pytest.approx(before, rel=1e-6)


def test_a_pause_counts_as_twenty_scans_at_most():
    model = steady(n=50)
    sigma_1, sigma_19, sigma_25, sigma_500 = (
        math.sqrt(model.predict(4.9 + 0.1 * n, None).motion.covariance[0, 0]) for n in (1, 19, 25, 500)
    )
    assert sigma_19 == pytest.approx(19 * sigma_1, rel=0.01)
    assert sigma_25 == sigma_500 == pytest.approx(20 * sigma_1, rel=0.01)


def test_one_leap_is_no_habit():
    model = steady(n=100)
    before = model.predict(10.0, None).motion.covariance
    after = updated(model, 10.0, UncertainPose(np.array([1.1, 0.01, 0.55]), SEEN.covariance))
    cov = after.predict(10.1, None).motion.covariance
    # a leap of many standard deviations counts as one at the gate: the mean over 20 steps at most doubles
    for k in (0, 2):
        assert 1.5 * before[k, k] < cov[k, k] < 2.1 * before[k, k]


def test_what_no_match_shows_is_expected_less_surely_with_each_step():
    model = MotionModel.at_start(MotionConfig())
    sigmas = []
    for k in range(5):
        expected = model.predict(0.1 * k, None).motion
        sigmas.append(expected.covariance[0, 0])
        model = updated(model, 0.1 * k, expected, is_fully_observed=False)
    assert (np.diff(sigmas) > 0.009).all()


def test_the_motion_that_was_found_is_expected_next_however_it_leaps():
    leap = UncertainPose(np.array([2.0, 0.0, 1.0]), SEEN.covariance)
    np.testing.assert_array_equal(updated(steady(), 0.1, leap).predict(0.2, None).motion.pose, leap.pose)


def test_failures_repeat_the_motion_only_so_often():
    model = steady(MotionConfig(max_repeats=2))
    exhausted = []
    for k in range(4):
        prediction = model.predict(0.1 * k, None)
        exhausted.append(model.is_exhausted(prediction))
        np.testing.assert_array_equal(prediction.motion.pose, SEEN.pose)
        model = model.updated_without_match(prediction, prediction.motion)
    assert exhausted == [False, False, True, True]
    assert not updated(model).is_exhausted(prediction)  # a match ends it


def test_wheels_are_taken_as_far_as_they_are_known():
    model = updated(steady(), 0.1, odometry_pose=np.array([5.0, 1.0, 0.5]))
    prediction = model.predict(0.2, np.array([5.0, 1.2, 0.5]))
    expected = prediction.motion
    np.testing.assert_allclose(expected.pose, [0.2 * math.sin(0.5), 0.2 * math.cos(0.5), 0.0], atol=1e-12)
    config = MotionConfig()
    assert expected.covariance[0, 0] == pytest.approx(0.003**2 + (config.wheel_share * 0.2) ** 2)
    assert expected.covariance[2, 2] == pytest.approx(0.003**2 + (config.wheel_share * 0.2) ** 2)
    # wheels go on measuring where matches fail: the sensor is not taken to stand
    for _ in range(20):
        model = model.updated_without_match(prediction, expected)
        assert not model.is_exhausted(prediction)


def test_a_gyro_measures_the_turn_alone():
    model = updated(steady(), 0.1, odometry_pose=np.array([np.nan, np.nan, 3.1]))
    expected = model.predict(0.2, np.array([np.nan, np.nan, -3.1])).motion
    np.testing.assert_allclose(expected.pose, [0.1, 0.01, 2 * np.pi - 6.2], atol=1e-12)
    assert expected.covariance[2, 2] < 0.03**2
    assert expected.covariance[0, 0] > 0.05**2


def test_wheels_that_fail_for_a_scan_are_done_without():
    model = updated(steady(), 0.1, odometry_pose=np.array([1.0, 0.0, 0.0]))
    expected = model.predict(0.2, np.full(3, np.nan)).motion
    np.testing.assert_array_equal(expected.pose, SEEN.pose)


def test_the_noise_of_wheels_is_learnt_from_what_the_matches_measure():
    """Wheels that slip by 5 cm at each step, to and fro, and wheels that measure exactly."""
    for slip, is_worse in ((0.05, True), (0.0, False)):
        model, pose = steady(), np.zeros(3)
        for k in range(60):
            pose = pose + np.array([SEEN.pose[0] + (-1) ** k * slip, 0.0, 0.0])
            straight = UncertainPose(np.array([SEEN.pose[0], 0.0, 0.0]), SEEN.covariance)
            model = updated(model, 0.1 * k, straight, odometry_pose=pose)
        cov = model.predict(6.0, pose + np.array([0.1, 0.0, 0.0])).motion.covariance
        usual = 0.003**2 + (0.1 * 0.1) ** 2
        assert bool(cov[0, 0] > 4.0 * usual) is is_worse
        assert bool(cov[0, 0] < 0.2 * usual) is not is_worse


def rolled(scale, way=SEEN.pose[0], slips=()):
    """The model after 200 steps of wheels of a wrong size, which slip by a metre at some of them, and their pose."""
    model, pose = steady(), np.zeros(3)
    for k in range(200):
        pose = pose + np.array([scale * way + (k in slips), 0.0, 0.0])
        model = updated(model, 0.1 * k, UncertainPose(np.array([way, 0.0, 0.0]), SEEN.covariance), odometry_pose=pose)
    return model, pose


@pytest.mark.parametrize("way", [0.1, -0.1])
def test_the_scale_of_wheels_is_learnt_from_what_the_matches_measure(way):
    for scale in (0.95, 1.04):
        model, pose = rolled(scale, way)
        expected = model.predict(20.0, pose + np.array([scale * way, 0.0, 0.0])).motion
        assert expected.pose[0] == pytest.approx(way, rel=0.003)  # a twentieth of it as long as nothing is known


def test_wheels_that_slip_by_a_metre_keep_their_scale():
    model, _ = rolled(1.0, slips=(20, 60, 100))
    assert model.wheels.scale == pytest.approx(1.0, abs=1e-9)


def test_wheels_along_what_matches_leave_open_say_nothing_of_their_scale():
    model = updated(steady(), 0.1, odometry_pose=np.zeros(3))
    model = updated(model, 0.2, odometry_pose=np.array([0.11, 0.0, 0.0]), is_fully_observed=False)
    assert model.wheels.ways == (1.0, 1.0)


def test_the_covariance_by_wheels_is_that_of_the_configuration():
    model = updated(steady(), 0.1, odometry_pose=np.zeros(3))
    prediction = model.predict(0.2, np.array([0.3, 0.4, 0.2]))
    config = MotionConfig()
    along = 0.003**2 + (config.wheel_share * 0.5) ** 2
    drift, share = config.wheel_share * 0.5, config.wheel_turn_share * 0.2
    turn = 0.003**2 + share**2 + drift**2
    np.testing.assert_allclose(prediction.motion.covariance, np.diag([along, along, turn]), rtol=1e-12)
    # of a gyro alone: no path, no drift
    model = updated(steady(), 0.1, odometry_pose=np.array([np.nan, np.nan, 0.0]))
    cov = model.predict(0.2, np.array([np.nan, np.nan, 0.2])).motion.covariance
    assert cov[2, 2] == pytest.approx(0.003**2 + share**2, rel=1e-12)


def recovery_sigmas(model, stamp):
    return np.sqrt(np.diag(model.predict(stamp, None).recovery))


def test_how_far_a_sensor_gets_unseen_follows_from_the_time():
    """One metre a second and two radians, and the motion itself, as a scan may be missing; half a second at most."""
    still = MotionModel.at_start(MotionConfig())
    for k in range(10):
        still = updated(still, 0.1 * k, UncertainPose(np.zeros(3), SEEN.covariance))
    np.testing.assert_allclose(recovery_sigmas(still, 1.0), [0.1, 0.1, 0.2], rtol=1e-9)
    np.testing.assert_allclose(recovery_sigmas(still, 1.2), [0.3, 0.3, 0.6], rtol=1e-9)
    np.testing.assert_allclose(recovery_sigmas(still, 9.0), [0.5, 0.5, 1.0], rtol=1e-9)
    np.testing.assert_allclose(recovery_sigmas(still, 0.9), [0.1, 0.1, 0.2], rtol=1e-9)  # written in bursts
    failed = still.updated_without_match(still.predict(1.0, None), UncertainPose(np.zeros(3), SEEN.covariance))
    np.testing.assert_allclose(recovery_sigmas(failed, 1.1), [0.2, 0.2, 0.4], rtol=1e-9)
    moving = updated(still, 1.0, UncertainPose(np.array([0.12, -0.16, 0.3]), SEEN.covariance))
    np.testing.assert_allclose(recovery_sigmas(moving, 1.1), [0.3, 0.3, 0.5], rtol=1e-9)
    assert [moving.predict(stamp, None).reach for stamp in (1.1, 3.0)] == pytest.approx([0.3, 2.2])
    np.testing.assert_allclose(moving.predict(1.3, None).onward, 2.0 * moving.last.pose)  # two scans are missing
    # stamps that are all alike are no times
    np.testing.assert_allclose(
        recovery_sigmas(updated(MotionModel.at_start(MotionConfig()), 0.0), 0.0), [0.5, 0.5, 1.0]
    )
    assert updated(MotionModel.at_start(MotionConfig()), 0.0).predict(0.0, None).reach >= 1_000.0


def test_turns_come_back_to_what_was_expected_of_them_before_any_was_seen():
    config = MotionConfig()
    model = steady(n=100)
    for step in range(3):
        before = model.variance_turn
        model = updated(model, 10.0 + 0.1 * step, is_fully_observed=False)
        wide = config.sigma_m**2
        assert model.variance_turn == pytest.approx(before + (wide - before) / config.memory)


def test_a_change_of_the_motion_counts_along_both_axes():
    config = MotionConfig()
    model = steady()
    moved = UncertainPose(SEEN.pose + np.array([0.01, 0.05, 0.0]), SEEN.covariance)
    square = 0.5 * (0.01**2 + 0.05**2)
    before = model.variance_translation
    after = updated(model, 0.1, moved).variance_translation
    assert after == pytest.approx(before + (square - before) / config.memory)


@pytest.mark.parametrize(("leap", "is_measured"), [(900.0, True), (1100.0, False)])
def test_wheels_that_leap_by_a_kilometre_measure_nothing(leap, is_measured):
    model = updated(steady(), 0.1, odometry_pose=np.zeros(3))
    assert model.predict(0.2, np.array([leap, 0.0, 0.0])).is_measured == is_measured


DRIVING = UncertainPose(np.array([0.8, 0.0, 0.1]), np.diag([1e-6, 1e-6, 1e-8]))


def driven(n, motion=DRIVING):
    """A model after n scans that matches placed, with wheels that say the same, and the wheels' last pose."""
    model, wheels = MotionModel.at_start(MotionConfig()), np.zeros(3)
    for k in range(n):
        wheels = se2.compose(wheels, motion.pose)
        model = updated(model, 0.1 * k, motion, wheels)
    return model, wheels


def test_wheels_that_were_not_updated_on_the_move_measure_nothing_until_they_are():
    model, wheels = driven(20)
    missed = model.predict(2.0, wheels)
    assert missed.is_missed
    assert not missed.is_measured
    np.testing.assert_array_equal(missed.motion.pose, DRIVING.pose)
    # nothing matches: 0.5 m were driven, and 0.8 m were taken
    model = model.updated_without_match(missed, missed.motion)
    there = se2.compose(wheels, [0.5, 0.0, 0.0])
    then = model.predict(2.1, se2.compose(there, [0.3, 0.0, 0.05]))
    assert then.is_measured
    found = se2.compose(missed.motion.pose, then.motion.pose)
    np.testing.assert_allclose(found, [0.8, 0.0, 0.05], atol=1e-12)
    after = updated(model, 2.1, then.motion, then.odometry_pose)
    assert after.moved is None


def test_wheels_that_stand_while_matches_show_a_motion_are_missed_for_as_long_as_that_lasts():
    model, wheels = driven(20)
    for k in range(3):
        assert model.predict(2.0 + 0.1 * k, wheels).is_missed
        model = updated(model, 2.0 + 0.1 * k, DRIVING, wheels)
    four = se2.exp(4.0 * se2.log(DRIVING.pose))
    then = model.predict(2.3, se2.compose(wheels, four))
    np.testing.assert_allclose(then.motion.pose, DRIVING.pose, atol=1e-9)


def test_wheels_that_stand_are_believed_where_nothing_matches_for_long_or_the_sensor_stood():
    model, wheels = driven(20)
    for k in range(2):
        prediction = model.predict(2.0 + 0.1 * k, wheels)
        assert prediction.is_missed
        model = model.updated_without_match(prediction, prediction.motion)
    back = model.predict(2.2, wheels)
    assert back.is_measured
    np.testing.assert_allclose(
        se2.compose(se2.exp(2.0 * se2.log(DRIVING.pose)), back.motion.pose), np.zeros(3), atol=1e-9
    )
    still, wheels = driven(20, UncertainPose(np.zeros(3), DRIVING.covariance))
    assert still.predict(2.0, wheels).is_measured
