"""mend: what is beyond doubt is mended and said, what is only likely is not, and a sound log is the same object."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from scipy.stats import chi2

import curvescan as cs
from curvescan.diagnostics.preparation import StreamMender, mend
from curvescan.io.arrays.memory import as_log
from curvescan.io.sensor_setup import SensorSetup, apply_setup
from curvescan.scan import mirrored
from tests.diagnostics.test_beam_statistics import N_BEAMS, moving
from tests.diagnostics.test_inspect import FakeLog


def log_of(rows, range_max=60.0):
    return FakeLog(
        [
            cs.LaserScan(row, angle_min=0.0, angle_increment=0.01, range_max=range_max, stamp=0.1 * k)
            for k, row in enumerate(rows)
        ]
    )


def with_codes(share, *, beams=slice(None), value=51.1, seed=1):
    rows = moving(200)
    rng = np.random.default_rng(seed)
    is_code = rng.random(rows.shape) < share
    is_code[:, [k for k in range(N_BEAMS) if k not in range(N_BEAMS)[beams]]] = False
    return log_of(np.where(is_code, np.round(value + 0.1 * rng.random(rows.shape), 2), rows))


@pytest.mark.parametrize("share", [0.005, 0.02, 0.3])
def test_codes_in_beams_all_around_are_ignored_and_said(share):
    mended = mend(with_codes(share))
    assert [issue.kind for issue in mended.done] == ["undeclared_codes"]
    assert mended.done[0].sentence.endswith("; a run mends it by itself")
    (sentence,) = mended.remarks
    assert sentence.startswith("ignored: readings beyond 50.6 m, codes for no return (")
    assert sentence.endswith("as_is=True keeps them")
    assert max(np.max(scan.ranges[scan.valid]) for scan in mended.log) < 50.0
    assert mended.log[3].range_max == 50.6
    assert not any(issue.mending for issue in mended.issues)


def test_a_value_that_some_beams_repeat_is_proposed_only():
    rows = moving(200)
    rows[:, 30:50] = 51.1
    mended = mend(log_of(rows))
    assert mended.done == ()
    assert "undeclared_code" in {issue.kind for issue in mended.issues}


def test_stale_beams_are_dropped_where_they_are_scattered():
    rows = moving(60)
    stale = np.random.default_rng(1).random(rows.shape) < 0.35
    for k in range(1, len(rows)):
        rows[k] = np.where(stale[k], rows[k - 1], rows[k])
    mended = mend(log_of(rows))
    assert [issue.kind for issue in mended.done] == ["stale_beams"]
    assert not (mended.log[5].valid & stale[5]).any()


def test_readings_that_repeat_in_runs_are_those_of_a_wall_alongside():
    rows = moving(60)
    rows[:, 20:80] = 2.5  # a smooth wall beside a straight path, without noise
    assert mend(log_of(rows)).done == ()


def test_beams_that_are_not_fired_are_left_out_and_matches_are_as_sure_as_without():
    log = cs.simulate("office", n_scans=110, seed=3)
    half = [replace(scan, ranges=np.where(np.arange(len(scan)) % 2, np.nan, scan.ranges)) for scan in log]
    mended = mend(FakeLog(half))
    assert [issue.kind for issue in mended.done] == ["empty_beams"]
    (sentence,) = mended.remarks
    assert sentence.startswith("left out: beams that never read between beams that do, ")
    scans = [mended.log[k] for k in range(0, 110, 10)]
    of_all, of_fired = ([cs.match(*pair).score for pair in pairwise(some)] for some in (half[::10], scans))
    assert np.mean(of_fired) > 1.4 * np.mean(of_all)


def test_a_mirrored_laser_is_turned_back_unless_it_was_set_up_by_hand():
    log = cs.simulate("office", n_scans=60, seed=2)
    wrong = FakeLog([mirrored(scan) for scan in log], odometry=log.odometry)
    mended = mend(wrong)
    assert [issue.kind for issue in mended.done] == ["turns_against"]
    np.testing.assert_array_equal(mended.log[7].points, log[7].points)
    by_hand = apply_setup(log, SensorSetup(clockwise=True))
    assert mend(by_hand).done == ()


def test_a_sound_log_is_the_same_object_and_as_is_mends_nothing():
    log = cs.simulate("office", n_scans=40, seed=3)
    assert mend(log).log is log
    faulty = with_codes(0.02)
    assert mend(faulty, as_is=True).log is faulty


def test_a_running_laser_is_mended_after_some_seconds_and_changes_its_mind_once():
    told: list[str] = []
    mender = StreamMender(told.append)
    early = list(with_codes(0.02))[:100]  # codes all around
    far = np.random.default_rng(7).uniform(46.0, 51.2, (900, N_BEAMS))
    late = [replace(early[0], ranges=row) for row in far]  # then a hall of that size
    seen = [mender.add(scan) for scan in (*early, *late, *early)]
    assert seen[98].range_max == 60.0
    assert seen[99].range_max == pytest.approx(50.6)
    assert told[0].startswith("from scan 100 on ignored: readings beyond 50.6 m")
    assert len(told) == 2
    assert told[1].startswith("from scan 1,000 on no longer ignored")
    assert seen[-1].range_max == 60.0


def with_ring(log, rng, *, value, jitter, share, in_arcs):
    """The scans with codes of one range, and the same with no reading in their place."""
    spoilt, blank = [], []
    for scan in log:
        is_code = rng.random(len(scan)) < share
        while in_arcs and np.mean(is_code) < share + 0.01:
            first = rng.integers(len(scan))
            is_code[first : first + len(scan) // 30] = True
        codes = value + jitter * (rng.random(len(scan)) - 0.5)
        spoilt.append(replace(scan, ranges=np.where(is_code, codes, scan.ranges), range_max=40.0))
        blank.append(replace(scan, ranges=np.where(is_code, np.nan, scan.ranges), range_max=40.0))
    return spoilt, blank


def error_and_nees(scans, truth):
    """Position error at the end, metres, and the squared heading error in its own variances."""
    odometry = cs.Odometry()
    for scan in scans:
        step = odometry.add(scan)
    dx, dy, turn = cs.se2.between(cs.se2.between(truth[0], truth[-1]), step.pose)
    return np.hypot(dx, dy), turn**2 / step.covariance[2, 2]


@pytest.mark.slow
def test_a_constant_range_is_no_wall():
    # 16 drives, codes at any range in 0.5 to 30 % of the beams, in half of them within half a metre, in half in arcs
    rng, errors, nees, is_mended = np.random.default_rng(3), [], [], []
    for k in range(16):
        world, sensor = (("office", "sick-lms200"), ("building", "spinning-360"))[k % 2]
        log = cs.simulate(world, sensor=sensor, n_scans=100, seed=k, odometry_noise=None)
        value, share = rng.uniform(2.0, 30.0), 0.005 * 60.0 ** ((k // 2 + 1) / 8.0)
        kind = {"value": value, "jitter": 0.5 * (k // 2 % 2), "share": share, "in_arcs": k // 4 % 2 == 1}
        spoilt, blank = with_ring(log, rng, **kind)
        mended = mend(as_log(spoilt), is_order_needed=False)
        is_mended.append(bool(mended.done))
        found = [error_and_nees(scans, log.truth.poses) for scans in (blank, mended.log)]
        errors.append([error for error, _ in found])
        nees.append([square for _, square in found])
    without, mended_errors = np.mean(errors, axis=0)
    assert mended_errors <= 1.1 * without + 0.002  # metres: a fifth of the noise of a reading
    # the mean of 16 squares of a unit normal is between these in all but one of a thousand cases
    low, high = chi2.ppf([0.0005, 0.9995], 16) / 16.0
    assert low < np.mean(nees, axis=0)[1] < high
    assert sum(is_mended[-8:]) >= 7  # those of 6 % and more


@pytest.mark.slow
@pytest.mark.parametrize("seed", [201, 206])
def test_a_wide_pole_on_the_robot_is_left_out_of_a_corridor(seed):
    log = cs.simulate("building", sensor="hokuyo-270", n_scans=150, seed=seed, odometry_noise=None)
    rng, scans = np.random.default_rng(seed), []
    for scan in log:
        ranges = scan.ranges.copy()
        ranges[360:468] = 0.4 + 0.005 * rng.standard_normal(108)
        scans.append(replace(scan, ranges=ranges))
    mended = mend(as_log(scans), is_order_needed=False)
    assert mended.remarks[0].startswith("left out: beams 360 to 467, which see the robot itself")
    assert error_and_nees(mended.log, log.truth.poses)[0] < 0.02


def test_a_pole_on_the_robot_does_not_hold_the_odometry():
    rng, errors, nees = np.random.default_rng(4), [], []
    for k in range(8):
        log = cs.simulate("office", sensor="sick-lms200", n_scans=100, seed=k, odometry_noise=None)
        n = len(log[0])
        at = slice(n // 5, n // 5 + max(2, int(rng.uniform(0.005, 0.1) * n)))
        pole, blank = [], []
        for scan in log:
            ranges, none = scan.ranges.copy(), scan.ranges.copy()
            ranges[at], none[at] = 0.4 + 0.01 * rng.standard_normal(at.stop - at.start), np.nan
            pole.append(replace(scan, ranges=ranges))
            blank.append(replace(scan, ranges=none))
        found = [error_and_nees(s, log.truth.poses) for s in (blank, mend(as_log(pole), is_order_needed=False).log)]
        errors.append([error for error, _ in found])
        nees.append(found[1][1])
    without, with_pole = np.mean(errors, axis=0)
    assert with_pole <= 1.1 * without + 0.002
    low, high = chi2.ppf([0.0005, 0.9995], 8) / 8.0
    assert low < np.mean(nees) < high


@pytest.mark.parametrize(("world", "n_scans"), [("office-floor", 30), ("office-floor", 40), ("office", 60)])
def test_a_short_log_with_nothing_wrong_is_left_as_it_is(world, n_scans):
    """A robot that turns on the spot sees one wall with all its beams; single beams keep their reading by chance."""
    assert mend(as_log(cs.simulate(world, sensor="urg-04lx", n_scans=n_scans))).done == ()
