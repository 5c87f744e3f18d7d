"""Stamped ranges that are in memory already, as a log."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan.diagnostics.inspect import inspect_log
from curvescan.engines import run_engine
from curvescan.errors import InvalidArgumentError
from curvescan.io import Log
from tests.scenes import room_scan

GRID = {"angle_min": -1.0, "angle_increment": 0.5}


def test_any_iterable_of_pairs_is_a_log() -> None:
    log = cs.log_from_arrays(((t, [1.0, np.nan, 3.0]) for t in (0.5, 0.25)), range_max=2.0, **GRID)
    assert isinstance(log, Log)
    assert (len(log), log.odometry, log.read_errors) == (2, None, ())
    for _ in range(2):  # a generator runs once, a log as often as one likes
        assert [scan.stamp for scan in log] == [0.5, 0.25]
    assert log[1].valid.tolist() == [True, False, False]
    assert inspect_log(log).n_scans == 2


def test_beams_one_by_one_and_times() -> None:
    log = cs.log_from_arrays(
        [(0, [1, 2, 3])], angles=[0.0, 0.1, 0.3], time_increment=1e-3, scan_time=0.1, range_min=0.5
    )
    assert log[0].angles.tolist() == [0.0, 0.1, 0.3]
    assert (log[0].time_increment, log[0].scan_time, log[0].range_min) == (1e-3, 0.1, 0.5)


def test_odometry_is_a_pose_a_scan() -> None:
    pairs = [(0.0, [1.0]), (1.0, [1.0])]
    log = cs.log_from_arrays(pairs, odometry=[[0, 0, 4], [np.nan] * 3], **GRID)
    assert log.odometry is not None
    assert log.odometry.stamps.tolist() == [0.0, 1.0]
    np.testing.assert_allclose(log.odometry.poses[0], [0, 0, 4 - 2 * np.pi])
    with pytest.raises(InvalidArgumentError, match=r"shape \(2, 3\), a pose a scan, got \(1, 3\)"):
        cs.log_from_arrays(pairs, odometry=[[0, 0, 0]], **GRID)
    with pytest.raises(InvalidArgumentError, match=r"shape \(2, 3\), a pose a scan: could not convert"):
        cs.log_from_arrays(pairs, odometry="abc", **GRID)
    with pytest.raises(InvalidArgumentError, match="finite or NaN where it is unknown, got inf"):
        cs.log_from_arrays(pairs, odometry=[[np.inf, 0, 0], [0, 0, 0]], **GRID)


def test_the_odometry_takes_it() -> None:
    scans = [room_scan((0.05 * k, 0.0, 0.0), seed=k) for k in range(3)]
    pairs = [(0.1 * k, scan.ranges) for k, scan in enumerate(scans)]
    beams = {"angle_min": scans[0].angle_min, "angle_increment": scans[0].angle_increment}
    run = run_engine(cs.log_from_arrays(pairs, **beams))
    np.testing.assert_allclose(run.trajectory.poses[-1], [0.1, 0.0, 0.0], atol=0.02)


def test_what_is_no_reading_is_told() -> None:
    with pytest.raises(InvalidArgumentError, match="scan 1: ranges must be 1-D"):
        cs.log_from_arrays([(0, [1.0]), (1, [[1.0]])], **GRID)
    with pytest.raises(InvalidArgumentError, match=r"pairs of a stamp and ranges, got 5 as number 0"):
        cs.log_from_arrays([5], **GRID)  # type: ignore[list-item]
    with pytest.raises(InvalidArgumentError, match=r"scan 0: .*directions of the beams are missing"):
        cs.log_from_arrays([(0, [1.0])])
    with pytest.raises(InvalidArgumentError, match="unknown key 'angle_inc': did you mean"):
        cs.log_from_arrays([(0, [1.0])], angle_inc=0.1)  # type: ignore[call-arg]
