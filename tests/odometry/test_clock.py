"""The clock: whole periods from stamps that jitter, stand still, go back or leap."""

from __future__ import annotations

import numpy as np

from curvescan.odometry.clock import Clock


def seconds_of(stamps):
    clock, found = Clock(), []
    for stamp in stamps:
        clock, seconds = clock.ticked(float(stamp))
        found.append(seconds)
    return found[1:]


def test_jitter_changes_nothing():
    even = 0.1 * np.arange(60)
    rng = np.random.default_rng(0)
    assert seconds_of(even + rng.uniform(-1e-3, 1e-3, 60)) == seconds_of(even)


def test_a_pause_counts_as_so_many_periods_and_not_without_end():
    stamps = np.cumsum([0.1] * 30 + [0.3] + [0.1] * 5 + [1e4])
    found = seconds_of(stamps)
    assert found[29] == 3 * found[28]
    assert found[-1] == 20 * found[28]


def test_stamps_that_do_not_tell_count_as_one_period_each():
    assert set(seconds_of(np.zeros(20))) == {0.1}
    assert set(seconds_of(np.arange(20.0)[::-1])) == {0.1}
