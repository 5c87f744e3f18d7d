"""Poses with covariances: the kernels against se2 and plain linear algebra, and the laws between them."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from curvescan import se2
from curvescan.se2.uncertain import UncertainPose, between, compose, eigen3, fuse, identity, inverse
from tests.reference.se2 import compose_covariance, inverse_covariance


def draw(seed, scale=1.0):
    """A pose anywhere, with a covariance of any shape."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 3)) * 10.0 ** rng.uniform(-3, 0, 3)
    pose = np.array([*rng.uniform(-5, 5, 2), rng.uniform(-3.1, 3.1)])
    return UncertainPose(pose, scale * (root @ root.T + 1e-8 * np.eye(3)))


seeds = st.integers(0, 2**32 - 1)


@given(seeds, seeds)
def test_chain_is_se2s_composition(a, b):
    ab, bc = draw(a), draw(b)
    ac = compose(ab, bc)
    np.testing.assert_allclose(ac.pose, se2.compose(ab.pose, bc.pose), atol=1e-12)
    expected = compose_covariance(ab.pose, ab.covariance, bc.pose, bc.covariance)
    np.testing.assert_allclose(ac.covariance, expected, rtol=1e-9, atol=1e-12)
    np.testing.assert_array_equal(ac.covariance, ac.covariance.T)


@given(seeds)
def test_invert_is_se2s_inverse(a):
    ab = draw(a)
    np.testing.assert_allclose(inverse(ab).pose, se2.inverse(ab.pose), atol=1e-12)
    expected = inverse_covariance(ab.pose, ab.covariance)
    np.testing.assert_allclose(inverse(ab).covariance, expected, rtol=1e-9, atol=1e-12)


@given(seeds, seeds)
def test_between_undoes_compose(a, b):
    ab, bc = draw(a), draw(b)
    again = between(ab, compose(ab, bc))
    np.testing.assert_allclose(again.pose, bc.pose, atol=1e-9)
    size = np.abs(compose(ab, bc).covariance).max()  # what is subtracted again loses its last digits
    np.testing.assert_allclose(again.covariance, bc.covariance, atol=1e-12 * size + 1e-12)


@given(seeds, seeds)
def test_fusion_is_the_information_filter(a, b):
    """Twin: the sum of the two informations, solved by NumPy."""
    one = draw(a)
    other = UncertainPose(one.pose + 0.1 * draw(b).pose / 5.0, draw(b).covariance)
    fused, distance = fuse(one, other)
    apart = other.pose - one.pose
    apart[2] = se2.wrap(apart[2])
    total = one.covariance + other.covariance
    # 1e-4: cofactors of a nearly singular sum, whose variances span eight orders of magnitude
    np.testing.assert_allclose(distance, apart @ np.linalg.solve(total, apart), rtol=1e-4)
    expected = one.covariance - one.covariance @ np.linalg.solve(total, one.covariance)
    np.testing.assert_allclose(fused.covariance, expected, rtol=1e-4, atol=1e-7)
    pull = fused.pose - one.pose
    pull[2] = se2.wrap(pull[2])
    np.testing.assert_allclose(pull, one.covariance @ np.linalg.solve(total, apart), rtol=1e-4, atol=1e-7)
    assert np.linalg.eigvalsh(fused.covariance).min() > 0.0


@given(seeds)
def test_fusion_takes_both_alike(a):
    one = draw(a)
    other = UncertainPose(one.pose + np.array([0.02, -0.01, 0.03]), draw(a + 1).covariance)
    (left, d_left), (right, d_right) = fuse(one, other), fuse(other, one)
    np.testing.assert_allclose(se2.wrap((left.pose - right.pose)[2]), 0.0, atol=1e-7)
    np.testing.assert_allclose(left.pose[:2], right.pose[:2], atol=1e-7)
    np.testing.assert_allclose(left.covariance, right.covariance, rtol=1e-4, atol=1e-7)
    assert d_left == pytest.approx(d_right, rel=1e-6)


def test_where_one_leaves_a_direction_open_the_other_decides():
    along = UncertainPose(np.array([1.0, 0.0, 0.0]), np.diag([100.0**2, 1e-6, 1e-6]))
    across = UncertainPose(np.array([2.0, 0.5, 0.1]), np.diag([0.1**2, 100.0, 100.0]))
    fused, _ = fuse(along, across)
    np.testing.assert_allclose(fused.pose, [2.0, 0.0, 0.0], atol=1e-5)
    np.testing.assert_allclose(np.diag(fused.covariance), [0.01, 1e-6, 1e-6], rtol=1e-4)


def test_fusion_goes_the_short_way_round():
    one = UncertainPose(np.array([0.0, 0.0, 3.1]), 0.01 * np.eye(3))
    other = UncertainPose(np.array([0.0, 0.0, -3.1]), 0.01 * np.eye(3))
    fused, distance = fuse(one, other)
    assert abs(fused.pose[2]) == pytest.approx(np.pi)
    assert distance == pytest.approx((2 * np.pi - 6.2) ** 2 / 0.02)


def test_identity_is_the_unit_of_composition():
    ab = draw(3)
    for pose in (compose(identity(), ab), compose(ab, identity())):
        np.testing.assert_allclose(pose.pose, ab.pose, atol=1e-15)
        np.testing.assert_allclose(pose.covariance, ab.covariance, rtol=1e-12)


@pytest.mark.parametrize("seed", range(6))
def test_eigenvalues_and_eigenvectors_are_those_of_numpy(seed):
    root = np.random.default_rng(seed).normal(size=(3, 3)) * [1.0, 10.0, 0.1]
    matrix = root.T @ root
    values, vectors = eigen3(matrix)
    np.testing.assert_allclose(values, np.linalg.eigvalsh(matrix), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(vectors @ np.diag(values) @ vectors.T, matrix, atol=1e-9)
    np.testing.assert_allclose(vectors.T @ vectors, np.eye(3), atol=1e-12)


def test_eigen_of_a_diagonal_matrix():
    values, vectors = eigen3(np.diag([3.0, 1.0, 2.0]))
    np.testing.assert_array_equal(values, [1.0, 2.0, 3.0])
    np.testing.assert_array_equal(np.abs(vectors), np.eye(3)[:, [1, 2, 0]])
