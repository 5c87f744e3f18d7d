"""Support: probabilities of one pose and of others, and rows of equal things."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan.matchers.curvescan.assessment.support import Support, regular_rows


def test_two_poses_to_either_side_make_a_row_of_equal_things():
    shares = {1: 0.4, 2: 0.4}
    row = np.array([[0.1, 0.2, 0.3], [1.3, 0.2, 0.3], [-1.0, 0.2, 0.3]])
    assert regular_rows(row, shares) == (1, 2)
    assert Support(log_odds=3.0, rivals={}, repetitions=shares, regular=(1, 2)).repeated() == [1, 2]
    for k, change in ((2, [0.5, 0.0, 0.0]), (2, [0.0, 0.5, 0.0]), (1, [0.0, 0.0, 0.2])):
        other = row.copy()
        other[k] += change
        assert regular_rows(other, shares) == ()
    assert regular_rows(row * [0.3, 1.0, 1.0], shares) == ()  # too near to be another thing
    assert regular_rows(row, {1: 0.4, 2: 0.2}) == ()


def test_probabilities_sum_to_one():
    support = Support(log_odds=1.0, rivals={1: 0.0, 2: -1.0}, repetitions={1: 0.1, 2: 0.1})
    best = support.confidence
    nothing = best * np.exp(-1.0)
    assert best + best * np.exp(0.0) + best * np.exp(-1.0) + nothing == pytest.approx(1.0)
    assert support.is_related == pytest.approx(1.0 - nothing)
    assert support.confidence_with([1, 2]) == pytest.approx(1.0 - nothing)
