"""How the noise of a laser grows with the range: found where it does, and not taken from clutter."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan.diagnostics.preparation import StreamMender, mend
from curvescan.diagnostics.range_noise import noise_doubled_at
from curvescan.io.arrays.memory import as_log
from curvescan.simulation import SENSORS


def drive(doubled_at, *, at_sensor=0.004, world="office", sensor="spinning-360", seed=0):
    """120 scans with noise of `at_sensor` metres at the sensor, whose variance has doubled at `doubled_at` metres."""
    rng = np.random.default_rng(seed)
    exact = replace(SENSORS[sensor], sigma_range=0.0)
    for scan in cs.simulate(world, sensor=exact, n_scans=120, seed=seed):
        sigma = at_sensor * np.sqrt(1.0 + (np.where(scan.valid, scan.ranges, 0.0) / doubled_at) ** 2)
        yield replace(scan, ranges=scan.ranges + sigma * rng.standard_normal(len(scan)))


@pytest.mark.parametrize("world", ["office", "building"])
@pytest.mark.parametrize("doubled_at", [0.5, 1.0])
def test_growth_is_found(world, doubled_at):
    found = [noise_doubled_at(drive(doubled_at, world=world, seed=seed)) for seed in range(3)]
    assert 0.5 * doubled_at < np.mean(found) < 1.4 * doubled_at  # clutter, which is far, adds to it


@pytest.mark.parametrize("world", ["office", "building"])
@pytest.mark.parametrize("sensor", ["spinning-360", "sick-lms200"])
def test_none_is_found_where_there_is_none_whatever_stands_far_away(world, sensor):
    for seed in range(4):
        assert noise_doubled_at(drive(np.inf, world=world, sensor=sensor, seed=seed)) == np.inf


def test_noise_in_proportion_to_the_range_has_doubled_at_a_quarter_of_a_metre():
    assert noise_doubled_at(drive(0.05, at_sensor=0.0005)) == pytest.approx(0.25, rel=0.1)


def test_too_little_to_tell_is_no_growth():
    blank = cs.LaserScan([np.nan] * 90, angle_min=-1.0, angle_increment=0.02)
    one = next(drive(0.5))
    two = cs.LaserScan([1.0, 1.1], angle_min=0.0, angle_increment=0.1)
    round_wall = cs.LaserScan([2.0] * 360, angle_min=0.0, angle_increment=np.radians(1.0))
    for few in ([], [blank], [two], [one], [round_wall] * 9):
        assert noise_doubled_at(few) == np.inf


def test_a_run_and_a_running_laser_take_scans_with_the_noise_that_the_log_shows():
    scans = list(drive(0.5))
    taken = mend(as_log(scans))
    assert taken.done == ()
    assert {scan.noise_doubled_at for scan in taken.log} == {taken.report.noise_doubled_at}
    assert 0.25 < taken.report.noise_doubled_at < 0.7
    assert mend(as_log(scans), as_is=True).log[5].noise_doubled_at == np.inf
    mender = StreamMender(lambda _: None)
    seen = [mender.add(scan).noise_doubled_at for scan in scans]
    assert set(seen[:98]) == {np.inf}
    assert 0.25 < seen[-1] < 0.7
