"""Jittered stamps: what does not matter changes nothing, and the measure sees what does."""

import numpy as np
import pytest

from curvescan import read_log
from stamp_jitter import jitter_table, measure_jitter, timed_log


@pytest.fixture(scope="module")
def scans():
    return timed_log(n_scans=80)


@pytest.mark.slow
def test_a_unit_in_the_last_place_changes_no_pose(scans):
    spread = measure_jitter(scans, name="floor", n_runs=2)
    assert (spread.spread_m, spread.spread_rad) == (0.0, 0.0)
    assert spread.moved_shares.tolist() == [0.0, 0.0]
    (row,) = jitter_table([spread]).rows
    assert row[2:] == ("one unit in the last place", "2", "0 mm, 0 deg", "0.0 %")


@pytest.mark.slow
def test_stamps_that_say_something_else_are_seen(scans):
    """Moved by up to a third of a period: another velocity, and other deskewed scans."""
    spread = measure_jitter(scans, name="floor", jitter=0.03, n_runs=2)
    assert 0.0 < spread.spread_m < 0.1  # metres
    assert spread.moved_shares.min() > 0.5
    assert spread.ends.shape == (2, 3)
    (row,) = jitter_table([spread]).rows
    assert row[2] == "up to 30 ms"
    assert row[4] == f"{1e3 * spread.spread_m:.3g} mm, {np.degrees(spread.spread_rad):.2g} deg"


@pytest.mark.slow
def test_a_real_log_ends_where_it_ends(real_data):
    """Its steps alternate between 0.123 and 0.135 s; 0.24 us, the last place, once moved its end by 0.11 m."""
    log = read_log(real_data / "turtlebot4-rplidar" / "macfirst_floor_take_2")
    spread = measure_jitter(log[:200], name=log.name, n_runs=4)
    assert spread.spread_m == 0.0
    assert spread.moved_shares.max() == 0.0
