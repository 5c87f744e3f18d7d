"""Median and projection filter, against their definitions."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from curvescan import LaserScan, se2
from curvescan.matchers.baselines.points import HIDDEN_MARGIN, is_visible, median_filter, sweep_of
from curvescan.scan import valid_readings
from tests.reference import baselines as twin
from tests.scenes import room_scan


def test_the_median_takes_a_stray_reading_away_and_leaves_the_rest():
    ranges = np.linspace(2.0, 2.5, 50)
    stray = ranges.copy()
    stray[20] = 0.4
    scan = LaserScan(stray, angle_min=0.0, angle_increment=0.01)
    filtered = median_filter(valid_readings(scan), 3)
    # the stray one becomes its nearer neighbour; of a rising row every median is the middle
    assert filtered.ranges[20] == ranges[19]
    kept = np.delete(np.arange(50), [19, 20, 21])
    np.testing.assert_array_equal(filtered.ranges[kept], ranges[kept])
    np.testing.assert_allclose(np.linalg.norm(filtered.points, axis=1), filtered.ranges)


def test_the_median_joins_at_the_seam_of_a_full_circle():
    ranges = np.full(360, 2.0)
    ranges[0] = 0.5
    scan = LaserScan(ranges, angle_min=-math.pi, angle_increment=math.radians(1.0))
    np.testing.assert_array_equal(median_filter(valid_readings(scan), 5).ranges, 2.0)


def test_a_median_of_one_or_of_too_few_readings_changes_nothing():
    readings = valid_readings(room_scan(sigma=0.01))
    assert median_filter(readings, 1) is readings
    few = valid_readings(LaserScan([1.0, 2.0], angle_min=0.0, angle_increment=0.1))
    assert median_filter(few, 5) is few


def test_everything_is_visible_from_where_it_was_seen():
    points = sweep_of(room_scan(sigma=0.01, seed=1))
    assert is_visible(points.points, points.is_joined, points.angle_step).all()


def post_before_a_wall():
    """A wall 3 m ahead and, 1.5 m ahead, a post 0.3 m wide."""
    angles = -0.7 + 0.01 * np.arange(141)
    ranges = 3.0 / np.cos(angles)
    post = np.abs(np.tan(angles) * 1.5) < 0.15
    ranges[post] = 1.5 / np.cos(angles[post])
    return sweep_of(LaserScan(ranges, angle_min=-0.7, angle_increment=0.01)), post


def test_a_post_hides_the_wall_behind_it_from_another_place():
    points, post = post_before_a_wall()
    moved = se2.transform(se2.inverse([0.0, 0.8, 0.0]), points.points)
    seen = is_visible(moved, points.is_joined, points.angle_step)
    assert seen[post].all()
    hidden = points.points[~seen]
    # seen from y = 0.8 the post's shadow on the wall lies at y = -0.8 with twice its width
    assert len(hidden) > 10
    assert (np.abs(hidden[:, 1] + 0.8) < 0.35).all()


def test_a_wall_seen_from_behind_is_hidden():
    points, _ = post_before_a_wall()
    behind = se2.transform(se2.inverse([5.0, 0.0, math.pi]), points.points)
    seen = is_visible(behind, points.is_joined, points.angle_step)
    # only the readings at the ends of a surface have one side that is not turned away
    assert np.count_nonzero(seen) <= 2 * len(points.starts)


@given(st.integers(0, 1000), st.floats(-0.8, 0.8), st.floats(-0.8, 0.8))
@settings(max_examples=20)
def test_agrees_with_the_slow_twin_away_from_edges(seed, x, y):
    scan, _ = post_before_a_wall()
    points = se2.transform(se2.inverse([x, y, 0.001 * seed]), scan.points)
    fast = is_visible(points, scan.is_joined, scan.angle_step)
    slow = np.array([twin.can_be_seen(points, scan.is_joined, i, HIDDEN_MARGIN) for i in range(len(points))])
    # the fast one looks along rays one beam wide: a shadow's two edges may fall either way by two readings
    assert np.count_nonzero(fast != slow) <= 8
