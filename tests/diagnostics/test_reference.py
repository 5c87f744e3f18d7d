"""Poses that were estimated from the scans are no prior: what a log itself says of them."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan.io.ros.writing.bags import write_odometry_mcap
from curvescan.io.trajectories.trajectory import Trajectory
from tests.carmen_files import flaser, write


@pytest.fixture
def log():
    return cs.simulate("office", n_scans=6, seed=1)


def test_the_export_of_an_odometry_is_its_estimate_and_converted_wheels_are_wheels(tmp_path, log):
    odometry = log.odometry
    covariances = np.tile(1e-4 * np.eye(3), (len(log), 1, 1))
    estimated = Trajectory(stamps=odometry.stamps, poses=odometry.poses, covariances=covariances)
    write_odometry_mcap(tmp_path / "own.mcap", estimated, log)
    assert "which laser odometry gives" in cs.read_log(tmp_path / "own.mcap").why_estimated()
    cs.write_log(tmp_path / "wheels.mcap", log)
    converted = cs.read_log(tmp_path / "wheels.mcap")
    assert converted.odometry is not None
    assert converted.why_estimated() == ""
    assert converted.n_recorded() == 6


def test_neff_lines_are_gmappings(tmp_path):
    path = write(tmp_path / "a.log", flaser(stamp=1), "NEFF 2", flaser(stamp=2))
    assert "1 NEFF lines say that GMapping" in cs.read_log(path).why_estimated()
    assert cs.read_log(write(tmp_path / "b.log", flaser(stamp=1))).why_estimated() == ""
