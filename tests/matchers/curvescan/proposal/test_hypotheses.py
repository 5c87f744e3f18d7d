"""Turns from the directions of surfaces, and places at which walls and edges of both scans coincide."""

from __future__ import annotations

import math

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.features.landmarks import Landmarks, direction_histogram
from curvescan.matchers.curvescan.proposal.hypotheses import (
    coinciding_places,
    correlate,
    is_in_sight,
    peaks_of,
    profiles_of,
    rotation_hypotheses,
    translation_hypotheses,
)
from tests.matchers.curvescan.scenes import features, hall_scan, pair, pillar_scan, turned
from tests.reference import curvescan as slow


@pytest.mark.parametrize("angle", [0.0, 0.3, -1.2, 2.9])
def test_the_histogram_turns_with_the_sensor(angle):
    scan = pillar_scan(seed=1)
    ref, cur = features(scan), features(turned(scan, -angle))
    np.testing.assert_allclose(np.linalg.norm(ref.landmarks.directions), 1.0)
    poses = rotation_hypotheses(ref.landmarks.directions, cur.landmarks.directions, 4, np.array([0.3, 0.1, 0.2]))
    np.testing.assert_array_equal(poses[0], [0.3, 0.1, 0.2])
    np.testing.assert_array_equal(poses[1:, :2], np.tile([0.3, 0.1], (len(poses) - 1, 1)))
    # a tenth of a bin of 3 degrees
    assert np.abs(cs.se2.wrap(poses[1:, 2] - angle)).min() < math.radians(0.5)


def test_turns_are_peaks_of_the_correlation():
    ref, cur = pair()
    likeness = slow.turn_likeness(ref.landmarks.directions, cur.landmarks.directions)
    poses = rotation_hypotheses(ref.landmarks.directions, cur.landmarks.directions, 3, np.zeros(3))
    bins = np.round(np.mod(poses[1:, 2], 2 * math.pi) * 120 / (2 * math.pi)).astype(int) % 120
    assert bins[0] == np.argmax(likeness)
    for k in bins:
        assert likeness[k] >= max(likeness[k - 1], likeness[(k + 1) % 120]) - 1e-12
    assert (np.diff(likeness[bins]) <= 0).all()


def test_scans_without_lines_have_an_even_histogram():
    assert not direction_histogram(np.empty((0, 10))).any()


def proposed(ref, cur, poses, n_most=48):
    none, turned = np.empty((0, 3)), np.array(poses)
    return translation_hypotheses(none, turned, ref.image, cur.image, ref.landmarks, cur.landmarks, n_most)


@pytest.mark.parametrize("motion", [(0.55, -0.45, 0.2), (-0.35, 0.3, 0.2), (0.05, 0.6, -1.5)])
def test_walls_that_coincide_propose_the_translation(motion):
    ref, cur = pair(motion=np.array(motion))
    poses = proposed(ref, cur, [[0.0, 0.0, motion[2]]])
    assert 1 <= len(poses) <= 48
    assert (poses[:, 2] == motion[2]).all()
    assert np.hypot(*(poses[:5, :2] - motion[:2]).T).min() < 0.12
    assert len(proposed(ref, cur, [[0.0, 0.0, motion[2]]], 3)) <= 3


def test_the_turn_at_which_most_walls_coincide_comes_first():
    motion = np.array([0.55, -0.45, 0.2])
    ref, cur = pair(motion=motion)
    poses = proposed(ref, cur, [[0.0, 0.0, 2.0], [0.0, 0.0, 0.2]])
    assert poses[0, 2] == 0.2
    assert np.hypot(*(poses[:5, :2] - motion[:2]).T).min() < 0.12


def test_places_are_looked_for_around_the_pose_and_not_beyond_reach():
    ref, cur = pair(motion=np.array([0.55, -0.45, 0.2]))
    far = np.array([[4.0, -4.0, 0.2]])
    places, heights = coinciding_places(far, 0.0, ref.landmarks, cur.landmarks)
    found = heights[0, 0] > 0.0
    assert found.any()
    assert np.abs(places[0, 0, found] - 4.0).max() < 6.7
    assert (np.diff(heights[0, 0, found]) <= 0.0).all()


def test_a_sensor_does_not_stand_behind_a_wall():
    image = features(pillar_scan(sigma=0.0)).image
    assert is_in_sight(0.0, 0.0, image, 0.1)
    assert is_in_sight(2.9, 0.1, image, 0.1)
    assert not is_in_sight(3.3, 0.1, image, 0.1)
    assert is_in_sight(-5.0, 0.0, image, 0.1)  # out of the field of view: nobody knows
    ref, cur = pair()
    for x, y, theta in proposed(ref, cur, [[0.0, 0.0, 0.1], [0.0, 0.0, 1.7]]):
        back = cs.se2.inverse(np.array([x, y, theta]))
        assert is_in_sight(x, y, ref.image, 0.1)
        assert is_in_sight(back[0], back[1], cur.image, 0.1)


def marks(walls=(), edges=()):
    none = np.empty((0, 4))
    return Landmarks(np.array(walls) if walls else none, np.array(edges) if edges else none, np.empty(0), 0.0)


def test_a_profile_holds_roots_of_lengths_by_place_and_side():
    # 1.5 m of wall at x = 1.05 that faces against x, a quarter of a bin beyond one; and the same a period on
    found = profiles_of(marks(walls=[[1.05, 9.0, -1.5, 0.1], [1.05 + 25.6, 9.0, -1.5, 0.1]]), 0.0)
    np.testing.assert_allclose(found[1, [5, 6]] ** 2, [3.0 * 0.75, 3.0 * 0.25])
    assert np.count_nonzero(found) == 2
    # turned by a right angle it faces against y, at y = 1.05
    found = profiles_of(marks(walls=[[1.05, 9.0, -1.5, 0.1]]), 0.5 * math.pi)
    np.testing.assert_allclose(found[3, [5, 6]] ** 2, [1.5 * 0.75, 1.5 * 0.25])
    # a wall across both axes is in none, an edge in both, on the side that is hidden
    assert not profiles_of(marks(walls=[[1.0, 2.0, 1.0, 0.8]]), 0.0).any()
    found = profiles_of(marks(edges=[[1.0, -2.0, 0.1, -0.995]]), 0.0)
    np.testing.assert_allclose((found**2).sum(axis=1), [0.3, 0.0, 0.0, 0.3])
    assert found[0, 5] > 0.0
    assert found[3, -10] > 0.0


def test_without_walls_across_an_axis_places_around_the_pose_are_proposed():
    ref, cur = features(hall_scan(0.0, seed=1)), features(hall_scan(0.4, seed=2))
    places, heights = coinciding_places(np.array([[0.4, 0.0, 0.0]]), 0.0, ref.landmarks, cur.landmarks)
    np.testing.assert_allclose(places[0, 0, :5], [0.4, 0.7, 0.1, 1.0, -0.2])
    assert not heights[0, 0].any()
    assert heights[0, 1, 0] > 0.0
    poses = proposed(ref, cur, [[0.4, 0.0, 0.0]])
    np.testing.assert_allclose(poses[:3], [[0.4, 0.0, 0.0], [0.7, 0.0, 0.0], [0.1, 0.0, 0.0]], atol=0.02)


def test_no_more_places_are_proposed_than_there_are():
    ref, cur = pair()
    assert len(proposed(ref, cur, [[0.0, 0.0, 0.1]], 1000)) <= 144


@pytest.mark.parametrize("first", [0, 3, -5, 21])
def test_a_correlation_is_the_sum_of_products_at_each_shift(first):
    rng = np.random.default_rng(1)
    one, other = rng.uniform(size=16), np.where(rng.uniform(size=16) < 0.5, 0.0, rng.uniform(size=16))
    likeness = np.ones(7)
    correlate(likeness, np.tile(one, 2), other, first)
    expected = [1.0 + sum(other[k] * one[(k + first + shift) % 16] for k in range(16)) for shift in range(7)]
    np.testing.assert_allclose(likeness, expected)


def test_peaks_come_by_height_and_lie_between_bins():
    bins = np.arange(24)
    likeness = np.maximum(3.0 - (bins - 5.25) ** 2, 0.0) + np.maximum(2.0 - (bins - 15.0) ** 2, 0.0)
    places, heights = peaks_of(likeness, 5)
    np.testing.assert_allclose(places, [5.25, 15.0])
    np.testing.assert_allclose(heights, [likeness[5], 2.0])
    np.testing.assert_allclose(peaks_of(likeness, 1)[0], [5.25])
    # the histogram goes round, a plateau is one peak, and nothing is none
    np.testing.assert_allclose(peaks_of(np.roll(likeness, -5), 1)[0], [0.25])
    assert len(peaks_of(np.array([0.0, 2.0, 2.0, 0.0]), 4)[0]) == 1
    assert len(peaks_of(np.zeros(8), 3)[0]) == 0
