"""TopOfRange: codes for no reading that a log does not declare, at any range, and real surfaces that are none."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan import read_log, simulate
from curvescan.diagnostics.top_of_range import Ring, TopOfRange, is_of_walls
from curvescan.io.arrays.memory import MemoryLog
from curvescan.scan import LaserScan


def counted(rows):
    top = TopOfRange()
    for row in rows:
        top.add(scan_of(row))
    return top


def scan_of(row):
    return LaserScan(row, angle_min=-1.57, angle_increment=0.0174, range_max=80.0)


def moving_sensor(n_scans=200, n_beams=180, seed=4):
    return np.random.default_rng(seed).uniform(1.0, 30.0, (n_scans, n_beams))


def test_several_codes_just_below_the_limit_are_one_band():
    rng = np.random.default_rng(5)
    rows = moving_sensor()
    is_code = rng.random(rows.shape) < 0.006
    rows[is_code] = rng.choice([51.05, 51.10, 51.16], is_code.sum())
    rows[3, 7] = 60.0  # one stray above hides nothing
    low, high, share = counted(rows).code_band()
    assert 50.9 < low <= 51.05
    assert 51.16 <= high < 51.3
    assert share == pytest.approx(is_code.mean(), rel=0.02)


def test_a_log_without_codes_has_no_band():
    assert counted(moving_sensor()).code_band() is None
    assert TopOfRange().code_band() is None


def test_the_far_end_of_a_corridor_seen_by_a_standing_sensor_is_no_code():
    rng = np.random.default_rng(6)
    rows = np.tile(rng.uniform(1.0, 4.0, 180), (200, 1))
    rows[:, 80:100] = 25.0
    rows += 0.01 * rng.standard_normal(rows.shape)
    assert counted(rows).code_band() is None


@pytest.mark.parametrize("noise", [0.01, 0.05])
def test_a_wall_that_a_turning_sensor_sees_with_all_its_beams_is_no_code(noise):
    """A sensor that turns on the spot, 6 m from a wall: each beam has it at 6 m and a little more."""
    rng, turns = np.random.default_rng(3), np.radians(np.arange(0, 360, 3.0))
    bearing = turns[:, np.newaxis] - 1.57 + 0.0174 * np.arange(180)
    wall = 6.0 / np.maximum(np.cos(bearing), 1e-9)
    rest = rng.uniform(1.0, 5.0, wall.shape)
    rows = np.where(wall < 6.3, wall + noise * rng.standard_normal(wall.shape), rest)
    code = np.where(wall < 6.3, 6.1, rest)
    jitter = code + 0.05 * rng.standard_normal(code.shape)
    for seen, is_wall in ((rows, True), (code, False), (jitter, False)):
        log = MemoryLog(scans=tuple(scan_of(row) for row in seen))
        assert is_of_walls(log, (5.9, 6.3)) is is_wall
    assert not is_of_walls(MemoryLog(scans=()), (5.9, 6.3))


def test_fewer_than_two_in_a_thousand_are_left_alone():
    rows = moving_sensor()
    rows.ravel()[::600] = 51.1
    assert counted(rows).code_band() is None


def ring_of(rows):
    return counted(rows).ring()


@pytest.mark.parametrize(("value", "jitter", "share"), [(2.0, 0.0, 0.05), (7.0, 0.5, 0.1), (12.0, 1.0, 0.3)])
def test_codes_at_any_range_are_a_ring(value, jitter, share):
    rng = np.random.default_rng(7)
    rows = moving_sensor()
    is_code = rng.random(rows.shape) < share
    rows[is_code] = value + jitter * (rng.random(is_code.sum()) - 0.5)
    ring = ring_of(rows)
    assert ring.low <= value - 0.4 * jitter
    assert value + 0.4 * jitter <= ring.high
    assert ring.high - ring.low < jitter + 0.3
    assert ring.share == pytest.approx(share, abs=0.05)
    left_out = [np.isnan(ring.without(scan_of(row)).ranges) for row in rows]
    assert np.mean(np.array(left_out)[is_code]) > 0.8
    assert np.mean(np.array(left_out)[~is_code]) < 0.1


def test_what_a_moving_sensor_sees_is_no_ring():
    for world in ("room", "bare-corridor", "round-room", "curved-hall", "clutter", "office", "building"):
        for sensor in ("sick-lms200", "spinning-360", "urg-04lx"):
            log = simulate(world, sensor=sensor, n_scans=100, seed=3)
            top = TopOfRange()
            for scan in log:
                top.add(scan)
            assert top.ring() is None, (world, sensor)


def test_a_turning_sensor_in_the_middle_of_a_round_room_sees_the_room():
    rng = np.random.default_rng(8)
    assert ring_of(3.0 + 0.01 * rng.standard_normal((200, 180))) is None
    assert TopOfRange().ring() is None


def test_a_scan_without_a_code_is_the_same_object():
    ring = Ring(2.0, 2.5, 0.1, is_loose=True)
    assert ring.without(wall := scan_of(np.full(180, 2.2))) is wall  # neighbours join: a surface
    lone = np.full(180, 4.0)
    lone[90] = 2.2
    np.testing.assert_array_equal(np.flatnonzero(np.isnan(ring.without(scan_of(lone)).ranges)), [90])
    assert ring.without(far := scan_of(np.full(180, 4.0))) is far


@pytest.mark.parametrize(
    "name",
    [
        "intel-lab/intel.clf.gz",
        "aces/aces.clf.gz",
        "ccny-handheld-hokuyo/demo.bag",
        "ual-campus-sick/ual-campus.clf.gz",
        "mumble-rplidar-a1/slow_half_hallway",
        "mines-urg04/exp1.dat.gz",
    ],
)
def test_real_logs_have_no_ring(real_data, name):
    top = TopOfRange()
    for k, scan in enumerate(read_log(real_data / name)):
        top.add(scan)
        if k in (99, 999):
            assert top.ring() is None
    assert top.ring() is None
