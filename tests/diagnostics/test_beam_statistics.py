"""Stale beams and beams on the robot: made ones are found, noise and standing sensors are not taken for them."""

from __future__ import annotations

import math

import numpy as np
import pytest

from curvescan import LaserScan
from curvescan.diagnostics.statistics import BeamStatistics

N_BEAMS = 180


def statistics(rows, *, range_max=30.0):
    counters = BeamStatistics()
    for row in rows:
        counters.add(LaserScan(row, angle_min=0.0, angle_increment=0.01, range_min=0.05, range_max=range_max))
    return counters


def moving(n=100, *, noise=0.01, digits=4, seed=0):
    """Return sweeps of a sensor that drives past things: readings that drift, with noise, rounded."""
    rng = np.random.default_rng(seed)
    drift = np.cumsum(rng.normal(0.0, 0.3, (n, N_BEAMS)), axis=0)
    rows = 6.0 + 3.0 * np.sin(np.arange(N_BEAMS) / 20.0) + drift + noise * rng.normal(size=(n, 1))
    return np.round(np.abs(rows) + 0.2, digits)


@pytest.mark.parametrize("share", [0.15, 0.35])
@pytest.mark.parametrize("digits", [2, 3, 6])
def test_bins_that_keep_old_values_are_counted(share, digits):
    rows = moving(digits=digits)
    variance_retained = np.random.default_rng(1).random(rows.shape) < share
    for k in range(1, len(rows)):
        rows[k] = np.where(variance_retained[k], rows[k - 1], rows[k])
    # 100 sweeps of 180 beams: 0.3 % of standard error, and what rounds to the same value
    assert statistics(rows).stale_share == pytest.approx(share, abs=0.02)


@pytest.mark.parametrize("digits", [2, 3, 6])
def test_noise_that_is_rounded_is_not_stale(digits):
    assert statistics(moving(digits=digits)).stale_share < 0.02


@pytest.mark.parametrize("noise", [0.0, 0.004, 0.02])
def test_a_sensor_that_stands_tells_nothing_of_stale_beams(noise):
    rng = np.random.default_rng(2)
    rows = np.round(4.0 + noise * rng.normal(size=(60, N_BEAMS)), 2)
    assert math.isnan(statistics(rows).stale_share)


def test_beams_on_the_robot_are_found_while_it_moves():
    rows = moving()
    rng = np.random.default_rng(3)
    for beams, distance in ((slice(4, 12), 0.3), (slice(170, 180), 0.5)):
        body = distance + 0.005 * rng.normal(size=rows[:, beams].shape)
        rows[:, beams] = body
    rows[:, :4] = np.nan
    assert statistics(rows[:99]).fixed_beams is None  # beams keep their reading by chance in a short drive
    counters = statistics(rows)
    assert counters.fixed_beams == (((4, 11), (170, 179)), N_BEAMS)
    assert counters.n_blind == 4


def test_beams_that_a_laser_does_not_fire_are_found_between_those_that_read():
    rows = moving()
    rows[:, 1::3] = np.nan
    rows[:, 40:60] = np.nan  # a blind sector, as behind a mast
    rows[:, 80] = np.nan
    assert statistics(rows[:99]).empty_beams is None  # a dark thing may hide some in a short drive
    found = statistics(rows).empty_beams
    assert found.runs[:3] == ((1, 1), (4, 4), (7, 7))
    assert not any(first <= 60 and last >= 40 for first, last in found.runs)
    rows[50, 1::3] = 4.0  # a laser that reads there once fires there
    assert statistics(rows).empty_beams is None
    few = moving()
    few[:, 5::17] = np.nan
    assert statistics(few).empty_beams is None


def test_scans_without_beams_that_are_not_fired_are_those_of_the_laser():
    rows = moving()
    rows[:, 1::2] = np.nan
    empty = statistics(rows).empty_beams
    scan = LaserScan(
        rows[3], angle_min=-0.9, angle_increment=0.01, stamp=2.0, time_increment=0.001, intensities=np.arange(N_BEAMS)
    )
    kept = empty.without(scan)
    # the last beam stays, as nothing reads beyond it
    np.testing.assert_array_equal(kept.ranges, [*rows[3, ::2], np.nan])
    np.testing.assert_allclose(kept.angles, [*scan.angles[::2], scan.angles[-1]])
    np.testing.assert_array_equal(kept.intensities[:3], [0.0, 2.0, 4.0])
    assert kept.time_increment * (len(kept) - 1) == pytest.approx(scan.time_increment * (len(scan) - 1))
    assert kept.stamp == scan.stamp
    short = LaserScan(rows[3, :90], angle_min=0.0, angle_increment=0.01)
    assert empty.without(short) is short


def test_walls_and_bodies_of_a_standing_sensor_are_no_robot():
    rng = np.random.default_rng(4)
    rows = 1.0 + 0.005 * rng.normal(size=(100, N_BEAMS))
    assert statistics(rows).fixed_beams is None
    # half of the beams look over a street, where everything moves
    rows[:, 90:] = moving()[:, 90:]
    assert statistics(rows).fixed_beams is None


def test_a_wall_that_follows_at_a_distance_is_no_robot():
    rows = moving()
    rows[:, 10:14] = 5.0
    assert statistics(rows).fixed_beams is None


def test_a_wall_that_is_passed_straight_on_is_no_robot():
    rows = moving()
    angles = np.linspace(-0.5, 0.5, 40)
    rows[:, 60:100] = 1.0 / np.cos(angles) + np.linspace(-0.05, 0.05, len(rows))[:, np.newaxis] * np.abs(angles)
    fixed = rows[:, 60:100].std(axis=0) < 0.03
    assert fixed.sum() > 20
    assert statistics(rows).fixed_beams is not None  # so far the room begins at once beside it, as beside a robot
    rows[:, [57, 58, 59, 100, 101, 102]] = 1.3 + np.linspace(-0.1, 0.1, len(rows))[:, np.newaxis]
    assert statistics(rows).fixed_beams is None


def test_readings_of_any_size_and_sweeps_without_beams():
    rows = moving()
    rows[5] = 1e200
    statistics(rows, range_max=math.inf)
    nothing = statistics([np.empty(0)] * 3)
    assert (nothing.fixed_beams, nothing.empty_beams, nothing.n_blind) == (None, None, 0)
    assert statistics([np.empty(0)] * 200).empty_beams is None
    assert math.isnan(nothing.stale_share)
    assert BeamStatistics().fixed_beams is None
