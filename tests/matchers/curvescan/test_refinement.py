"""Refinement: normal equations, their solution, and where the iterations end."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.association import BACKWARD, FORWARD, motion_of
from curvescan.matchers.curvescan.config import RefinementConfig
from curvescan.matchers.curvescan.features.range_image import reading_at
from curvescan.matchers.curvescan.features.surfels import CX, CY, NX, NY, SHARED, VARIANCE, X, Y
from curvescan.matchers.curvescan.refinement import N_SUMS, N_TRIANGLE, accumulate, refine, solve
from tests.matchers.curvescan.scenes import MOTION, pair
from tests.reference import curvescan as slow


@pytest.mark.parametrize("inverse", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_the_gradient_is_the_derivative_of_the_residuals(seed, inverse):
    ref, cur = pair(seed)
    a, b = (ref, cur) if inverse else (cur, ref)
    pose = MOTION + np.array([0.01, -0.01, 0.004])
    n_told = 0
    for surfel in a.image.samples[:20]:
        system = np.zeros(9)
        motion = motion_of(pose, BACKWARD if inverse else FORWARD)
        accumulate(surfel[np.newaxis], b.image, motion, 0.05, 0.0, np.empty((3, 1)), system)
        if not system.any():
            continue
        n_told += 1
        moved = cs.se2.transform(cs.se2.inverse(pose) if inverse else pose, surfel[:2])
        other = b.image.surfels[reading_at(*moved, b.image)]
        e = slow.residual(pose, surfel[:2], other, inverse)
        slope = slow.jacobian(pose, surfel[:2], other, inverse)
        variance = surfel[7] + other[7] + 0.05**2
        u2 = e * e / variance
        weight = (1.0 if u2 <= 4.0 else (16.0 - u2) ** 2 / 144.0) / (variance + surfel[SHARED] + other[SHARED])
        np.testing.assert_allclose(system[6:], weight * slope * e, rtol=1e-5, atol=1e-6)
        full = weight * np.outer(slope, slope)
        np.testing.assert_allclose(system[:6], full[np.triu_indices(3)], rtol=1e-5, atol=1e-4)
    assert n_told > 15


def one_residual(n_sigmas, turn=0.0):
    """Normal equations of one reading moved along its beam to so many deviations of its own line, and turned."""
    ref, _ = pair()
    surfel = ref.image.surfels[np.argmax(ref.image.surfels[:, VARIANCE] > 0.0) + 60].copy()
    normal, centre = surfel[[NX, NY]], surfel[[CX, CY]]
    distance = n_sigmas * np.sqrt(2.0 * surfel[VARIANCE])
    surfel[[X, Y]] *= (normal @ centre + distance) / (normal @ surfel[[X, Y]])
    surfel[[NX, NY]] = cs.se2.rotation(turn) @ normal
    system = np.zeros(N_SUMS)
    accumulate(surfel[np.newaxis], ref.image, motion_of(np.zeros(3), FORWARD), 0.0, 0.0, np.empty((3, 1)), system)
    return system


@pytest.mark.parametrize("side", [-1.0, 1.0])
def test_a_residual_counts_less_from_two_deviations_on_and_nothing_from_four(side):
    full = one_residual(side)[:N_TRIANGLE]
    assert np.abs(full).max() > 1e3
    for n_sigmas, weight in ((1.9, 1.0), (2.5, 0.659), (3.0, 0.340), (3.5, 0.0977), (3.9, 0.0043)):
        # ((16 - n^2) / 12)^2 beyond two; the reading's own place moves with n
        found = one_residual(side * n_sigmas)[:N_TRIANGLE]
        assert np.trace(found.reshape(2, 3)) == pytest.approx(weight * np.trace(full.reshape(2, 3)), rel=0.1)
    assert not one_residual(4.1 * side).any()


@pytest.mark.parametrize(("turn", "is_used"), [(0.6, True), (-0.6, True), (1.0, False), (3.0, False)])
def test_a_reading_meets_only_lines_that_face_as_it_does(turn, is_used):
    assert one_residual(0.5, turn).any() == is_used


@pytest.mark.parametrize("seed", range(5))
def test_the_solution_is_that_of_the_equations(seed):
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(5, 3))
    matrix, gradient = root.T @ root, rng.normal(size=3)
    system = np.concatenate([matrix[np.triu_indices(3)], gradient])
    expected = -np.linalg.solve(matrix + 0.1 * np.eye(3), gradient)
    np.testing.assert_allclose(solve(system, 0.1), expected)


def test_a_start_nearby_ends_at_the_truth():
    errors = []
    for seed in range(10):
        ref, cur = pair(seed)
        rng = np.random.default_rng(seed)
        start = MOTION + rng.uniform([-0.1, -0.1, -0.04], [0.1, 0.1, 0.04])
        probed = refine(start[np.newaxis], ref.image, cur.image, np.array([0.06, 0.03, 0.01]))
        final = refine(probed, ref.full_image, cur.full_image, np.array([0.0, 0.0]))
        errors.append(cs.se2.between(MOTION, final[0]))
    # 5 mm of noise on several hundred readings
    assert np.abs(errors)[:, :2].max() < 0.003
    assert np.abs(errors)[:, 2].max() < 0.002


def test_a_scan_and_itself_stay_where_they_are():
    ref, _ = pair()
    pose = refine(np.zeros((1, 3)), ref.full_image, ref.full_image, np.array([0.02, 0.0, 0.0]))
    np.testing.assert_allclose(pose, 0.0, atol=1e-12)


def test_converged_scans_swapped_give_the_inverse():
    ref, cur = pair()
    sigmas = np.zeros(12)
    there = refine(MOTION[np.newaxis], ref.full_image, cur.full_image, sigmas)[0]
    back = refine(cs.se2.inverse(MOTION)[np.newaxis], cur.full_image, ref.full_image, sigmas)[0]
    np.testing.assert_allclose(cs.se2.compose(there, back), 0.0, atol=2e-5)


def test_the_start_is_left_alone_and_the_turn_wrapped():
    ref, cur = pair()
    start = np.array([[0.0, 0.0, 3.1415], [5.0, 5.0, -3.1415]])
    kept = start.copy()
    refined = refine(start, ref.image, cur.image, np.array([0.06, 0.02]))
    np.testing.assert_array_equal(start, kept)
    assert (np.abs(refined[:, 2]) <= np.pi).all()
    assert np.isfinite(refined).all()
    with pytest.raises(cs.InvalidArgumentError, match="quick must be lengths"):
        RefinementConfig(quick=(-1.0,))
