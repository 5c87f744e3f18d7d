"""Surfaces: readings in sweep order, breakpoints, lines, range noise."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

import curvescan as cs
from curvescan.consensus.config import SurfacesConfig
from curvescan.consensus.surfaces import fit_line, fit_surfels, moments, sweep
from tests.consensus_scenes import features, pillar_scan
from tests.reference import consensus as slow
from tests.scenes import room_scan

CONFIG = SurfacesConfig()


def run_sweep(scan, told_by_angles=False):
    return sweep(
        scan.ranges,
        scan.directions,
        scan.valid,
        scan.angle_increment < 0,
        scan.is_full_circle,
        abs(scan.angle_increment),
        scan.angles if told_by_angles else scan.angles[:0],
        CONFIG.incidence_limit,
        CONFIG.max_gap,
    )


@pytest.mark.parametrize("fov", [math.pi, 2 * math.pi])
@pytest.mark.parametrize("seed", range(4))
def test_surfaces_are_those_of_the_slow_twin(fov, seed):
    rng = np.random.default_rng(seed)
    scan = pillar_scan(rng.uniform(-0.4, 0.4, 3), sigma=0.01, seed=seed, fov=fov, n_beams=181)
    ranges = scan.ranges.copy()
    ranges[rng.choice(181, 25, replace=False)] = np.nan
    scan = cs.LaserScan(
        ranges, angle_min=scan.angle_min, angle_increment=scan.angle_increment, range_max=20.0
    )
    beam_idx, readings, bounds = run_sweep(scan)
    beams = np.flatnonzero(scan.valid)
    expected = slow.surfaces(
        scan.points[beams],
        scan.ranges[beams],
        beams,
        181,
        scan.is_full_circle,
        scan.angle_increment,
        CONFIG.incidence_limit,
        CONFIG.max_gap,
    )
    found = [beam_idx[a:b].tolist() for a, b in itertools.pairwise(bounds)]
    assert sorted(found) == sorted([beams[i] for i in group] for group in expected)
    np.testing.assert_allclose(readings[:, :2], scan.points[beam_idx])
    np.testing.assert_array_equal(readings[:, 2], scan.ranges[beam_idx])


def test_a_clockwise_sweep_is_its_mirror_image():
    scan = pillar_scan(seed=3)
    mirrored = cs.LaserScan(
        scan.ranges[::-1],
        angle_min=scan.angles[-1],
        angle_increment=-scan.angle_increment,
        range_max=20.0,
    )
    beam_idx, readings, bounds = run_sweep(scan)
    beam_mirrored, readings_mirrored, bounds_mirrored = run_sweep(mirrored)
    np.testing.assert_array_equal(beam_mirrored, 360 - beam_idx)
    np.testing.assert_allclose(readings_mirrored, readings, atol=1e-12)
    np.testing.assert_array_equal(bounds_mirrored, bounds)


@pytest.mark.parametrize("fov", [math.pi, 2 * math.pi - math.radians(1.0)])
@pytest.mark.parametrize("way", [1, -1])
def test_beams_told_one_by_one_give_the_same_surfaces(fov, way):
    scan = pillar_scan(seed=4, fov=fov, n_beams=360)
    ranges = scan.ranges.copy()
    ranges[np.random.default_rng(4).choice(360, 40, replace=False)] = np.nan
    angles = scan.angles
    scan = cs.LaserScan(ranges[::way], angles=angles[::way], range_max=20.0)
    for grid, told in zip(run_sweep(scan), run_sweep(scan, told_by_angles=True), strict=True):
        np.testing.assert_array_equal(told, grid)


@pytest.mark.parametrize("seed", range(5))
def test_a_line_is_that_of_the_scatter(seed):
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(30, 2)) @ rng.normal(size=(2, 2)) + rng.uniform(-40, 40, 2)
    readings = np.column_stack([points, np.hypot(*points.T)])
    cx, cy, ux, uy, across, along = fit_line(moments(readings), 4, 20)
    centre, direction, slow_across, slow_along = slow.line(points[4:21])
    np.testing.assert_allclose([cx, cy], centre)
    assert abs(ux * direction[1] - uy * direction[0]) < 1e-9
    np.testing.assert_allclose([across, along], [slow_across, slow_along], rtol=1e-6)


def test_lines_of_a_noise_free_room_are_its_walls():
    scan = room_scan()
    surfels, sigma = fit(scan)
    # every reading lies on its line, and every line along a wall: none bends around a corner but in the corner itself
    across = np.sum((surfels[:, :2] - surfels[:, 3:5]) * surfels[:, 5:7], axis=1)
    is_wall = (np.abs(across) < 1e-6) & (np.abs(surfels[:, 5:7]).max(axis=1) > 1 - 1e-9)
    assert np.count_nonzero(~is_wall) <= 4
    assert (np.sum(surfels[:, :2] * surfels[:, 5:7], axis=1) < 0).all()  # facing the sensor
    assert sigma == CONFIG.range_sigma_min


def fit(scan):
    _, readings, bounds = run_sweep(scan)
    return fit_surfels(readings, moments(readings), bounds, CONFIG.arm, CONFIG.range_sigma_min)


@pytest.mark.parametrize("sigma", [0.005, 0.01, 0.015])
def test_the_range_noise_is_found(sigma):
    found = [fit(room_scan(sigma=sigma, seed=seed))[1] for seed in range(10)]
    assert 0.9 * sigma < np.mean(found) < 1.1 * sigma


def test_scans_of_few_readings_have_no_lines():
    blank = cs.LaserScan([np.nan] * 90, angle_min=-1.0, angle_increment=0.02)
    assert len(features(blank).view.surfels) == 0
    lonely = cs.LaserScan(
        [np.nan] * 40 + [1.0, 1.01] + [np.nan] * 48, angle_min=-1.0, angle_increment=0.02
    )
    surfels = features(lonely).view.surfels
    assert len(surfels) == 2
    assert (surfels[:, 7] < 0).all()  # a reading without a line says so by its variance
    assert np.isfinite(surfels).all()


@pytest.mark.parametrize(
    "wrong", [{"arm": 0.0}, {"incidence_limit": 2.0}, {"max_gap": -1}, {"range_sigma_min": 0.0}]
)
def test_wrong_parameters_are_named(wrong):
    with pytest.raises(cs.InvalidArgumentError, match=next(iter(wrong))):
        SurfacesConfig(**wrong)
