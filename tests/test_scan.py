"""LaserScan: the scan model, and that a sensor's way of turning does not matter."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from curvescan import InvalidArgumentError, LaserScan, UnitWarning
from curvescan.scan import mirrored, swept_backwards, valid_readings


def make(ranges, **kwargs):
    options = {"angle_min": -0.5, "angle_increment": 0.1, "range_min": 0.1, "range_max": 8.0}
    return LaserScan(ranges, **(options | kwargs))


def test_a_reading_is_valid_inside_the_closed_range_only():
    ranges = [math.nan, math.inf, -math.inf, 0.0, -1.0, 0.0999, 0.1, 4.0, 8.0, 8.0001, 9.0, 81.91]
    assert make(ranges).valid.tolist() == [False] * 6 + [True] * 3 + [False] * 3


def test_without_limits_zero_and_infinity_are_still_no_readings():
    scan = make([0.0, -0.0, 1e-9, 1e3, math.inf], range_min=0.0, range_max=math.inf)
    assert scan.valid.tolist() == [False, False, True, True, False]


def test_what_lies_beyond_ten_kilometres_is_a_code_and_no_reading():
    scan = make([1e4, 10_000.1, 1e9, 3.4028235e38, 1.7e308], range_max=math.inf)
    assert scan.valid.tolist() == [True, False, False, False, False]


def test_points_lie_on_their_beams():
    scan = make([1.0, 2.0, math.nan], angle_min=0.0, angle_increment=math.pi / 2)
    np.testing.assert_allclose(scan.points, [[1, 0], [0, 2], [math.nan] * 2], atol=1e-15)
    np.testing.assert_allclose(scan.angles, [0, math.pi / 2, math.pi])


@given(
    st.lists(st.floats(allow_nan=True, allow_infinity=True, width=32), max_size=40),
    st.floats(-4, 4),
    st.floats(1e-3, 0.2),
)
def test_a_clockwise_scan_gives_the_readings_of_its_mirror_image(ranges, angle_min, increment):
    clockwise = make(ranges, angle_min=angle_min, angle_increment=-increment)
    mirrored = make(ranges[::-1], angle_min=angle_min - increment * max(len(ranges) - 1, 0), angle_increment=increment)
    a, b = valid_readings(clockwise), valid_readings(mirrored)
    np.testing.assert_array_equal(a.ranges, b.ranges)
    np.testing.assert_array_equal(a.beam_idx, len(ranges) - 1 - b.beam_idx)
    np.testing.assert_allclose(a.angles, b.angles, atol=1e-12)
    np.testing.assert_allclose(a.points, b.points, atol=1e-10)
    assert (np.diff(a.angles) > 0).all()


@pytest.mark.parametrize(("n", "closed"), [(358, False), (359, True), (360, True), (361, True)])
def test_a_full_circle_is_known_by_its_beams(n, closed):
    increment = math.radians(1.0)
    for sign in (1, -1):
        scan = make(np.ones(n), angle_increment=sign * increment)
        assert scan.is_full_circle is closed


def test_ranges_are_copied_and_read_only():
    source = np.ones(4)
    scan = make(source)
    source[0] = 5.0
    assert scan.ranges[0] == 1.0
    with pytest.raises(ValueError, match="read-only"):
        scan.ranges[0] = 2.0


def test_nothing_valid_is_no_error():
    for ranges in ([], [math.nan], [81.91] * 5):
        scan = make(ranges)
        assert len(valid_readings(scan)) == 0
        assert "0 valid" in repr(scan)


def told(angles, ranges=None, **kwargs):
    """A scan whose beams are told one by one."""
    ranges = np.ones(len(angles)) if ranges is None else ranges
    return LaserScan(ranges, angles=angles, range_min=0.1, range_max=8.0, **kwargs)


def test_beams_told_one_by_one_are_where_they_are_said_to_be():
    angles = np.array([0.1, 0.2, 0.5, 0.6, 0.72])
    for way in (1, -1):
        scan = told(way * angles, [1.0, 2.0, math.nan, 3.0, 4.0])
        np.testing.assert_array_equal(scan.angles, way * angles)
        np.testing.assert_allclose(scan.directions[:, 1], np.sin(way * angles))
        np.testing.assert_allclose(scan.points[1], 2.0 * scan.directions[1])
        assert (scan.angle_min, scan.has_uniform_angles) == (way * 0.1, False)
        assert scan.angle_increment == pytest.approx(way * 0.11)
        assert scan.mean_increment == pytest.approx(way * 0.155)
        readings = valid_readings(scan)
        assert readings.beam_idx.tolist() == [0, 1, 3, 4][::way]
        assert (np.diff(readings.angles) > 0).all()


def test_even_beams_told_one_by_one_are_even():
    scan = make(np.ones(50))
    rng = np.random.default_rng(0)
    same = told(scan.angles + rng.uniform(-4e-4, 4e-4, 50))  # printed with few digits, say
    assert same.has_uniform_angles
    assert same.angle_increment == pytest.approx(0.1, abs=2e-5)
    assert not told(scan.angles + rng.uniform(-5e-3, 5e-3, 50)).has_uniform_angles


def test_a_jump_by_a_turn_is_undone():
    angles = np.radians([170.0, 175.0, 180.0, -174.0, -170.0])
    scan = told(angles)
    np.testing.assert_allclose(np.degrees(scan.angles), [170, 175, 180, 186, 190])
    np.testing.assert_allclose(scan.directions[3], [math.cos(angles[3]), math.sin(angles[3])])


@pytest.mark.parametrize(("span_deg", "closed"), [(355, False), (358, True), (362, True)])
def test_uneven_beams_close_the_circle_too(span_deg, closed):
    angles = np.radians(np.linspace(0, span_deg, 361) + 0.2 * np.sin(np.arange(361)))
    assert told(angles).is_full_circle is closed
    assert told(-angles).is_full_circle is closed


def test_a_changed_copy_keeps_the_beams():
    for scan in (make(np.ones(5)), told([0.1, 0.2, 0.5, 0.6, 0.7], time_increment=0.01)):
        copy = replace(scan, ranges=np.full(5, 2.0), stamp=3.0)
        np.testing.assert_array_equal(copy.angles, scan.angles)
        assert copy.has_uniform_angles is scan.has_uniform_angles
        assert (copy.stamp, copy.time_increment) == (3.0, scan.time_increment)


def test_sweeps_of_one_beam_or_none_may_be_told_too():
    assert told([]).is_full_circle is False
    assert told([0.3]).points.tolist() == [[math.cos(0.3), math.sin(0.3)]]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({}, "directions of the beams are missing"),
        ({"angle_min": 0.0}, "directions of the beams are missing"),
        ({"angles": [0.0, 0.1], "angle_min": 0.0}, "contradict"),
        ({"angles": [0.0, 0.1], "angle_min": 0.0, "angle_increment": 0.2}, "contradict"),
        ({"angles": [0.0]}, r"one value a beam \(2\), got 1"),
        ({"angles": [0.0, math.nan]}, "angles must be finite"),
        ({"angles": [0.1, 0.1]}, "all rise or all fall"),
    ],
)
def test_directions_are_given_once(options, message):
    with pytest.raises(InvalidArgumentError, match=message):
        LaserScan([1.0, 2.0], **options)


def test_directions_go_one_way_and_round_once():
    with pytest.raises(InvalidArgumentError, match="all rise or all fall"):
        told([0.0, 0.1, 0.05])
    with pytest.raises(InvalidArgumentError, match=r"more than once, got 12.57 rad"):
        told(np.linspace(0.0, 4.0 * math.pi, 100))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"time_increment": -1e-4}, "time_increment must be finite and >= 0 seconds, got -0.0001"),
        ({"scan_time": math.nan}, "scan_time must be finite and >= 0 seconds, got nan"),
        ({"ranges": np.ones((4, 3))}, r"ranges must be 1-D, got shape \(4, 3\)"),
        ({"ranges": ["far"]}, "ranges must be numbers"),
        ({"angle_min": math.nan}, "angle_min must be finite, got nan"),
        ({"angle_increment": 0.0}, "angle_increment must not be 0"),
        ({"angle_increment": "wide"}, "angle_increment must be a number, got 'wide'"),
        ({"range_min": -1.0}, "range_min=-1.0"),
        ({"range_min": 9.0}, r"0 <= range_min < range_max, got range_min=9.0, range_max=8.0"),
        ({"range_max": math.nan}, "range_max=nan"),
        ({"stamp": math.inf}, "stamp must be finite"),
        ({"noise_doubled_at": 0.0}, "noise_doubled_at must be at least 0.01 m, got 0.0"),
        ({"intensities": [1.0]}, r"one value a beam \(2\), got 1"),
        ({"angles": [0.0, 0.1], "angle_min": "a"}, "angle_min must be a number, got 'a'"),
    ],
)
def test_broken_rules_are_named_with_the_value(change, message):
    options = {"ranges": [1.0, 2.0]} | change
    with pytest.raises(InvalidArgumentError, match=message):
        make(options.pop("ranges"), **options)


def test_masked_readings_are_no_readings():
    masked = np.ma.array([1.0, 2.0, 3.0], mask=[False, True, False])
    scan = LaserScan(masked, angle_min=0.0, angle_increment=0.1)
    np.testing.assert_array_equal(scan.valid, [True, False, True])
    whole = LaserScan(np.ma.array([1, 2, 3], mask=[0, 0, 1]), angle_min=0.0, angle_increment=0.1)
    np.testing.assert_array_equal(whole.valid, [True, True, False])


@pytest.mark.parametrize(("angle_min", "increment"), [(-90.0, 0.5), (-90.0, 0.0087), (0.0, 1.0)])
def test_angles_in_degrees_are_refused_with_the_remedy(angle_min, increment):
    with pytest.raises(InvalidArgumentError, match=r"must be radians.*numpy\.radians"):
        LaserScan(np.ones(361), angle_min=angle_min, angle_increment=increment)
    with pytest.raises(InvalidArgumentError, match=r"numpy\.radians"):
        LaserScan(np.ones(361), angles=np.arange(-90.0, 90.5, 0.5))


@pytest.mark.parametrize("angles", [[100.0, 100.1], [100.0], [12.6, 12.7], [-12.6, -12.9, -13.3]])
def test_angles_in_degrees_are_refused_one_by_one_and_in_either_order_too(angles):
    for way in (1, -1):
        with pytest.raises(InvalidArgumentError, match=r"must be radians.*numpy\.radians"):
            told(angles[::way])
    turned = make(np.ones(20), angle_min=12.5)  # its last beam is farther, and stands first in the other order
    assert len(LaserScan(turned.ranges[::-1], angles=turned.angles[::-1])) == 20


@pytest.mark.parametrize("angles", [[0.0, 3.3, 6.6, 9.9, 9.91, 9.92], [6.0, 12.5], np.arange(60) * 0.1 + 6.0])
def test_a_scan_that_is_taken_is_taken_mirrored_and_backwards_too(angles):
    scan = told(angles)
    for other in (replace(scan, stamp=1.0), mirrored(mirrored(scan)), swept_backwards(swept_backwards(scan))):
        np.testing.assert_allclose(other.angles, scan.angles, atol=1e-12)


@pytest.mark.parametrize("range_max", [8.0, 8000.0, np.inf])
def test_ranges_in_millimetres_are_named(range_max):
    ranges = np.random.default_rng(1).uniform(400.0, 7500.0, 361)
    with pytest.warns(UnitWarning, match="divide them by 1000"):
        LaserScan(ranges, angle_min=-1.5, angle_increment=0.0087, range_max=range_max)


def test_codes_for_no_reading_are_not_taken_for_millimetres():
    for code in (81.91, 65.533, 3.4e38, np.inf, 16383.0):
        scan = LaserScan(np.full(361, code), angle_min=-1.5, angle_increment=0.0087, range_max=8.0)
        assert not scan.valid.any()
