"""Correlation of histograms, and its peaks."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan.matchers.curvescan.proposal.hypotheses import correlate, peaks_of


@pytest.mark.parametrize("first", [0, 3, -5, 21])
def test_a_correlation_is_the_sum_of_products_at_each_shift(first):
    rng = np.random.default_rng(1)
    one, other = rng.uniform(size=16), np.where(rng.uniform(size=16) < 0.5, 0.0, rng.uniform(size=16))
    likeness = np.ones(7)
    correlate(likeness, np.tile(one, 2), other, first)
    expected = [1.0 + sum(other[k] * one[(k + first + shift) % 16] for k in range(16)) for shift in range(7)]
    np.testing.assert_allclose(likeness, expected)


def test_peaks_come_by_height_and_lie_between_bins():
    bins = np.arange(24)
    likeness = np.maximum(3.0 - (bins - 5.25) ** 2, 0.0) + np.maximum(2.0 - (bins - 15.0) ** 2, 0.0)
    places, heights = peaks_of(likeness, 5)
    np.testing.assert_allclose(places, [5.25, 15.0])
    np.testing.assert_allclose(heights, [likeness[5], 2.0])
    np.testing.assert_allclose(peaks_of(likeness, 1)[0], [5.25])
    # the histogram goes round, a plateau is one peak, and nothing is none
    np.testing.assert_allclose(peaks_of(np.roll(likeness, -5), 1)[0], [0.25])
    assert len(peaks_of(np.array([0.0, 2.0, 2.0, 0.0]), 4)[0]) == 1
    assert len(peaks_of(np.zeros(8), 3)[0]) == 0
