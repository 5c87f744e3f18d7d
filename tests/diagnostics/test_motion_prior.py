"""What a log tells of the motion from scan to scan: wheels first, a gyroscope else, its unit and sense checked."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

import curvescan as cs
from curvescan.diagnostics.motion_prior import motion_prior
from tests.scenes import room_scan

TURNS = np.cumsum([0.0] + [0.03 + 0.12 * (k % 3) for k in range(29)])


class GyroOnly:
    """A log of a room seen on the turn, with a gyroscope and no wheels."""

    def __init__(self, scale=1.0, n_known=30):
        self.name, self.odometry = "gyro.mcap", None
        self._turned = scale * np.where(np.arange(30) < n_known, TURNS, math.nan)

    def __iter__(self):
        return (room_scan((0.3, 0.2, t), stamp=0.1 * k) for k, t in enumerate(TURNS))

    def __len__(self):
        return 30

    def turned_by_gyro(self):
        return self._turned


def test_wheels_come_first():
    log = cs.simulate("office", n_scans=3)
    assert motion_prior(log) is log.odometry.poses


@pytest.mark.parametrize("scale", [1.0, 180.0 / math.pi])
def test_a_gyroscope_tells_the_turn_in_radians_whatever_its_unit(scale):
    prior = motion_prior(GyroOnly(scale))
    assert prior.shape == (30, 3)
    assert np.isnan(prior[:, :2]).all()
    np.testing.assert_allclose(prior[:, 2], TURNS)


class Blind(GyroOnly):
    """The same in the dark."""

    def __iter__(self):
        return (dataclasses.replace(s, ranges=np.zeros(len(s))) for s in super().__iter__())


def test_faster_than_any_robot_is_in_degrees_though_the_scans_do_not_tell():
    np.testing.assert_allclose(motion_prior(Blind(180.0 / math.pi))[:, 2], TURNS)


def test_a_gyroscope_that_turns_the_other_way_is_told_with_the_remedy():
    with pytest.raises(cs.InvalidArgumentError, match=r"turns against its scans in .* clockwise=True"):
        motion_prior(GyroOnly(-1.0))


def test_where_the_gyroscope_is_silent_the_prior_is():
    assert np.isnan(motion_prior(GyroOnly(n_known=20))[20:, 2]).all()


def test_a_log_with_neither_says_so():
    log = cs.log_from_arrays([(0.0, [1.0, 2.0])], angle_min=0.0, angle_increment=0.1)
    with pytest.raises(cs.InvalidArgumentError, match="neither wheel odometry nor a gyroscope"):
        motion_prior(log)
