"""Keyframes: the tree they form, what it tells of two places, and what is forgotten."""

from __future__ import annotations

import functools

import numpy as np

from curvescan.odometry.keyframes import KeyframeGraph, Localization
from curvescan.se2.uncertain import UncertainPose, compose, inverse

STEP = UncertainPose(np.array([1.0, 0.0, 0.1]), np.diag([1e-4, 1e-4, 1e-6]))


def grow(keyframes, n, start=None, **kwargs):
    """A chain of n keyframes, each placed by the one before it."""
    made = [] if start is None else [start]
    for k in range(n):
        localization = None if not made else Localization(keyframe=made[-1], pose_keyframe_scan=STEP, **kwargs)
        made.append(keyframes.add(None, len(keyframes) + k, localization))
    return made


def steps(n):
    """The way of n steps."""
    return functools.reduce(compose, [STEP] * n)


def test_the_error_between_two_is_that_of_the_way_between_them():
    keyframes = KeyframeGraph(max_keyframes=50, variance_retained=1.0)
    trunk = grow(keyframes, 10)
    branch = grow(keyframes, 4, start=trunk[6])
    # from the end of the branch back to the fork, and on along the trunk
    pose_keyframe_scan = Localization(keyframe=branch[-1], pose_keyframe_scan=STEP).relative_to(trunk[9])
    way = inverse(compose(compose(STEP, STEP), STEP))
    for _ in range(5):
        way = compose(way, STEP)
    np.testing.assert_allclose(pose_keyframe_scan.pose, way.pose, atol=1e-12)
    np.testing.assert_allclose(pose_keyframe_scan.cov, way.cov, rtol=1e-9)
    # less than the error of either in the world
    assert np.trace(pose_keyframe_scan.cov) < np.trace(branch[-1].pose_map_keyframe.cov)


def test_from_its_own_key_scan_a_place_is_as_it_was_seen():
    keyframes = KeyframeGraph(max_keyframes=5, variance_retained=1.0)
    *_, last = grow(keyframes, 3)
    assert Localization(keyframe=last, pose_keyframe_scan=STEP).relative_to(last) is STEP


def test_a_share_of_a_measured_variance_stays():
    keyframes = KeyframeGraph(max_keyframes=5, variance_retained=0.25)
    first = keyframes.add(None, 0, None)
    measured = keyframes.add(None, 1, Localization(keyframe=first, pose_keyframe_scan=STEP, is_measured=True))
    expected = keyframes.add(None, 2, Localization(keyframe=first, pose_keyframe_scan=STEP))
    np.testing.assert_allclose(measured.pose_map_keyframe.cov, 0.25 * STEP.cov)
    np.testing.assert_allclose(expected.pose_map_keyframe.cov, STEP.cov)


def test_nearest_come_first_and_far_ones_not_at_all():
    keyframes = KeyframeGraph(max_keyframes=50, variance_retained=1.0)
    grow(keyframes, 12)
    near = keyframes.nearest(keyframes.add(None, 99, None).pose_map_keyframe.pose, 2.5, 0.25)
    assert [keyframe.number for keyframe in near] == [0, 12, 1, 2]  # two at the origin, then along the chain


def test_directions_are_compared_the_short_way_round():
    keyframes = KeyframeGraph(max_keyframes=50, variance_retained=1.0)
    first = keyframes.add(None, 0, None)
    turned = UncertainPose(np.array([0.0, 0.0, 3.1]), STEP.cov)
    keyframe = keyframes.add(None, 1, Localization(keyframe=first, pose_keyframe_scan=turned))
    assert keyframes.nearest(np.array([0.0, 0.0, -3.1]), 1.0, 0.2) == [keyframe]


def test_beyond_the_limit_the_one_not_used_for_longest_goes():
    keyframes = KeyframeGraph(max_keyframes=3, variance_retained=1.0)
    made = grow(keyframes, 3)
    made[0].used = 50
    grow(keyframes, 1, start=made[-1])
    assert [keyframe.number for keyframe in keyframes] == [0, 2, 3]
    assert len(keyframes.nearest(np.zeros(3), 100.0, 4.0)) == 3


def test_what_a_forgotten_one_placed_keeps_its_place_and_error():
    keyframes = KeyframeGraph(max_keyframes=50, variance_retained=1.0)
    made = grow(keyframes, 6)
    before = Localization(keyframe=made[5], pose_keyframe_scan=STEP).relative_to(made[1])
    keyframes.forget(made[3])
    assert made[4].parent is made[2]
    after = Localization(keyframe=made[5], pose_keyframe_scan=STEP).relative_to(made[1])
    np.testing.assert_array_equal(after.pose, before.pose)
    np.testing.assert_array_equal(after.cov, before.cov)


def test_without_a_common_ancestor_the_first_frame_is_one():
    keyframes = KeyframeGraph(max_keyframes=50, variance_retained=1.0)
    trunk = grow(keyframes, 3)
    one, other = grow(keyframes, 2, start=trunk[-1])[1:], grow(keyframes, 3, start=trunk[-1])[1:]
    localization = Localization(keyframe=other[-1], pose_keyframe_scan=STEP)
    before = localization.relative_to(one[-1])
    for keyframe in trunk:
        keyframes.forget(keyframe)
    assert one[0].parent is None
    assert other[0].parent is None
    # back to the first frame and out again on the other branch: the trunk's two steps err on either way
    way = compose(inverse(steps(4)), steps(6))
    pose_keyframe_scan = localization.relative_to(one[-1])
    np.testing.assert_allclose(pose_keyframe_scan.pose, before.pose, atol=1e-12)
    np.testing.assert_allclose(pose_keyframe_scan.cov, way.cov, rtol=1e-9)
    assert np.trace(pose_keyframe_scan.cov) > 1.5 * np.trace(before.cov)


def test_what_is_made_before_it_is_taken_in_is_younger_than_its_parent():
    """Ancestors are found by their numbers."""
    keyframes = KeyframeGraph(max_keyframes=50, variance_retained=1.0)
    *_, last = grow(keyframes, 3)
    one = keyframes.make(None, 3, Localization(keyframe=last, pose_keyframe_scan=STEP))
    two = keyframes.make(None, 4, Localization(keyframe=one, pose_keyframe_scan=STEP))
    assert [one.number, two.number] == [3, 4]
    # and a branch from an old one is younger than all
    assert grow(keyframes, 1, start=next(iter(keyframes)))[1].number == 3


def test_only_what_came_after_a_break_is_known_less():
    keyframes = KeyframeGraph(max_keyframes=50, variance_retained=1.0)
    made = [keyframes.add(None, 10 * k, None) for k in range(4)]
    before = [keyframe.pose_map_keyframe.cov.copy() for keyframe in made]
    keyframes.disconnect(20, np.diag([100.0, 100.0, 3.0]))
    for keyframe, cov in zip(made[:2], before[:2], strict=True):
        np.testing.assert_array_equal(keyframe.pose_map_keyframe.cov, cov)
    for keyframe, cov in zip(made[2:], before[2:], strict=True):
        np.testing.assert_array_equal(keyframe.pose_map_keyframe.cov, cov + np.diag([100.0, 100.0, 3.0]))


def test_near_is_within_reach_and_within_the_turn():
    keyframes = KeyframeGraph(max_keyframes=50, variance_retained=1.0)
    first = keyframes.add(None, 0, None)
    for k, pose in enumerate([(4.0, 0.0, 0.0), (4.0, 0.0, 0.3), (0.0, 4.0, 0.0)], start=1):
        there = UncertainPose(np.array(pose), STEP.cov)
        keyframes.add(None, k, Localization(keyframe=first, pose_keyframe_scan=there))

    def numbers(pose, reach, turn):
        return [k.number for k in keyframes.nearest(np.array(pose), reach, turn)]

    assert numbers((4.0, 0.0, 0.0), 1.0, 0.2) == [1]
    assert numbers((4.0, 0.0, 0.0), 1.0, 0.31) == [1, 2]
    assert numbers((0.0, 3.0, 0.0), 1.01, 0.2) == [3]
    assert numbers((0.0, 3.0, 0.0), 0.99, 0.2) == []


def test_places_of_different_trees_are_seen_from_each_other_both_ways():
    keyframes = KeyframeGraph(max_keyframes=50, variance_retained=1.0)
    young = grow(keyframes, 2)[-1]
    old = keyframes.add(None, 9, None)
    for one, other in ((old, young), (young, old)):
        found = Localization(keyframe=one, pose_keyframe_scan=STEP).relative_to(other)
        way = compose(inverse(other.pose_map_keyframe), compose(one.pose_map_keyframe, STEP))
        np.testing.assert_allclose(found.pose, way.pose, atol=1e-12)
        np.testing.assert_allclose(found.cov, way.cov, rtol=1e-9)
