"""Partners of points in the reference, against every point compared with every other."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from curvescan import LaserScan, se2
from curvescan.matchers.baselines.correspondences import closest_points, matching_range_points, nearest_readings
from curvescan.matchers.baselines.points import sweep_of
from tests.reference import baselines as twin
from tests.scenes import room_ranges, room_scan


def rough_sweep(seed, fov=math.pi, n=61, angle_min=None):
    """A sweep of a room with a third of its readings at random nearer ranges, some lost."""
    rng = np.random.default_rng(seed)
    step = fov / n
    first = -fov / 2 if angle_min is None else angle_min
    angles = first + step * np.arange(n)
    ranges = room_ranges((0.0, 0.0, 0.0), angles) + 0.01 * rng.standard_normal(n)
    near = rng.random(n) < 0.3
    ranges[near] *= rng.uniform(0.3, 0.9, near.sum())
    ranges[rng.random(n) < 0.05] = np.nan
    return sweep_of(LaserScan(ranges, angle_min=first, angle_increment=step, range_max=8.0))


def some_points(seed, n=40):
    return np.random.default_rng(seed + 1).uniform(-3.5, 3.5, (n, 2))


sweeps = st.tuples(
    st.integers(0, 10_000),
    st.sampled_from([(math.pi, None), (1.5 * math.pi, None), (2 * math.pi, None), (2 * math.pi, 0.0)]),
)


@given(sweeps, st.floats(0.05, 6.0))
@settings(max_examples=40)
def test_nearest_readings_are_the_nearest_of_all(case, max_distance):
    seed, (fov, angle_min) = case
    ref = rough_sweep(seed, fov, angle_min=angle_min)
    points = np.vstack([some_points(seed), ref.points[:3], [[0.0, 0.0]]])
    ref_idx, squared = nearest_readings(points, ref, max_distance)
    for point, found, distance in zip(points, ref_idx, squared, strict=True):
        expected, least = twin.nearest_reading(point, ref.points, max_distance)
        np.testing.assert_allclose(distance, least, rtol=1e-12, atol=1e-15)
        assert (found < 0) == (expected < 0)


@given(sweeps, st.floats(0.05, 6.0))
@settings(max_examples=40)
def test_closest_points_are_the_closest_of_all_stretches(case, max_distance):
    seed, (fov, angle_min) = case
    ref = rough_sweep(seed, fov, angle_min=angle_min)
    points = np.vstack([some_points(seed), ref.points[:3], [[0.0, 0.0]]])
    partners, squared, ref_idx = closest_points(points, ref, math.pi, max_distance)
    for i, point in enumerate(points):
        _, least = twin.closest_point(point, ref.points, ref.is_joined, max_distance)
        np.testing.assert_allclose(squared[i], least, rtol=1e-9, atol=1e-15)
        assert (ref_idx[i] < 0) == math.isinf(least)
        if math.isfinite(least):
            np.testing.assert_allclose(np.sum((partners[i] - point) ** 2), least, atol=1e-12)


@given(sweeps, st.floats(0.2, math.pi), st.floats(0.2, 6.0))
@settings(max_examples=40)
def test_matching_range_points_lie_at_the_range_and_none_is_nearer(case, window, max_distance):
    seed, (fov, angle_min) = case
    ref = rough_sweep(seed, fov, angle_min=angle_min)
    points = some_points(seed)
    partners, squared, ref_idx = matching_range_points(points, ref, window, max_distance)
    widest = ref.angle_step * 4  # of one stretch: two lost readings may lie in it
    for i, point in enumerate(points):
        bearing = math.atan2(point[1], point[0])
        found = twin.matching_range_candidates(point, ref.points, ref.is_joined)
        turns = [twin.apart(math.atan2(q[1], q[0]), bearing) for q in found]
        near = [
            float((q - point) @ (q - point)) for q, turn in zip(found, turns, strict=True) if turn < window - widest
        ]
        # a straight stretch is a little nearer in between than its range, linear from end to end, says
        near = [away for away in near if away <= 0.8 * max_distance**2]
        if near:
            assert squared[i] <= min(near) + 1e-12
        if math.isfinite(squared[i]):
            assert squared[i] <= max_distance**2
            assert twin.apart(math.atan2(partners[i, 1], partners[i, 0]), bearing) < window + widest
            assert any(np.allclose(partners[i], q, atol=1e-9) for q in found)
            assert ref.is_joined[ref_idx[i]]
        else:
            assert ref_idx[i] == -1


def test_the_window_keeps_far_bearings_out():
    ref = sweep_of(room_scan())
    turned = se2.transform([0.0, 0.0, 0.5], ref.points)
    narrow = closest_points(turned[:20], ref, 0.05, 10.0)[1]
    wide = closest_points(turned[:20], ref, 1.0, 10.0)[1]
    assert (wide <= narrow).all()
    assert (wide < narrow).any()


def test_a_scan_is_its_own_partner():
    ref = sweep_of(room_scan(sigma=0.01, seed=2))
    ref_idx, squared = nearest_readings(ref.points, ref, 1.0)
    np.testing.assert_array_equal(ref_idx, np.arange(len(ref)))
    np.testing.assert_array_equal(squared, 0.0)
    for rule in (closest_points, matching_range_points):
        partners, squared, _ = rule(ref.points, ref, 1.0, 1.0)
        np.testing.assert_allclose(partners, ref.points, atol=1e-12)
        np.testing.assert_allclose(squared, 0.0, atol=1e-20)


@pytest.mark.parametrize("turn", [-0.1, 0.02, 0.2])
def test_the_matching_range_tells_a_pure_rotation(turn):
    # the ranges of a wall do not change when the sensor turns: every partner is turned back by the same angle
    angles = np.linspace(0.3, 1.2, 200)
    ref = sweep_of(LaserScan(2.0 / np.cos(angles), angle_min=0.3, angle_increment=0.9 / 199))
    turned = se2.transform([0.0, 0.0, turn], ref.points[60:140])
    partners, _, _ = matching_range_points(turned, ref, 0.4, 2.0)
    back = np.arctan2(partners[:, 1], partners[:, 0]) - np.arctan2(turned[:, 1], turned[:, 0])
    # between two readings 4.5 mrad apart the range is taken as linear
    np.testing.assert_allclose(back, -turn, atol=1e-5)
