"""Covariance: the information of the fit, its principal directions, and what is open."""

from __future__ import annotations

import math

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.assessment.information import (
    CHI2,
    COUNT,
    INFORMATION,
    LEVER2,
    SPURIOUS,
    add_information,
    matrices,
    pose_information,
)
from curvescan.matchers.curvescan.association import BACKWARD, FORWARD
from curvescan.matchers.curvescan.config import InformationConfig
from curvescan.matchers.curvescan.features.surfels import N_COLUMNS, NX, NY, SHARED, TILT, VARIANCE, X, Y
from curvescan.matchers.curvescan.refinement import refine
from tests.matchers.curvescan.scenes import MOTION, compare_readings, features, hall_scan, no_objects, pair, pillar_scan
from tests.reference import curvescan as slow


def information_at(ref, cur, pose):
    _, partner_cur = compare_readings(cur.image.surfels, ref, pose, 0.01)
    _, partner_ref = compare_readings(ref.image.surfels, cur, cs.se2.inverse(pose), 0.01)
    arguments = (ref.image.surfels, partner_ref, cur.image.surfels, partner_cur, pose)
    return arguments, information_of(*arguments)


def information_of(ref, partner_ref, cur, partner_cur, pose):
    """The information of the whole contour."""
    scan = pair()[0]
    scans = [scan._replace(image=scan.image._replace(surfels=one), objects=no_objects(len(one))) for one in (ref, cur)]
    return pose_information(*scans, (partner_ref, partner_cur), pose, 0.0)[:4]


@pytest.mark.parametrize("seed", range(3))
def test_the_information_is_that_of_the_slow_twin(seed):
    ref, cur = pair(seed)
    arguments, (information, spurious, axes, units) = information_at(ref, cur, MOTION)
    net = axes @ np.diag(information) @ axes.T / np.outer(units, units)
    expected = slow.information(*arguments)
    # what tilt gives is small in a room, and taken off
    assert (spurious < 0.1 * information).all()
    np.testing.assert_allclose(np.diag(net), np.diag(expected), rtol=0.05)
    assert (np.diag(net) <= np.diag(expected) * (1 + 1e-6)).all()
    matrix, cov = matrices(information, axes, units, np.zeros(3, dtype=bool), 1.0)
    np.testing.assert_array_equal(cov, cov.T)
    np.testing.assert_allclose(matrix, net, rtol=1e-9)
    np.testing.assert_allclose(cov @ net, np.eye(3), atol=1e-6)


@pytest.mark.parametrize("way", [FORWARD, BACKWARD])
def test_the_spurious_part_is_what_a_tilt_of_the_line_gives(way):
    """The derivative of a normal by its tilt is the normal turned by 90 degrees: so is that of the whole row."""
    one, line = np.ones((2, 1, N_COLUMNS))
    one[0, [X, Y, VARIANCE]] = 1.3, -0.4, 1e-4
    line[0, [X, Y, NX, NY, VARIANCE, TILT]] = 1.2, 0.1, 0.6, 0.8, 1e-4, 1e-6
    across = line.copy()
    across[0, [NX, NY]] = -0.8, 0.6
    pose = np.array([0.3, 0.2, 0.7])
    sums, sums_across = np.zeros((2, LEVER2 + 1))
    for other, total in ((line, sums), (across, sums_across)):
        parts = np.zeros((1, CHI2))
        objects = no_objects(len(one)), no_objects(len(other))
        add_information(one, other, objects, np.array([0]), pose, way, total, parts)
        assert not parts.any()
    n = SPURIOUS - INFORMATION
    expected = 1e-6 * sums_across[INFORMATION : INFORMATION + n]
    np.testing.assert_allclose(sums[SPURIOUS : SPURIOUS + n], expected, rtol=1e-9)


@pytest.mark.parametrize("off", [0.0, 0.01, 0.03])
def test_what_is_left_and_what_is_spurious_are_all_of_it(off):
    """Also where residuals exceed the noise: then both are less, by the mean of their normalised squares."""
    ref, cur = pair(1)
    arguments, (information, spurious, axes, units) = information_at(ref, cur, MOTION + np.array([off, 0.0, 0.0]))
    expected = axes.T @ (slow.information(*arguments) * np.outer(units, units)) @ axes
    # derivatives by differences in the twin
    np.testing.assert_allclose(information + spurious, np.diag(expected), rtol=1e-3)
    assert spurious[0] > 1e-3 * information[0]


def test_residuals_above_the_noise_widen_the_covariance_and_smaller_ones_do_not_narrow_it():
    ref, cur = pair(1)
    arguments, (information, *_) = information_at(ref, cur, MOTION)
    # the same readings, taken for more and for less noisy than they are
    for factor, expected in ((0.04, 1.0), (25.0, 25.0)):
        ref_surfels, partner_ref, cur_surfels, partner_cur, pose = arguments
        surfels = [one.copy() for one in (ref_surfels, cur_surfels)]
        for one in surfels:
            one[one[:, VARIANCE] > 0.0, VARIANCE] /= factor
            one[:, SHARED] /= factor
        found, *_ = information_of(surfels[0], partner_ref, surfels[1], partner_cur, pose)
        # information in proportion to 1 / variance, and then divided by what residuals exceed the noise
        np.testing.assert_allclose(found / information, factor / expected, rtol=0.25)


def test_residuals_of_plain_noise_have_a_mean_square_of_one():
    means = []
    for seed in range(6):
        ref, cur = pair(seed)
        (ref_surfels, partner_ref, cur_surfels, partner_cur, pose), _ = information_at(ref, cur, MOTION)
        system = np.zeros(LEVER2 + 1)
        walls, parts = [no_objects(len(one)) for one in (ref_surfels, cur_surfels)], np.zeros((1, CHI2))
        add_information(cur_surfels, ref_surfels, (walls[1], walls[0]), partner_cur, pose, FORWARD, system, parts)
        add_information(ref_surfels, cur_surfels, (walls[0], walls[1]), partner_ref, pose, BACKWARD, system, parts)
        means.append(system[CHI2] / system[COUNT])
    # of 300 readings each, with neighbours that share their lines
    assert np.mean(means) == pytest.approx(1.0, abs=0.12)


@pytest.mark.slow
def test_the_covariance_is_that_of_a_monte_carlo():
    errors, predicted = [], []
    for seed in range(200):
        ref, cur = pair(seed)
        for scan in (ref, cur):  # the pillars stand still
            scan.image.surfels[:, SHARED] = 0.0
        pose = refine(MOTION[np.newaxis], ref.full_image, cur.full_image, np.array([0.0, 0.0]))[0]
        _, (information, _, axes, units) = information_at(ref, cur, pose)
        errors.append(pose - MOTION)
        predicted.append(matrices(information, axes, units, np.zeros(3, dtype=bool), 1.0)[1])
    nees = [e @ np.linalg.solve(c, e) for e, c in zip(errors, predicted, strict=True)]
    # chi-square of 3 degrees of freedom: mean 3, and of 200 of them a standard error of 0.17
    assert 2.3 < np.mean(nees) < 3.7
    ratio = np.std(errors, axis=0) / np.sqrt(np.mean(predicted, axis=0).diagonal())
    assert (np.abs(ratio - 1.0) < 0.25).all()


def test_a_corridor_has_no_information_along_itself():
    for seed in range(10):
        ref = features(hall_scan(0.0, seed=2 * seed))
        cur = features(hall_scan(0.3, seed=2 * seed + 1))
        _, (information, spurious, axes, units) = information_at(ref, cur, np.zeros(3))
        assert abs(axes[0, 0]) > 0.98
        assert information[0] < 2.0 * spurious[0] or information[0] < 100.0
        assert information[1] > 1e4
        _, cov = matrices(tuple(information), axes, units, (True, False, False), 1.0)
        assert abs(math.sqrt(cov[0, 0]) - 1.0) < 0.05
        assert math.sqrt(cov[1, 1]) < 0.05


def test_an_open_turn_about_a_far_place_widens_the_position():
    axes = np.eye(3)[:, [2, 0, 1]]
    is_degenerate = (True, False, False)
    _, plain = matrices((1.0, 1e6, 1e6), axes, np.ones(3), is_degenerate, 0.4)
    np.testing.assert_allclose(np.diag(plain), [1e-6, 1e-6, 0.16])
    c, s = math.cos(0.6), math.sin(0.6)
    axes = np.array([[s, c, 0.0], [0.0, 0.0, 1.0], [c, -s, 0.0]])
    _, arc = matrices((1.0, 1e6, 1e6), axes, np.ones(3), is_degenerate, 0.4)
    assert arc[1, 1] > 1e-4
    assert np.linalg.eigvalsh(arc).min() > 0


def test_no_partners_have_no_information():
    one = features(pillar_scan())
    nobody = np.full(len(one.image.surfels), -1)
    information, spurious, _, _ = information_of(one.image.surfels, nobody, one.image.surfels, nobody, np.zeros(3))
    assert not information.any()
    assert not spurious.any()
    with pytest.raises(cs.InvalidArgumentError, match="max_sigma must be > 0"):
        InformationConfig(max_sigma=0.0)
