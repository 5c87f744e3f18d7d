"""Pairing of curvature functions (eq. 6) against sums without a Fourier transform."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from curvescan import InvalidArgumentError
from curvescan.matchers.cfsma.config import FunctionsConfig
from curvescan.matchers.cfsma.functions import correlations, pair_functions, spectra
from tests.reference import cfsma as twin

LENGTH = 64


def some_functions(seed, lengths):
    rng = np.random.default_rng(seed)
    eta = rng.standard_normal(sum(lengths)) * (rng.uniform(size=sum(lengths)) < 0.3)
    stops = np.cumsum(lengths)
    return eta, stops - lengths, stops


@given(
    st.integers(0, 10_000),
    st.lists(st.integers(3, 200), min_size=1, max_size=5),
    st.lists(st.integers(3, 200), min_size=1, max_size=5),
)
def test_agrees_with_the_slow_twin(seed, lengths_cur, lengths_ref):
    cur = some_functions(seed, lengths_cur)
    ref = some_functions(seed + 1, lengths_ref)
    fast = correlations(spectra(*cur, LENGTH), spectra(*ref, LENGTH), LENGTH)
    slow_cur, slow_ref = (
        [twin.resample(eta[a:b], LENGTH) for a, b in zip(starts, stops, strict=True)]
        for eta, starts, stops in (cur, ref)
    )
    slow = [[twin.correlation(c, r) for r in slow_ref] for c in slow_cur]
    # 64 products and a transform of them: a few units of the sixteenth digit
    np.testing.assert_allclose(fast, slow, atol=1e-12)


@given(st.integers(0, 10_000), st.integers(3, 300))
def test_a_function_correlates_with_itself_fully_and_with_nothing_more(seed, n):
    eta, starts, stops = some_functions(seed, [n])
    eta[0] = 1.0
    spectrum = spectra(eta, starts, stops, LENGTH)
    assert correlations(spectrum, spectrum, LENGTH)[0, 0] == pytest.approx(1.0, abs=1e-12)
    other = spectra(*some_functions(seed + 1, [n]), LENGTH)
    assert abs(correlations(spectrum, other, LENGTH)[0, 0]) <= 1.0 + 1e-12


def test_a_shifted_corner_correlates_fully():
    cur, ref = np.zeros(LENGTH), np.zeros(LENGTH)
    cur[20], ref[41] = 1.5, 1.5
    whole = (np.array([0]), np.array([LENGTH]))
    upsilon = correlations(spectra(cur, *whole, LENGTH), spectra(ref, *whole, LENGTH), LENGTH)
    assert upsilon[0, 0] == pytest.approx(1.0, abs=1e-12)


def test_a_corner_one_reading_wide_survives_a_long_segment():
    eta = np.zeros(1000)
    eta[501] = 1.5
    spectrum = spectra(eta, np.array([0]), np.array([1000]), LENGTH)
    assert np.abs(spectrum).max() > 0.9


def test_a_straight_line_correlates_with_nothing():
    eta = np.zeros(50)
    spectrum = spectra(eta, np.array([0]), np.array([50]), LENGTH)
    assert not spectrum.any()
    assert correlations(spectrum, spectrum, LENGTH)[0, 0] == 0.0


@given(st.integers(0, 10_000), st.integers(0, 8), st.integers(0, 8), st.floats(0.0, 1.0))
def test_pairs_agree_with_the_slow_twin(seed, n_cur, n_ref, least):
    upsilon = np.random.default_rng(seed).uniform(-1, 1, (n_cur, n_ref))
    cur_idx, ref_idx = pair_functions(upsilon, FunctionsConfig(min_correlation=least))
    assert list(zip(cur_idx, ref_idx, strict=True)) == twin.pair_functions(upsilon, least)
    assert len(set(cur_idx)) == len(cur_idx)
    assert len(set(ref_idx)) == len(ref_idx)


def test_no_functions_no_pairs():
    none = spectra(np.zeros(0), np.zeros(0, int), np.zeros(0, int), LENGTH)
    one = spectra(*some_functions(1, [20]), LENGTH)
    assert correlations(none, one, LENGTH).shape == (0, 1)
    assert pair_functions(correlations(one, none, LENGTH), FunctionsConfig())[0].size == 0


@pytest.mark.parametrize("length", [0, 4, 100])
def test_length_must_be_a_power_of_two(length):
    with pytest.raises(InvalidArgumentError, match=f"power of two, at least 8, got {length}"):
        FunctionsConfig(length=length)


def test_correlation_threshold_must_be_a_correlation():
    with pytest.raises(InvalidArgumentError, match=r"must lie in \[0, 1\], got 1.5"):
        FunctionsConfig(min_correlation=1.5)
