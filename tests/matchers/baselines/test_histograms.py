"""Histograms on a ring and the lag at which two agree best."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from curvescan.matchers.baselines.histogram import best_lag, ring_histogram


def bumps(shift=0.0, n=128):
    places = np.array([10.0, 40.5, 41.0, 97.25]) + shift
    return ring_histogram(places, np.array([1.0, 2.0, 1.0, 3.0]), n, 2.0)


@given(st.floats(-1e3, 1e3), st.floats(0.0, 5.0))
def test_a_histogram_holds_its_weights_around_its_place(place, smoothing):
    histogram = ring_histogram(np.array([place]), np.array([2.5]), 64, smoothing)
    assert histogram.sum() == pytest.approx(2.5)
    # the first Fourier coefficient tells the mean place on a ring
    phase = np.angle(np.sum(histogram * np.exp(2j * math.pi * np.arange(64) / 64)))
    away = (phase * 64 / (2 * math.pi) - place + 32) % 64 - 32
    assert abs(away) < 0.01


def test_smoothing_is_a_bell_of_that_width():
    histogram = ring_histogram(np.array([32.0]), np.ones(1), 64, 3.0)
    bell = np.exp(-0.5 * ((np.arange(64) - 32) / 3.0) ** 2)
    np.testing.assert_allclose(histogram, bell / bell.sum(), atol=1e-9)


@given(st.floats(-20.0, 20.0))
def test_the_lag_is_found_between_bins(shift):
    peak = best_lag(bumps(shift), bumps(), 0.0, 30.0)
    # the parabola through three points of a bell, and bins that share an entry linearly
    assert peak.lag == pytest.approx(shift, abs=0.03)
    assert peak.agreement == pytest.approx(1.0, abs=0.02)


@given(st.floats(-20.0, 20.0))
def test_swapped_histograms_have_the_opposite_lag(shift):
    there = best_lag(bumps(shift), bumps(), 0.0, 30.0)
    back = best_lag(bumps(), bumps(shift), 0.0, 30.0)
    assert there.lag == pytest.approx(-back.lag, abs=1e-9)


def test_lags_outside_the_window_are_not_found():
    assert best_lag(bumps(20.0), bumps(), 0.0, 60.0).lag == pytest.approx(20.0, abs=0.05)
    near = best_lag(bumps(20.0), bumps(), 0.0, 5.0)
    assert near is None or abs(near.lag) <= 6.0
    assert best_lag(bumps(20.0), bumps(), 18.0, 5.0).lag == pytest.approx(20.0, abs=0.05)
    assert best_lag(bumps(100.0), bumps(), 100.0, 5.0).lag == pytest.approx(100.0, abs=0.05)


def test_the_width_of_a_peak_is_that_of_both_bells():
    one = ring_histogram(np.array([20.0]), np.ones(1), 128, 3.0)
    peak = best_lag(one, one, 0.0, 10.0)
    # two bells of 3 bins correlate to one of 3 sqrt(2); the parabola through whole bins sees it 2 % wider
    assert peak.width == pytest.approx(3.0 * math.sqrt(2.0), rel=0.03)


def test_no_histogram_and_a_border_are_no_peak():
    assert best_lag(np.zeros(32), bumps(n=32), 0.0, 5.0) is None
    slope = np.exp(-0.5 * ((np.arange(128) - 64) / 20.0) ** 2)
    assert best_lag(np.roll(slope, 30), slope, 0.0, 5.0) is None
    # a flat histogram agrees with itself everywhere: no peak has a width
    assert best_lag(np.ones(64), np.ones(64), 0.0, 5.0).width > 1e3
