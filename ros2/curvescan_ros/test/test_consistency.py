"""What the node says of its own errors, on drives whose truth is known; and wheels where the laser sees nothing to hold on to."""

import itertools
from dataclasses import replace

import numpy as np
import pytest

pytest.importorskip("rclpy", reason="ROS 2 is not installed")

from conftest import save_scans
from curvescan import se2, simulate
from curvescan.simulation import SENSORS

PLANAR = np.ix_((0, 1, 5), (0, 1, 5))


def pose_of(message):
    position, rotation = message.pose.pose.position, message.pose.pose.orientation
    return np.array([position.x, position.y, 2.0 * np.arctan2(rotation.z, rotation.w)])


def nees(error, covariance):
    return float(error @ np.linalg.solve(np.reshape(covariance, (6, 6))[PLANAR], error))


def test_twist_and_pose_are_consistent(bench, tmp_path, record_property):
    """A laser that takes all of 0.1 s for its sweep: twist and pose are those of the middle of it."""
    period = SENSORS["spinning-360"].period
    sensor = replace(SENSORS["spinning-360"], time_increment=period / 360)
    log = simulate("office-floor", sensor=sensor, n_scans=300, seed=1)
    made = bench()
    made.play(save_scans(tmp_path / "drive.npz", log), 40.0)
    assert len(made.odom) == len(log)
    first = log.truth.poses
    half = 0.5 * (359 / 360)
    truth = [se2.compose(a, se2.exp(half * se2.log(se2.between(a, b)))) for a, b in itertools.pairwise(first)]
    of_twist, of_pose = [], []
    for k in range(1, len(truth)):
        message, linear = made.odom[k], made.odom[k].twist.twist.linear
        twist = np.array([linear.x, linear.y, message.twist.twist.angular.z])
        error = twist - se2.log(se2.between(truth[k - 1], truth[k])) / period
        of_twist.append(nees(error, message.twist.covariance))
        error = pose_of(message) - se2.between(truth[0], truth[k])
        error[2] = se2.wrap(error[2])
        of_pose.append(nees(error, message.pose.covariance))
    record_property("NEES", f"twist {np.mean(of_twist):.2f}, pose {np.mean(of_pose):.2f}")
    # 3 where covariances are right; poses along one drive are correlated
    assert 1.5 < np.mean(of_twist) < 4.5
    assert 0.5 < np.mean(of_pose) < 8.0


def test_wheels_carry_the_robot_along_a_bare_corridor(bench, tmp_path):
    log = simulate("bare-corridor", sensor="spinning-360", n_scans=120, seed=0)
    path = save_scans(tmp_path / "corridor.npz", log, log.odometry.poses)
    errors = {}
    for use_odom_prior in (False, True):
        made = bench(use_odom_prior=use_odom_prior)
        made.play(path, 20.0)
        assert len(made.odom) == len(log)
        end = se2.between(log.truth.poses[0], log.truth.poses[-1])
        errors[use_odom_prior] = np.hypot(*(pose_of(made.odom[-1]) - end)[:2])
    wheels = np.hypot(*(log.odometry.poses[-1] - end)[:2])
    assert errors[True] < max(0.3, 1.5 * wheels)
    assert errors[False] > 3.0 * errors[True]
