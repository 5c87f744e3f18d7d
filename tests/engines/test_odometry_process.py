"""The odometry in a process of its own: the same bits, whatever becomes of the process."""

from __future__ import annotations

import os

import numpy as np
import pytest

import curvescan as cs
from curvescan.engines import odometry_process, run_engine
from curvescan.engines.engine import in_turn
from curvescan.engines.odometry_process import OdometryProcess, can_run_ahead
from curvescan.errors import LogFormatError
from curvescan.slam import Slam

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def log():
    return cs.simulate("office-floor", n_scans=90, seed=3)


def bits(slam, record):
    closures = [(c.i, c.j, c.outcome) for c in slam.closures]
    return record.trajectory.poses.tobytes(), record.online.covariances.tobytes(), closures


def ahead_of(slam, log, poses=None):
    return OdometryProcess().place(slam.odometry, log, poses)


def test_slam_has_the_same_bits(log):
    runs = []
    for poses in (None, log.odometry.poses):
        for is_ahead in (False, True):
            slam = Slam()
            if is_ahead:
                with ahead_of(slam, log, poses) as ahead:
                    runs.append((slam, run_engine(log, slam, odometry_poses=poses, ahead=ahead)))
            else:
                runs.append((slam, run_engine(log, slam, odometry_poses=poses)))
    assert bits(*runs[0]) == bits(*runs[1])
    assert bits(*runs[2]) == bits(*runs[3])
    assert runs[1][1].outcomes == runs[0][1].outcomes
    # and it goes on where the process ended
    after = [slam.add(log[5]).pose for slam, _ in runs[:2]]
    np.testing.assert_array_equal(*after)


@pytest.mark.parametrize("n_before_the_end", [0, 40])
def test_a_process_that_ends_too_early_costs_time_alone(log, n_before_the_end):
    expected = [one.step.pose for one in in_turn(cs.Odometry(), log, None)]
    with OdometryProcess().place(cs.Odometry(), log, None) as ahead:
        found = []
        if n_before_the_end == 0:
            ahead._process.kill()
        for one in ahead:
            found.append(one.step.pose)
            if len(found) == n_before_the_end:
                ahead._process.kill()
        assert len(ahead.odometry._state.motion.last.pose) == 3
    np.testing.assert_array_equal(found, expected)
    assert ahead.odometry._state.n_scans == len(log)


def test_without_another_process_the_odometry_is_made_here(log, monkeypatch):
    def refuse(*_args, **_kwargs):
        raise OSError("no more processes")

    monkeypatch.setattr(odometry_process.subprocess, "Popen", refuse)
    with OdometryProcess().place(cs.Odometry(), log[:9], None) as ahead:
        assert len(list(ahead)) == 9


def test_what_the_log_raises_is_raised(log):
    def broken():
        yield from log[:40]
        raise LogFormatError("broken here")

    with (
        OdometryProcess().place(cs.Odometry(), broken(), None) as ahead,
        pytest.raises(LogFormatError, match="broken here"),
    ):
        list(ahead)


def test_a_run_that_is_given_up_leaves_no_process(log):
    with OdometryProcess().place(cs.Odometry(), log, None) as ahead:
        next(iter(ahead))
    assert ahead._process.poll() is not None


def test_short_logs_and_single_cores_do_without(monkeypatch):
    monkeypatch.setattr(odometry_process.os, "sched_getaffinity", lambda _: {0, 1}, raising=False)
    assert can_run_ahead(100_000)
    assert not can_run_ahead(100)
    monkeypatch.setattr(odometry_process.os, "sched_getaffinity", lambda _: {0}, raising=False)
    assert not can_run_ahead(100_000)


def summed(numbers, *, start):
    return sum(numbers, start), os.getpid()


def test_the_process_calls_functions_when_the_odometry_is_done(log):
    with OdometryProcess().place(cs.Odometry(), log[:9], None) as ahead:
        results = [ahead.call_after(summed, [1, k], start=5) for k in range(3)]
        list(ahead)
        found = [result() for result in results]
        assert [total for total, _ in found] == [6, 7, 8]
        assert {pid for _, pid in found} == {ahead._process.pid}


def test_what_the_process_cannot_call_is_called_here(log):
    here = os.getpid()
    with OdometryProcess().place(cs.Odometry(), log[:9], None) as ahead:
        given_up = ahead.call_after(summed, [1], start=1)
        next(iter(ahead))
        assert given_up() == (2, here)  # the odometry was not finished
    with OdometryProcess().place(cs.Odometry(), log[:9], None) as ahead:
        list(ahead)
        unknown_there = ahead.call_after(lambda: os.getpid())
        after = ahead.call_after(summed, [2], start=1)
        assert unknown_there() == here
        assert after() == (3, here)
    with OdometryProcess().place(cs.Odometry(), log[:9], None) as ahead:
        list(ahead)
        ahead._process.kill()
        assert ahead.call_after(summed, [1], start=1)() == (2, here)
    with OdometryProcess().place(cs.Odometry(), log[:9], None) as ahead:
        list(ahead)
        fails = ahead.call_after(summed, None, start=1)
        with pytest.raises(TypeError):  # and says so here
            fails()
