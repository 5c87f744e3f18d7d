"""BaseMotion: what the steps of a laser's odometry mean for the base that it is mounted on."""

from dataclasses import replace

import numpy as np
import pytest

from curvescan import se2
from curvescan.live.base_motion import BaseMotion
from curvescan.odometry import Step, StepOutcome


def test_base_and_laser_agree():
    """A base that turns on the spot, a laser ahead of it: the laser moves sideways, the base does not."""
    mount = np.array([0.5, 0.0, np.pi / 2])
    motion, covariance = BaseMotion(mount), np.eye(3) * 1e-4
    before = np.zeros(3)
    for k in range(11):
        base = np.array([0.0, 0.0, 0.1 * k])
        laser_in_world = se2.compose(base, mount)
        pose = se2.between(mount, laser_in_world)  # frame of the first scan
        moved = se2.between(before, pose)
        state = motion.add(step_of(pose, covariance, moved), 0.1 * k)
        before = pose
    assert state.odom_base.pose == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert state.twist == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert state.map_odom == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


def test_a_leap_of_the_odometry_is_none_of_odom():
    """Ten steps of 0.1 m, at the last of which the odometry finds that it has drifted by half a metre."""
    motion, covariance = BaseMotion(np.zeros(3)), np.eye(3) * 1e-4
    for k in range(11):
        pose = np.array([0.1 * k - 0.5 * (k == 10), 0.0, 0.0])
        moved = np.array([0.1 * (k > 0), 0.0, 0.0])
        state = motion.add(step_of(pose, covariance, moved), 0.1 * k)
    assert state.odom_base.pose == pytest.approx([1.0, 0.0, 0.0])
    assert state.odom_base.covariance[0, 0] == pytest.approx(0.25 + 1e-4)
    assert state.twist == pytest.approx([1.0, 0.0, 0.0])
    assert state.map_odom == pytest.approx([-0.5, 0.0, 0.0])


def test_map_odom_waits_until_the_laser_has_been_found():
    motion, covariance = BaseMotion(np.zeros(3)), np.eye(3) * 1e-4
    unknown = replace(step_of(np.zeros(3), covariance, np.zeros(3)), pose=np.full(3, np.nan))
    state = motion.add(unknown, 0.0)
    assert state.map_odom is None
    assert np.isfinite(state.odom_base.covariance).all()
    found = motion.add(step_of(np.array([2.0, 1.0, 0.0]), covariance, np.zeros(3)), 0.1)
    assert found.map_odom == pytest.approx([2.0, 1.0, 0.0])
    assert motion.add(unknown, 0.2).map_odom == pytest.approx([2.0, 1.0, 0.0])


def step_of(pose, covariance, moved):
    return Step(
        index=0,
        stamp=0.0,
        pose=pose,
        covariance=covariance,
        pose_odom=pose,
        covariance_odom=covariance,
        motion=moved,
        motion_covariance=covariance,
        seconds=0.0,
        outcome=StepOutcome.MATCHED,
        match=None,
        reference=None,
    )
