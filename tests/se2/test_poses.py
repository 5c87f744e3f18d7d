"""The group laws of SE(2), and first-order propagation against a Monte Carlo."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from curvescan import se2
from curvescan.errors import InvalidArgumentError
from tests.reference.se2 import compose_covariance, inverse_covariance

metres = st.floats(-1e3, 1e3)
radians = st.floats(-math.pi, math.pi)
poses = st.tuples(metres, metres, radians).map(np.array)

# a kilometre times the rounding of a double, with room for a handful of operations
CLOSE = 1e-11


def assert_same(a, b):
    np.testing.assert_allclose(a[:2], b[:2], atol=CLOSE * 1e2)
    assert abs(se2.wrap(a[2] - b[2])) < CLOSE


@given(poses, poses, poses)
def test_compose_is_associative(a, b, c):
    assert_same(se2.compose(se2.compose(a, b), c), se2.compose(a, se2.compose(b, c)))


@given(poses)
def test_inverse_undoes(a):
    assert_same(se2.compose(a, se2.inverse(a)), se2.identity())
    assert_same(se2.compose(se2.inverse(a), a), se2.identity())


@given(poses)
def test_identity_changes_nothing(a):
    assert_same(se2.compose(a, se2.identity()), a)
    assert_same(se2.compose(se2.identity(), a), a)


@given(poses)
def test_log_undoes_exp(a):
    assert_same(se2.exp(se2.log(a)), a)


@given(metres, metres, st.floats(-3.1, 3.1), st.integers(2, 8))
def test_exp_is_many_small_steps(x, y, theta, n):
    velocity = np.array([x, y, theta])
    pose = se2.identity()
    for _ in range(n):
        pose = se2.compose(pose, se2.exp(velocity / n))
    assert_same(se2.exp(velocity), pose)


def test_a_quarter_turn_at_constant_speed_is_an_arc():
    np.testing.assert_allclose(se2.exp([math.pi / 2, 0.0, math.pi / 2]), [1.0, 1.0, math.pi / 2])
    np.testing.assert_array_equal(se2.exp([0.3, -0.2, 0.0]), [0.3, -0.2, 0.0])


@given(poses, poses)
def test_between_is_what_compose_needs(a, b):
    assert_same(se2.compose(a, se2.between(a, b)), b)


@given(poses, poses, st.tuples(metres, metres).map(np.array))
def test_transform_follows_compose(a, b, point):
    chained = se2.transform(a, se2.transform(b, point))
    np.testing.assert_allclose(se2.transform(se2.compose(a, b), point), chained, atol=CLOSE * 1e2)


@given(st.floats(-1e6, 1e6))
def test_wrap_lands_in_its_interval_on_the_same_direction(angle):
    wrapped = float(se2.wrap(angle))
    assert -math.pi < wrapped <= math.pi
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-9)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-9)


@given(radians.filter(lambda a: a > -math.pi))
def test_wrap_leaves_what_is_inside_untouched(angle):
    assert float(se2.wrap(angle)) == angle


def test_wrap_at_the_seam():
    np.testing.assert_array_equal(se2.wrap([math.pi, -math.pi, 3 * math.pi, -3 * math.pi]), [math.pi] * 4)
    assert np.isnan(se2.wrap([math.nan, math.inf])).all()


def test_functions_broadcast_over_leading_dimensions():
    rng = np.random.default_rng(1)
    a, b = rng.uniform(-3, 3, (2, 4, 5, 3))
    stacked = se2.compose(a, b)
    assert stacked.shape == (4, 5, 3)
    np.testing.assert_array_equal(stacked[2, 3], se2.compose(a[2, 3], b[2, 3]))
    np.testing.assert_array_equal(se2.inverse(a)[1, 4], se2.inverse(a[1, 4]))


def _sample_covariance(errors):
    return errors.T @ errors / len(errors)


def test_covariances_agree_with_a_monte_carlo():
    rng = np.random.default_rng(2)
    pose_ab, pose_bc = np.array([1.0, -2.0, 0.7]), np.array([3.0, 0.5, -1.1])
    cov_ab = np.diag([0.01, 0.02, 0.01]) ** 2 + 2e-5
    cov_bc = np.diag([0.02, 0.01, 0.015]) ** 2 - 1e-5
    n = 200_000
    samples_ab = pose_ab + rng.multivariate_normal(np.zeros(3), cov_ab, n)
    samples_bc = pose_bc + rng.multivariate_normal(np.zeros(3), cov_bc, n)
    composed = se2.compose(samples_ab, samples_bc) - se2.compose(pose_ab, pose_bc)
    inverted = se2.inverse(samples_ab) - se2.inverse(pose_ab)
    # a sample variance of 200,000 is good to 0.3 %; second-order terms are of the order of sigma
    for cov, errors in (
        (compose_covariance(pose_ab, cov_ab, pose_bc, cov_bc), composed),
        (inverse_covariance(pose_ab, cov_ab), inverted),
    ):
        scale = np.sqrt(np.outer(np.diag(cov), np.diag(cov)))
        np.testing.assert_allclose(_sample_covariance(errors) / scale, cov / scale, atol=0.02)


def test_wrong_shapes_are_named():
    with pytest.raises(InvalidArgumentError, match=r"pose_a_b must have shape \(\.\.\., 3\).*\(2,\)"):
        se2.compose([1, 2], [1, 2, 3])
    with pytest.raises(InvalidArgumentError, match=r"points must have shape \(\.\.\., 2\).*\(3,\)"):
        se2.transform([0, 0, 0], [1, 2, 3])


def test_a_single_pose_has_the_bits_of_one_of_many():
    rng = np.random.default_rng(8)
    one, other = rng.uniform(-8.0, 8.0, (2, 200, 3))
    one[:4, 2] = np.pi, -np.pi, np.nextafter(np.pi, 4.0), 3.0 * np.pi
    one[4], other[5] = np.nan, (np.inf, 0.0, np.inf)
    with np.errstate(invalid="ignore"):
        for function in (se2.compose, se2.between):
            singles = [function(a, b) for a, b in zip(one, other, strict=True)]
            np.testing.assert_array_equal(singles, function(one, other))
        np.testing.assert_array_equal([se2.inverse(a) for a in one], se2.inverse(one))
        np.testing.assert_array_equal([se2.wrap(a) for a in one[:, 2]], se2.wrap(one[:, 2]))
