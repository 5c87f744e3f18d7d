"""Key scans: the tree they form, what it tells of two places, and what is forgotten."""

from __future__ import annotations

import functools

import numpy as np

from curvescan.odometry.keyframes import Fix, Keys
from curvescan.se2.uncertain import UncertainPose, compose, inverse

STEP = UncertainPose(np.array([1.0, 0.0, 0.1]), np.diag([1e-4, 1e-4, 1e-6]))


def grow(keys, n, start=None, **kwargs):
    """A chain of n key scans, each placed by the one before it."""
    made = [] if start is None else [start]
    for k in range(n):
        fix = None if not made else Fix(key=made[-1], seen=STEP, **kwargs)
        made.append(keys.add(None, len(keys) + k, fix))
    return made


def steps(n):
    """The way of n steps."""
    return functools.reduce(compose, [STEP] * n)


def test_the_error_between_two_is_that_of_the_way_between_them():
    keys = Keys(max_keys=50, kept=1.0)
    trunk = grow(keys, 10)
    branch = grow(keys, 4, start=trunk[6])
    # from the end of the branch back to the fork, and on along the trunk
    seen = Fix(key=branch[-1], seen=STEP).seen_from(trunk[9])
    way = inverse(compose(compose(STEP, STEP), STEP))
    for _ in range(5):
        way = compose(way, STEP)
    np.testing.assert_allclose(seen.pose, way.pose, atol=1e-12)
    np.testing.assert_allclose(seen.cov, way.cov, rtol=1e-9)
    # less than the error of either in the world
    assert np.trace(seen.cov) < np.trace(branch[-1].world.cov)


def test_from_its_own_key_scan_a_place_is_as_it_was_seen():
    keys = Keys(max_keys=5, kept=1.0)
    *_, last = grow(keys, 3)
    assert Fix(key=last, seen=STEP).seen_from(last) is STEP


def test_a_share_of_a_measured_variance_stays():
    keys = Keys(max_keys=5, kept=0.25)
    first = keys.add(None, 0, None)
    measured = keys.add(None, 1, Fix(key=first, seen=STEP, is_measured=True))
    expected = keys.add(None, 2, Fix(key=first, seen=STEP))
    np.testing.assert_allclose(measured.world.cov, 0.25 * STEP.cov)
    np.testing.assert_allclose(expected.world.cov, STEP.cov)


def test_nearest_come_first_and_far_ones_not_at_all():
    keys = Keys(max_keys=50, kept=1.0)
    grow(keys, 12)
    near = keys.nearest(keys.add(None, 99, None).world.pose, 2.5, 0.25)
    assert [key.number for key in near] == [0, 12, 1, 2]  # two at the origin, then along the chain


def test_directions_are_compared_the_short_way_round():
    keys = Keys(max_keys=50, kept=1.0)
    first = keys.add(None, 0, None)
    turned = UncertainPose(np.array([0.0, 0.0, 3.1]), STEP.cov)
    key = keys.add(None, 1, Fix(key=first, seen=turned))
    assert keys.nearest(np.array([0.0, 0.0, -3.1]), 1.0, 0.2) == [key]


def test_beyond_the_limit_the_one_not_used_for_longest_goes():
    keys = Keys(max_keys=3, kept=1.0)
    made = grow(keys, 3)
    made[0].used = 50
    grow(keys, 1, start=made[-1])
    assert [key.number for key in keys] == [0, 2, 3]
    assert len(keys.nearest(np.zeros(3), 100.0, 4.0)) == 3


def test_what_a_forgotten_one_placed_keeps_its_place_and_error():
    keys = Keys(max_keys=50, kept=1.0)
    made = grow(keys, 6)
    before = Fix(key=made[5], seen=STEP).seen_from(made[1])
    keys.forget(made[3])
    assert made[4].parent is made[2]
    after = Fix(key=made[5], seen=STEP).seen_from(made[1])
    np.testing.assert_array_equal(after.pose, before.pose)
    np.testing.assert_array_equal(after.cov, before.cov)


def test_without_a_common_ancestor_the_first_frame_is_one():
    keys = Keys(max_keys=50, kept=1.0)
    trunk = grow(keys, 3)
    one, other = grow(keys, 2, start=trunk[-1])[1:], grow(keys, 3, start=trunk[-1])[1:]
    fix = Fix(key=other[-1], seen=STEP)
    before = fix.seen_from(one[-1])
    for key in trunk:
        keys.forget(key)
    assert one[0].parent is None
    assert other[0].parent is None
    # back to the first frame and out again on the other branch: the trunk's two steps err on either way
    way = compose(inverse(steps(4)), steps(6))
    seen = fix.seen_from(one[-1])
    np.testing.assert_allclose(seen.pose, before.pose, atol=1e-12)
    np.testing.assert_allclose(seen.cov, way.cov, rtol=1e-9)
    assert np.trace(seen.cov) > 1.5 * np.trace(before.cov)
