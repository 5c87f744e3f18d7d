"""The filter: against chained motions, a hand-made Kalman filter, and the law that an open direction changes nothing."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan import se2
from curvescan.odometry.track import Track
from curvescan.se2.uncertain import UncertainPose, compose, identity

SURE = np.diag([1e6, 1e6, 1e7])


def start(speed=(0.5, 0.0, 0.2), sigma=0.1):
    return Track.at(identity(), identity(), np.asarray(speed), np.eye(3) * sigma**2)


def numeric_jacobian(function, x):
    """Central differences, with angles a long way from their seam."""
    return np.column_stack([(function(x + d) - function(x - d)) / 2e-6 for d in 1e-6 * np.eye(len(x))])


def test_a_move_is_the_composition_and_its_covariance_that_of_first_order():
    rng = np.random.default_rng(1)
    root = rng.normal(size=(9, 9)) * 0.1
    track = Track(
        keyframe=np.array([1.0, 2.0, 0.3]),
        here=np.array([0.4, -0.2, 0.5]),
        speed=np.array([0.5, 0.1, 0.3]),
        cov=root @ root.T,
    )

    def move(x):
        return np.concatenate([x[:3], se2.compose(x[3:6], 0.2 * x[6:]), x[6:]])

    moved = track.moved(0.2)
    state = np.concatenate([track.keyframe, track.here, track.speed])
    np.testing.assert_allclose(np.concatenate([moved.keyframe, moved.here, moved.speed]), move(state), atol=1e-12)
    jacobian = numeric_jacobian(move, state)
    jitter = np.diag([0.0] * 3 + [0.005**2] * 3 + [0.0] * 3)
    np.testing.assert_allclose(moved.cov, jacobian @ track.cov @ jacobian.T + jitter, atol=1e-8)


def test_a_new_keyframe_changes_neither_the_place_nor_what_is_known_of_it():
    track = start().moved(0.5).at_pose(np.array([0.2, 0.05, 0.1]), SURE)[0]
    renewed = track.with_keyframe()
    before, after = track.pose_map_scan, renewed.pose_map_scan
    np.testing.assert_allclose(after.pose, before.pose, atol=1e-12)
    np.testing.assert_allclose(after.cov, before.cov, atol=1e-15)
    np.testing.assert_array_equal(renewed.seen.cov, 0.0)


def test_chained_sure_matches_chain_their_covariances():
    motion, cov = np.array([0.3, 0.1, 0.2]), np.linalg.inv(SURE)
    track, chained = start(sigma=100.0), identity()
    for _ in range(4):
        track = track.accelerated(np.full(3, 1e4)).moved(1.0).at_pose(motion, SURE)[0].with_keyframe()
        chained = compose(chained, UncertainPose(motion, cov))
    np.testing.assert_allclose(track.pose_map_scan.pose, chained.pose, atol=1e-6)
    np.testing.assert_allclose(track.pose_map_scan.cov, chained.cov, rtol=1e-3, atol=1e-12)


def test_along_an_open_direction_the_motion_goes_on():
    track = start(speed=(0.5, 0.0, 0.0))
    for _ in range(10):
        track = track.moved(0.1).at_pose(np.array([9.0, 0.0, 0.0]), np.diag([0.0, 1e6, 1e7]))[0]
    assert track.here[0] == pytest.approx(0.5, abs=0.02)  # 0.5 m/s for a second, whatever the match says along it
    # and its error is that of the speed, all the way: 0.1 m/s for a second
    assert np.sqrt(track.seen.cov[0, 0]) == pytest.approx(0.1, rel=0.05)


def test_a_speed_that_is_seen_again_corrects_the_stretch_before():
    """A corridor that shows no motion for two seconds, the last of them from a new keyframe; then all is seen."""
    track = start(speed=(0.8, 0.0, 0.0), sigma=0.3)
    for k in range(20):
        track = track.accelerated(np.full(3, 1e-6)).moved(0.1)
        track = track.at_pose(track.here, np.diag([0.0, 1e6, 1e7]))[0]
        if k == 9:
            track = track.with_keyframe()
    vague = track.pose_map_scan
    track = track.with_keyframe()
    for k in range(1, 4):
        track = track.moved(0.1).at_pose(np.array([0.05 * k, 0.0, 0.0]), SURE)[0]
    # it drove 0.5 m/s and not 0.8: 1 m, and not 1.6 m
    assert vague.pose[0] == pytest.approx(1.6, abs=0.01)
    assert track.pose_map_scan.pose[0] == pytest.approx(1.15, abs=0.05)
    assert track.pose_map_scan.cov[0, 0] < 0.1 * vague.cov[0, 0]


def test_the_distance_of_a_measurement_is_mahalanobis():
    track = start().moved(1.0)
    pose, information = track.here + np.array([0.3, -0.1, 0.05]), np.diag([100.0, 50.0, 400.0])
    error = pose - track.here
    total = track.seen.cov + np.linalg.inv(information)
    assert track.at_pose(pose, information)[1] == pytest.approx(error @ np.linalg.solve(total, error))


def test_angles_meet_across_their_seam():
    track = Track.at(identity(), UncertainPose(np.array([0.0, 0.0, 3.1]), np.eye(3)), np.zeros(3), np.eye(3))
    found, distance = track.at_pose(np.array([0.0, 0.0, -3.1]), SURE)
    assert abs(abs(found.here[2]) - 3.1) < 1e-3
    assert distance < 0.1
