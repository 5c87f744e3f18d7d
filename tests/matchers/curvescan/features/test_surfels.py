"""Surfels: lines through readings, and the range noise of a scan."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.config import SegmentsConfig
from curvescan.matchers.curvescan.features.surfels import (
    NX,
    NY,
    RANGE,
    VARIANCE,
    X,
    Y,
    fit_line,
    fit_lines,
    fit_surfels,
    low_quantile,
    moments,
)
from tests.matchers.curvescan.features.test_segments import run_sweep
from tests.matchers.curvescan.scenes import features
from tests.reference import curvescan as slow
from tests.scenes import room_scan

CONFIG = SegmentsConfig()


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
    assert sigma < CONFIG.range_sigma_min
    facing2 = (np.sum(surfels[:, [X, Y]] * surfels[:, [NX, NY]], axis=1) / surfels[:, RANGE]) ** 2
    assert np.median(surfels[:, VARIANCE] / facing2) == pytest.approx(CONFIG.range_sigma_min**2, rel=0.01)


def fit(scan):
    _, readings, bounds = run_sweep(scan)
    step = abs(scan.angle_increment)
    growth = scan.noise_doubled_at**-2.0
    fits, sigma = fit_lines(readings, bounds, CONFIG.arm, growth)
    return fit_surfels(readings, fits, step, (sigma, growth, CONFIG.range_sigma_min)), sigma


@pytest.mark.parametrize("sigma", [0.005, 0.01, 0.015, 0.04])
def test_the_range_noise_is_found(sigma):
    found = [fit(room_scan(sigma=sigma, seed=seed))[1] for seed in range(10)]
    assert 0.9 * sigma < np.mean(found) < 1.1 * sigma


@pytest.mark.parametrize("doubled_at", [0.5, 1.0])
def test_noise_that_grows_with_the_range_is_found_at_the_sensor_and_is_more_far_away(doubled_at):
    found, ratios = [], []
    for seed in range(10):
        exact = room_scan()
        growth = np.sqrt(1.0 + (exact.ranges / doubled_at) ** 2)
        noise = 0.006 * growth * np.random.default_rng(seed).standard_normal(len(exact))
        surfels, sigma = fit(replace(exact, ranges=exact.ranges + noise, noise_doubled_at=doubled_at))
        facing = np.sum(surfels[:, [X, Y]] * surfels[:, [NX, NY]], axis=1) / surfels[:, RANGE]
        expected = 0.006**2 * facing**2 * (1.0 + (surfels[:, RANGE] / doubled_at) ** 2)
        ratios.append(np.median((surfels[:, VARIANCE] / expected)[facing < -0.7]))
        found.append(sigma)
    assert 0.9 * 0.006 < np.mean(found) < 1.1 * 0.006
    assert 0.8 < np.mean(ratios) < 1.2


def test_scans_of_few_readings_have_no_lines():
    blank = cs.LaserScan([np.nan] * 90, angle_min=-1.0, angle_increment=0.02)
    assert len(features(blank).image.surfels) == 0
    lonely = cs.LaserScan([np.nan] * 40 + [1.0, 1.01] + [np.nan] * 48, angle_min=-1.0, angle_increment=0.02)
    surfels = features(lonely).image.surfels
    assert len(surfels) == 2
    assert (surfels[:, 7] < 0).all()  # a reading without a line says so by its variance
    assert np.isfinite(surfels).all()


@pytest.mark.parametrize("scale", [1e-7, 1e-4, 0.1])
def test_the_low_quantile_is_found_without_sorting(scale):
    variances = scale * np.random.default_rng(0).chisquare(5, size=2000) / 5
    assert low_quantile(variances) == pytest.approx(np.quantile(variances, 0.4), rel=0.01)


def test_the_low_quantile_of_none_is_zero_and_of_what_is_beyond_all_bins_the_end_of_them():
    assert low_quantile(np.empty(0)) == 0.0
    assert low_quantile(np.zeros(9)) < 1e-8
    assert 0.8 < low_quantile(np.full(9, 50.0)) <= 1.0
