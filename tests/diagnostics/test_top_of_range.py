"""TopOfRange: codes for no reading that a log does not declare, and real surfaces far away that are none."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan.diagnostics.top_of_range import TopOfRange
from curvescan.scan import LaserScan


def counted(rows):
    top = TopOfRange()
    for row in rows:
        top.add(LaserScan(row, angle_min=-1.57, angle_increment=0.0174, range_max=80.0))
    return top


def moving_sensor(n_scans=200, n_beams=180, seed=4):
    return np.random.default_rng(seed).uniform(1.0, 30.0, (n_scans, n_beams))


def test_several_codes_just_below_the_limit_are_one_band():
    rng = np.random.default_rng(5)
    rows = moving_sensor()
    is_code = rng.random(rows.shape) < 0.006
    rows[is_code] = rng.choice([51.05, 51.10, 51.16], is_code.sum())
    rows[3, 7] = 60.0  # one stray above hides nothing
    low, high, share = counted(rows).code_band()
    assert 50.9 < low <= 51.05
    assert 51.16 <= high < 51.3
    assert share == pytest.approx(is_code.mean(), rel=0.02)


def test_a_log_without_codes_has_no_band():
    assert counted(moving_sensor()).code_band() is None
    assert TopOfRange().code_band() is None


def test_the_far_end_of_a_corridor_seen_by_a_standing_sensor_is_no_code():
    rng = np.random.default_rng(6)
    rows = np.tile(rng.uniform(1.0, 4.0, 180), (200, 1))
    rows[:, 80:100] = 25.0
    rows += 0.01 * rng.standard_normal(rows.shape)
    assert counted(rows).code_band() is None


def test_fewer_than_two_in_a_thousand_are_left_alone():
    rows = moving_sensor()
    rows.ravel()[::600] = 51.1
    assert counted(rows).code_band() is None
