"""Support: probabilities of one pose and of others, and rows of equal things."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan.matchers.curvescan.assessment.assessment import Support
from curvescan.matchers.curvescan.assessment.assessment import regular_rows as rows_of
from curvescan.matchers.curvescan.assessment.confidence import WeighedPoses
from curvescan.matchers.curvescan.assessment.evidence import N_EVIDENCE


def regular_rows(poses, shares):
    n = len(poses)
    return rows_of(WeighedPoses(poses, np.zeros(n), np.zeros((n, N_EVIDENCE)), np.zeros(n), np.zeros(n)), shares)


def test_two_poses_to_either_side_make_a_row_of_equal_things():
    shares = {1: 0.4, 2: 0.4}
    row = np.array([[0.1, 0.2, 0.3], [1.3, 0.2, 0.3], [-1.0, 0.2, 0.3]])
    assert regular_rows(row, shares) == (1, 2)
    for k, change in ((2, [0.5, 0.0, 0.0]), (2, [0.0, 0.5, 0.0]), (1, [0.0, 0.0, 0.2])):
        other = row.copy()
        other[k] += change
        assert regular_rows(other, shares) == ()
    assert regular_rows(row * [0.3, 1.0, 1.0], shares) == ()  # too near to be another thing
    assert regular_rows(row, {1: 0.4, 2: 0.2}) == ()


def test_probabilities_are_shares_of_all_odds():
    support = Support(log_odds=1.0, rivals={1: 0.0, 2: -1.0}, repeated=[])
    accept, unsupported = support.probabilities()
    assert unsupported == pytest.approx(accept * np.exp(-1.0))
    assert 1.0 - accept - unsupported == pytest.approx(accept * (np.exp(0.0) + np.exp(-1.0)))
    held, unsupported = support.probabilities([1, 2])
    assert held == pytest.approx(1.0 - unsupported)
