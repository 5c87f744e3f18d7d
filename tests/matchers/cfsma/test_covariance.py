"""The covariance (eqs. 13-18) against its definition row by row, and against a Monte Carlo."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from curvescan import se2
from curvescan.matchers.cfsma.alignment import align
from curvescan.matchers.cfsma.covariance import LEAST_SIGMA, pose_covariance
from tests.reference import cfsma as twin


@given(
    st.integers(0, 10_000),
    st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-3.14, 3.14)).map(np.array),
    st.floats(0.01, 10.0),
)
def test_agrees_with_the_slow_twin(seed, pose, error):
    cur = np.random.default_rng(seed).uniform(-5, 5, (30, 2))
    cov = pose_covariance(cur, pose, error)
    np.testing.assert_allclose(cov, twin.covariance(cur, pose, error), rtol=1e-8, atol=1e-15)
    np.testing.assert_array_equal(cov, cov.T)
    assert (np.linalg.eigvalsh(cov) > 0).all()


@pytest.mark.parametrize("pose", [(0.0, 0.0, 0.0), (0.4, -0.3, 0.2), (1.0, 2.0, 2.5)])
def test_agrees_with_a_monte_carlo_of_the_same_closed_form(pose):
    # off centre and elongated, so that every entry of the matrix is at work
    rng = np.random.default_rng(7)
    pose = np.array(pose)
    n_points, n_runs, sigma = 40, 20_000, 0.02
    cur = rng.uniform([1.0, -1.0], [4.0, 3.0], (n_points, 2))
    ref = se2.transform(pose, cur)
    errors, mean_cov = np.empty((n_runs, 3)), np.zeros((3, 3))
    for run in range(n_runs):
        noisy = ref + sigma * rng.standard_normal(ref.shape)
        alignment = align(noisy, cur)
        found = alignment.pose
        errors[run] = found - pose
        errors[run, 2] = se2.wrap(errors[run, 2])
        mean_cov += pose_covariance(cur, found, alignment.error) / n_runs
    sample = errors.T @ errors / n_runs
    scale = np.sqrt(np.outer(np.diag(sample), np.diag(sample)))
    # the sample covariance of 20,000 runs has a standard error of 1 %; four of them
    np.testing.assert_allclose(mean_cov / scale, sample / scale, atol=0.04)
    # 2 N - 3 is the divisor without bias: with the paper's N - 3 this would be 2.08
    nees = np.einsum("ni,ij,nj->n", errors, np.linalg.inv(mean_cov), errors)
    assert nees.mean() == pytest.approx(3.0, abs=0.1)


def test_no_error_still_gives_a_positive_definite_matrix():
    cur = np.random.default_rng(1).uniform(-3, 3, (50, 2))
    cov = pose_covariance(cur, np.zeros(3), 0.0)
    assert (np.linalg.eigvalsh(cov) > 0).all()
    assert cov[0, 0] == pytest.approx(LEAST_SIGMA**2 / 50, rel=0.2)
