"""Sensors: noise, dropouts and codes as their definition says."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from curvescan.errors import InvalidArgumentError
from curvescan.simulation import SENSORS, measure

SENSOR = replace(SENSORS["sick-lms200"], range_min=0.1, sigma_range=0.02, dropout=0.1)
N = 20_000


def measured(exact, sensor=SENSOR, seed=0):
    return measure(np.asarray(exact, dtype=np.float64), sensor, np.random.default_rng(seed))


def test_noise_is_normal_with_the_sensors_deviation():
    error = measured(np.full(N, 4.0)) - 4.0
    error = error[np.isfinite(error)]
    # five standard errors of the mean and of the deviation
    assert abs(error.mean()) < 5.0 * SENSOR.sigma_range / np.sqrt(error.size)
    assert abs(error.std() / SENSOR.sigma_range - 1.0) < 5.0 / np.sqrt(2.0 * error.size)
    assert np.mean(np.abs(error) < SENSOR.sigma_range) == pytest.approx(0.6827, abs=0.02)


def test_dropouts_are_nan_and_as_many_as_asked():
    share = np.isnan(measured(np.full(N, 4.0))).mean()
    assert abs(share - 0.1) < 5.0 * np.sqrt(0.1 * 0.9 / N)


def test_nothing_in_range_is_plus_infinity_also_for_a_dropout():
    assert np.all(measured(np.full(N, np.inf)) == np.inf)
    far = measured([8.5] * 300)  # cast a little beyond range_max, but not seen
    assert np.all(np.isnan(far) | (far == np.inf))


def test_noise_decides_at_the_limit_of_the_range():
    at_limit = measured(np.full(N, SENSOR.range_max), replace(SENSOR, dropout=0.0))
    assert np.mean(np.isinf(at_limit)) == pytest.approx(0.5, abs=5.0 * 0.5 / np.sqrt(N))
    assert np.all(at_limit[np.isfinite(at_limit)] <= SENSOR.range_max)


def test_too_near_is_minus_infinity():
    assert np.all(measured([0.001] * 50, replace(SENSOR, sigma_range=0.0, dropout=0.0)) == -np.inf)


def test_a_perfect_sensor_tells_the_truth():
    exact = np.array([0.1, 1.0, 7.99, 8.0])
    perfect = replace(SENSOR, sigma_range=0.0, dropout=0.0)
    assert np.array_equal(measured(exact, perfect), exact)


def test_the_noise_of_a_beam_does_not_depend_on_the_others():
    first = measured(np.full(100, 4.0))
    exact = np.full(100, 4.0)
    exact[:50] = np.inf
    assert np.array_equal(measured(exact)[50:], first[50:], equal_nan=True)


def test_the_argument_is_not_changed():
    exact = np.full(5, 9.0)
    measured(exact)
    assert np.array_equal(exact, np.full(5, 9.0))


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"n_beams": 0}, "n_beams must be >= 1"),
        ({"angle_increment": 0.0}, "angle_increment must not be 0"),
        ({"range_min": 9.0}, "0 <= range_min < range_max"),
        ({"range_max": np.inf}, "range_max must be finite"),
        ({"sigma_range": -0.1}, "sigma_range must be >= 0"),
        ({"sigma_range": np.nan}, "sigma_range must be >= 0"),
        ({"dropout": 1.5}, r"dropout must lie in \[0, 1\]"),
        ({"period": 0.0}, "period must be > 0"),
        ({"time_increment": -1e-6}, "time_increment must be >= 0"),
        ({"time_increment": 1.0}, "n_beams of it at most a period"),
    ],
)
def test_bad_sensors_are_refused(bad, message):
    with pytest.raises(InvalidArgumentError, match=message):
        replace(SENSOR, **bad)
