"""Frames: corners at several arm lengths, and physical ends of surfaces."""

from __future__ import annotations

import math

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.config import KeypointsConfig
from curvescan.matchers.curvescan.features.keypoints import arm_direction
from curvescan.matchers.curvescan.features.surfels import moments
from tests.matchers.curvescan.scenes import features, pillar_scan, turned
from tests.scenes import ROOM, room_scan

CORNERS = [(ROOM[2], ROOM[1]), (ROOM[2], ROOM[3])]


def test_the_corners_of_a_room_are_found_with_their_turn():
    keypoints = features(room_scan()).landmarks.keypoints
    for x, y in CORNERS:
        at = np.hypot(keypoints[:, 0] - x, keypoints[:, 1] - y) < 0.02
        assert at.any()
        # seen from inside, counter-clockwise, the wall turns left by a right angle
        np.testing.assert_allclose(keypoints[at, 3], math.pi / 2, atol=0.05)
    is_wide = (keypoints[:, 4] == 2) & (np.abs(keypoints[:, 0] - 3.0) < 0.02)
    np.testing.assert_allclose(np.sort(keypoints[is_wide, 2]), [math.pi / 4, 3 * math.pi / 4], atol=0.03)


def test_a_bare_wall_under_noise_has_no_corner():
    angles = -0.7 + 0.005 * np.arange(281)
    for seed in range(20):
        noise = 0.01 * np.random.default_rng(seed).standard_normal(281)
        scan = cs.LaserScan(1.0 / np.cos(angles) + noise, angle_min=-0.7, angle_increment=0.005)
        assert np.count_nonzero(features(scan).landmarks.keypoints[:, 4] < 10) <= 2


@pytest.mark.parametrize("angle", [0.5, 2.0, -3.0])
def test_frames_turn_with_the_sensor_frame(angle):
    scan = pillar_scan(seed=1)
    plain, moved = features(scan).landmarks.keypoints, features(turned(scan, angle)).landmarks.keypoints
    np.testing.assert_allclose(cs.se2.transform([0.0, 0.0, angle], plain[:, :2]), moved[:, :2], atol=1e-9)
    np.testing.assert_allclose(cs.se2.wrap(moved[:, 2] - plain[:, 2] - angle), 0.0, atol=1e-9)
    np.testing.assert_allclose(moved[:, 3:], plain[:, 3:], atol=1e-9)


def test_ends_are_those_of_near_surfaces_and_not_of_shadows():
    # a board 2 m ahead, from y = -0.5 to 0.5, before a wall 4 m ahead
    angles = -0.6 + 0.005 * np.arange(241)
    ranges = np.where(np.abs(2.0 * np.tan(angles)) < 0.5, 2.0, 4.0) / np.cos(angles)
    keypoints = features(cs.LaserScan(ranges, angle_min=-0.6, angle_increment=0.005)).landmarks.keypoints
    ends = keypoints[keypoints[:, 4] >= 10]
    np.testing.assert_allclose(ends[:, 0], 2.0, atol=1e-9)
    np.testing.assert_allclose(np.sort(ends[:, 1]), [-0.5, 0.5], atol=0.02)
    # the first end begins the surface, the other closes it; both point along the sweep
    assert ends[np.argsort(ends[:, 1]), 4].tolist() == [10, 20]
    np.testing.assert_allclose(ends[:, 2], math.pi / 2, atol=1e-6)


def test_the_direction_of_an_arm_points_along_it():
    points = np.column_stack([np.arange(10.0), 2.0 * np.arange(10.0)])
    sums = moments(np.column_stack([points, np.hypot(*points.T)]))
    for sign in (1.0, -1.0):
        direction = arm_direction(sums, 2, 8, sign, sign)
        np.testing.assert_allclose(direction, sign * np.array([1.0, 2.0]) / math.sqrt(5.0))
    np.testing.assert_allclose(arm_direction(sums, 2, 3, 3.0, 4.0), [0.6, 0.8])


def test_no_more_frames_than_asked_for():
    from curvescan.matchers.curvescan.config import CurvescanConfig

    config = CurvescanConfig(keypoints=KeypointsConfig(max_keypoints=3))
    keypoints = features(pillar_scan(), config).landmarks.keypoints
    assert np.count_nonzero(keypoints[:, 4] < 10) <= 3
    assert np.count_nonzero(keypoints[:, 4] >= 10) <= 3
    for wrong in ({"arms": ()}, {"min_turn": 4.0}, {"max_keypoints": 0}):
        with pytest.raises(cs.InvalidArgumentError, match=next(iter(wrong))):
            KeypointsConfig(**wrong)
