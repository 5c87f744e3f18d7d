"""The lag of a log's odometry against its scans: found, named, and taken out."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan.diagnostics.rotation_direction import odometry_lag, without_lag


def late(log, lag):
    """The log's odometry as a clock that is late by so much stamps it."""
    return without_lag(log.odometry.stamps, log.odometry.poses, -lag)


@pytest.fixture(scope="module")
def log():
    return cs.simulate("office", n_scans=200, seed=0)


def test_no_lag_is_found_where_there_is_none(log):
    assert odometry_lag(log, log.odometry.poses[:, 2]) == 0.0


@pytest.mark.parametrize("lag", [0.5])
def test_a_lag_is_found(log, lag):
    assert odometry_lag(log, late(log, lag)[:, 2]) == pytest.approx(lag, abs=0.1)


def test_taking_the_lag_out_gives_the_poses_as_they_were(log):
    there_and_back = without_lag(log.odometry.stamps, late(log, 0.3), 0.3)
    off = cs.se2.between(log.odometry.poses, there_and_back)[20:-20]
    # what linear interpolation between scans loses
    assert np.abs(off).max() < 0.1
    assert np.median(np.abs(off)) < 0.01


def test_headings_that_are_missing_tell_no_lag(log):
    headings = late(log, 0.5)[:, 2].copy()
    headings[3] = np.nan
    assert odometry_lag(log, headings) == 0.0
