"""The gyroscope of a bag: by how much it has turned at each scan."""

from __future__ import annotations

import math

import numpy as np
import pytest

from curvescan.io import read_log
from curvescan.io.ros.reader import RosbagLog
from tests.bags import KINDS, SECOND, imu, scan, write_bag


def at(seconds):
    return int(seconds * SECOND)


@pytest.mark.parametrize("kind", KINDS)
def test_the_angle_is_the_rate_over_time(tmp_path, kind):
    # 0.5 rad/s for a second, then 2 rad/s the other way; the first and the last scan are not covered
    entries = [scan(at(t)) for t in (0.5, 1.25, 2.0, 2.75, 3.5)]
    entries += [imu(at(1.0 + 0.125 * k), 0.5 if k < 8 else -2.0) for k in range(17)]
    log = RosbagLog(write_bag(tmp_path / "bag", kind, sorted(entries, key=lambda e: e[2])))
    turned = log.turned_by_gyro()
    assert np.isnan(turned[[0, 4]]).all()
    # between 1.875 s and 2 s the rate passes from one to the other
    expected = 0.5 * (0.875 - 0.25) + 0.125 * -0.75
    assert turned[2] - turned[1] == pytest.approx(expected)
    assert turned[3] - turned[2] == pytest.approx(-2.0 * 0.75)


def test_of_several_the_one_with_most_messages_is_read(tmp_path):
    entries = [scan(at(1.0)), scan(at(2.0))]
    entries += [imu(at(0.5 * k), 9.0, topic="/rare") for k in range(5)]
    entries += [imu(at(0.25 * k), 0.5, topic="/often") for k in range(10)]
    log = RosbagLog(write_bag(tmp_path / "bag", "mcap", sorted(entries, key=lambda e: e[2])))
    assert np.diff(log.turned_by_gyro()) == pytest.approx([0.5])


def test_rates_that_are_none_and_stamps_that_repeat_are_left_out(tmp_path):
    entries = [scan(at(1.0)), scan(at(2.0))]
    for k in range(10):
        entries += [imu(at(0.25 * k), 0.5), imu(at(0.25 * k), 0.5), imu(at(0.25 * k), math.nan)]
    log = RosbagLog(write_bag(tmp_path / "bag", "mcap", sorted(entries, key=lambda e: e[2])))
    assert np.diff(log.turned_by_gyro()) == pytest.approx([0.5])


def test_a_bag_without_a_gyroscope_has_none(tmp_path):
    path = write_bag(tmp_path / "bag", "mcap", [scan(1), scan(2)])
    assert RosbagLog(path).turned_by_gyro() is None
    lone = write_bag(tmp_path / "lone", "mcap", [scan(1), imu(1, 1.0), scan(2)])
    assert RosbagLog(lone).turned_by_gyro() is None


def test_a_log_as_its_user_set_it_up_keeps_its_gyroscope(tmp_path):
    entries = [scan(at(1.0)), scan(at(2.0)), *(imu(at(0.5 * k), 1.0) for k in range(6))]
    path = write_bag(tmp_path / "bag", "mcap", sorted(entries, key=lambda e: e[2]))
    mirrored = read_log(path, clockwise=True)
    np.testing.assert_array_equal(mirrored.turned_by_gyro(), read_log(path).turned_by_gyro())
