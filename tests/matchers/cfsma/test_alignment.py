"""The closed-form pose (eqs. 10-12) against a singular value decomposition, and its laws."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from curvescan import se2
from curvescan.matchers.cfsma.alignment import align
from tests.reference import cfsma as twin

seeds = st.integers(0, 10_000)
poses = st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-3.14, 3.14)).map(np.array)


@given(seeds, poses, st.integers(2, 80))
def test_exact_points_give_back_the_pose(seed, pose, n):
    cur = np.random.default_rng(seed).uniform(-5, 5, (n, 2))
    alignment = align(se2.transform(pose, cur), cur)
    found, error = alignment.pose, alignment.error
    # two points may lie close together: the angle then keeps fewer digits
    np.testing.assert_allclose(found[:2], pose[:2], atol=1e-8)
    assert abs(se2.wrap(found[2] - pose[2])) < 1e-8
    assert error < 1e-20


@given(seeds, poses)
def test_noisy_points_agree_with_the_slow_twin(seed, pose):
    rng = np.random.default_rng(seed)
    cur = rng.uniform(-5, 5, (30, 2))
    ref = se2.transform(pose, cur) + 0.1 * rng.standard_normal((30, 2))
    alignment = align(ref, cur)
    found, error = alignment.pose, alignment.error
    slow, slow_error = twin.align(ref, cur)
    np.testing.assert_allclose(found[:2], slow[:2], atol=1e-10)
    assert abs(se2.wrap(found[2] - slow[2])) < 1e-11
    np.testing.assert_allclose(error, slow_error, rtol=1e-10)


@given(seeds, poses)
def test_swapping_the_scans_inverts_the_pose(seed, pose):
    rng = np.random.default_rng(seed)
    cur = rng.uniform(-5, 5, (30, 2))
    ref = se2.transform(pose, cur) + 0.1 * rng.standard_normal((30, 2))
    there, back = align(ref, cur).pose, align(cur, ref).pose
    np.testing.assert_allclose(se2.compose(there, back)[:2], 0.0, atol=1e-10)
    assert abs(se2.wrap(there[2] + back[2])) < 1e-12


def test_no_other_pose_has_a_smaller_error():
    rng = np.random.default_rng(3)
    cur = rng.uniform(-5, 5, (20, 2))
    ref = se2.transform([0.3, -0.2, 0.4], cur) + 0.1 * rng.standard_normal((20, 2))
    alignment = align(ref, cur)
    pose, error = alignment.pose, alignment.error
    for change in 1e-3 * np.concatenate([np.eye(3), -np.eye(3)]):
        moved = se2.transform(pose + change, cur)
        assert np.sum((ref - moved) ** 2) > error


def test_points_in_one_place_fix_no_rotation():
    same = np.full((5, 2), math.pi)
    assert not align(same, same).fixes_rotation
    apart = np.array([[0.0, 0.0], [0.0, 0.01]])
    assert align(apart, apart).fixes_rotation
    assert align(apart, apart).spread == 0.005
