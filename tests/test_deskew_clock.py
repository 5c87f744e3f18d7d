"""The clock of a laser: one period while its steps jitter, whole numbers of it where scans are lost."""

import numpy as np
import pytest

from curvescan import LaserScan
from curvescan.deskew import Deskewer


def seconds_of(stamps, scan_time=0.0):
    """What each scan is taken to be after the one before."""
    deskewer, seconds = Deskewer(), []
    for stamp in stamps:
        scan = LaserScan(
            [1.0, 2.0, 3.0],
            angle_min=0.0,
            angle_increment=0.1,
            range_max=9.0,
            stamp=float(stamp),
            time_increment=0.001,
            scan_time=scan_time,
        )
        deskewer = deskewer.ticked(scan.stamp, scan.scan_time)
        seconds.append(deskewer.seconds)
    return seconds


def test_steps_that_alternate_have_one_period():
    """A spinning laser sends whole packets: one turn has one more than the next."""
    stamps = 1.6e9 + np.cumsum([0.123, 0.135] * 30)
    assert set(seconds_of(stamps)[2:]) == {0.129}


def test_the_last_place_of_a_stamp_changes_nothing():
    stamps = 1.6e9 + np.cumsum(0.129 + 0.006 * np.sin(np.arange(200.0)))
    rng = np.random.default_rng(0)
    moved = np.nextafter(stamps, rng.choice((-np.inf, np.inf), stamps.size))
    assert (moved != stamps).all()
    assert seconds_of(moved) == seconds_of(stamps)


def test_lost_scans_are_whole_periods():
    steps = np.full(30, 0.1)
    steps[[10, 20]] = 0.203, 0.296
    seconds = seconds_of(np.cumsum(steps))
    assert (seconds[10], seconds[20]) == (0.2, pytest.approx(0.3))
    assert set(np.delete(seconds, [0, 10, 20])) == {0.1}


def test_a_laser_that_slows_down_is_followed():
    seconds = seconds_of(np.cumsum([0.1] * 20 + [0.125] * 20))
    assert seconds[19] == 0.1
    assert seconds[-1] == pytest.approx(0.125, rel=0.02)
    assert len(set(seconds[2:])) < 10


def test_without_regular_steps_the_scan_says_how_long_it_took():
    assert seconds_of([5.0, 5.0, 5.0], scan_time=0.1) == [0.1] * 3
    assert seconds_of([5.0, 5.0, 5.0]) == [0.0] * 3


def test_a_step_is_long_once_the_usual_one_is_known():
    deskewer = Deskewer()
    for k in range(10):
        deskewer = deskewer.ticked(0.1 * k)
    assert deskewer.ticked(2.9).n_steps == 1  # logs written in bursts begin with any step
    for k in (10, 11):
        deskewer = deskewer.ticked(0.1 * k)
    assert [deskewer.ticked(1.1 + elapsed).n_steps for elapsed in (-0.5, 0.0, 0.14, 0.16, 1.0)] == [1, 1, 1, 2, 10]
    assert deskewer.ticked(2.1).ticked(3.1).n_steps == 10  # a pause moves it little
