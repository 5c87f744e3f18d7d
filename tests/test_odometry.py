"""Odometry: the chain of matches, what it does when a match fails, and the run over a log."""

from __future__ import annotations

import math

import numpy as np
import pytest

import curvescan as cs
from curvescan.odometry import OdometryConfig, StepOutcome, run_odometry
from tests.scenes import room_scan

STEP = np.array([0.05, 0.02, 0.04])


def drive(n, sigma=0.003):
    """Scans and true poses of a sensor that repeats one motion in the room."""
    poses = [np.zeros(3)]
    for _ in range(n - 1):
        poses.append(cs.se2.compose(poses[-1], STEP))
    scans = [room_scan(p, sigma=sigma, seed=k, stamp=0.1 * k) for k, p in enumerate(poses)]
    return scans, np.array(poses)


def blank(stamp=0.0):
    return cs.LaserScan(
        np.full(361, np.nan), angle_min=-math.pi / 2, angle_increment=math.pi / 360, stamp=stamp
    )


def test_poses_are_the_chain_of_the_matches():
    scans, _ = drive(6)
    odometry = cs.Odometry()
    steps = [odometry.add(scan) for scan in scans]
    assert [s.index for s in steps] == list(range(6))
    assert steps[0].outcome is StepOutcome.STARTED
    assert steps[0].match is None
    np.testing.assert_array_equal(steps[0].pose, 0.0)
    np.testing.assert_array_equal(steps[0].covariance, 0.0)
    pose, cov = np.zeros(3), np.zeros((3, 3))
    motion = np.zeros(3)
    for before, after, step in zip(scans, scans[1:], steps[1:], strict=False):
        result = cs.match(before, after, guess=motion)
        motion = result.pose
        assert result.ok
        cov = cs.se2.compose_covariance(pose, cov, result.pose, result.covariance)
        pose = cs.se2.compose(pose, result.pose)
        np.testing.assert_allclose(step.pose, pose, atol=1e-12)
        np.testing.assert_allclose(step.covariance, cov, rtol=1e-9)
        assert step.outcome is StepOutcome.MATCHED


def test_a_failed_match_repeats_the_last_motion_and_says_so():
    scans, _ = drive(4)
    odometry = cs.Odometry()
    steps = [odometry.add(scan) for scan in [*scans[:3], blank(), scans[3]]]
    predicted, after = steps[3], steps[4]
    assert predicted.outcome is StepOutcome.PREDICTED
    assert predicted.match.outcome is cs.Outcome.NO_SEGMENTS
    motion = cs.se2.between(steps[1].pose, steps[2].pose)
    np.testing.assert_allclose(predicted.pose, cs.se2.compose(steps[2].pose, motion), atol=1e-12)
    assert (np.diag(predicted.covariance) > np.diag(steps[2].covariance)).all()
    # a covered sensor is no reference: the scan after it is matched with the one before it
    assert after.outcome is StepOutcome.MATCHED
    # the guess is the way since the scan before: the motion predicted for the covered one, and the next
    direct = cs.match(scans[2], scans[3], guess=cs.se2.compose(motion, motion))
    expected = cs.se2.compose(steps[2].pose, direct.pose)
    np.testing.assert_allclose(after.pose, expected, atol=1e-12)
    assert (np.diag(after.covariance) < np.diag(predicted.covariance)).all()


def other_room(pose, **kwargs):
    """A place with nothing in common with the room: a long wall without a corner."""
    angles = -0.7 + 0.005 * np.arange(281)
    return cs.LaserScan(
        (3.0 - pose[0]) / np.cos(angles), angle_min=-0.7, angle_increment=0.005, **kwargs
    )


def test_the_failed_scan_becomes_the_next_reference():
    scans, _ = drive(3)
    odometry = cs.Odometry(method="cfsma")  # which fails where nothing has corners
    for scan in [*scans[:2], other_room(STEP)]:
        step = odometry.add(scan)
    assert step.outcome is StepOutcome.PREDICTED
    assert odometry.add(scans[2]).outcome is StepOutcome.PREDICTED
    assert odometry.add(scans[2]).outcome is StepOutcome.MATCHED


def test_a_motion_is_not_repeated_for_ever():
    scans, _ = drive(3)
    odometry = cs.Odometry(config=OdometryConfig(max_predictions=2))
    for scan in scans:
        odometry.add(scan)
    steps = [odometry.add(blank()) for _ in range(4)]
    assert [s.outcome for s in steps] == [StepOutcome.PREDICTED] * 2 + [StepOutcome.HELD] * 2
    np.testing.assert_array_equal(steps[3].pose, steps[1].pose)
    assert (np.diag(steps[3].covariance) > np.diag(steps[2].covariance)).all()


def test_a_first_scan_without_readings_gives_way_to_the_first_with_some():
    scans, _ = drive(2)
    odometry = cs.Odometry()
    steps = [odometry.add(scan) for scan in [blank(), scans[0], scans[1]]]
    assert [s.outcome for s in steps] == [
        StepOutcome.STARTED,
        StepOutcome.PREDICTED,
        StepOutcome.MATCHED,
    ]


def test_a_run_collects_every_step():
    scans, truth = drive(12)
    seen = []
    run = run_odometry(scans, on_step=lambda step: seen.append(step.index))
    assert seen == list(range(12))
    assert len(run.trajectory) == len(run.outcomes) == run.seconds.size == run.n_matched.size == 12
    np.testing.assert_array_equal(run.trajectory.stamps, [s.stamp for s in scans])
    assert not run.is_partial
    assert run.n_matched[0] == 0
    assert (run.seconds > 0).all()
    # pairs by index are off by up to 2 cm and half a degree where the sensor moves on by 5 cm
    error = cs.se2.between(truth[-1], run.trajectory.poses[-1])
    assert np.hypot(*error[:2]) < 0.22
    assert abs(error[2]) < math.radians(11 * 0.5)


def test_a_run_repeats_to_the_bit():
    scans, _ = drive(8)
    first, second = run_odometry(scans), run_odometry(scans)
    np.testing.assert_array_equal(first.trajectory.poses, second.trajectory.poses)
    np.testing.assert_array_equal(first.trajectory.covariances, second.trajectory.covariances)


def test_a_run_counts_failures_by_reason():
    scans, _ = drive(4)
    run = run_odometry([*scans, blank(), blank()])
    assert run.failures == {cs.Outcome.NO_SEGMENTS: 2}


def test_an_interrupt_keeps_what_there_is():
    scans, _ = drive(6)

    def interrupted():
        yield from scans[:4]
        raise KeyboardInterrupt

    run = run_odometry(interrupted())
    assert run.is_partial
    assert len(run.trajectory) == len(run.outcomes) == 4


def test_no_scans_give_an_empty_run():
    run = run_odometry([])
    assert len(run.trajectory) == 0
    assert run.trajectory.covariances.shape == (0, 3, 3)


def test_wrong_arguments_are_named():
    with pytest.raises(cs.InvalidArgumentError, match="unknown method 'slam'"):
        cs.Odometry(method="slam")
    with pytest.raises(cs.InvalidArgumentError, match="scan must be a LaserScan"):
        cs.Odometry().add(np.ones(3))
    with pytest.raises(cs.InvalidArgumentError, match="prediction_sigma_m must be > 0, got 0"):
        OdometryConfig(prediction_sigma_m=0)
    with pytest.raises(cs.InvalidArgumentError, match="max_predictions must be >= 0, got -1"):
        OdometryConfig(max_predictions=-1)


def test_the_first_scan_has_no_match_that_could_fail():
    scans, _ = drive(3)
    run = run_odometry([*scans, blank()])
    assert run.is_failed.tolist() == [False, False, False, True]
    assert run.is_matched.tolist() == [False, True, True, False]
    assert run_odometry([]).is_failed.size == 0
