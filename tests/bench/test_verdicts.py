"""The table of verdicts: errors with the paths laid over each other, what is counted, and drives that are spoilt."""

import numpy as np
import pytest

from curvescan import se2
from verdicts import SPOILERS, count, drives, is_unclear, is_wrong, judged, worst_error


def test_the_error_is_that_of_paths_laid_over_each_other():
    rng = np.random.default_rng(1)
    truth = np.column_stack([np.cumsum(rng.normal(0.1, 0.05, (50, 2)), axis=0), np.zeros(50)])
    moved = se2.compose(np.array([3.0, -2.0, 1.0]), truth)
    error, extent = worst_error(moved, truth)
    assert error < 1e-9
    assert extent == pytest.approx(np.hypot(*np.ptp(truth[:, :2], axis=0)))
    moved[-1, 0] += 1.0
    assert 0.8 < worst_error(moved, truth)[0] < 1.0
    truth[30:] = np.nan  # another building
    assert worst_error(moved, truth)[0] == np.inf
    assert is_wrong(np.inf, 0.0)
    assert not is_wrong(1.4, 100.0)
    assert is_wrong(4.0, 100.0)
    assert is_unclear(1.4, 100.0)
    assert not is_unclear(0.9, 100.0)
    assert not is_unclear(4.0, 100.0)


def test_false_alarms_and_false_trust_are_counted():
    rows = [(False, True), (False, False), (True, True), (True, False), (True, False)]
    assert count(rows) == "false alarms: 1 of 2; false trust: 1 of 3"


def test_every_third_drive_is_spoilt_in_one_of_the_ways():
    names = {spoil.__name__ for spoil in SPOILERS}
    found = [next((n for n in names if n in drive.name), "") for drive in drives(15, n_scans=24)]
    assert [bool(name) for name in found] == [k % 3 == 2 for k in range(15)]
    assert set(found) - {""} == names
    for drive in drives(6, n_scans=24):
        assert len(drive.log) == len(drive.truth)


@pytest.mark.slow
def test_a_sound_drive_is_right():
    ((_, error, wrong, _, _),) = judged(1, n_scans=40)
    assert error < 0.1
    assert wrong is False
