"""Calibration: the parameters that planes and corners decide."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from curvescan import InvalidArgumentError, LaserScan
from curvescan.cli.main import run
from curvescan.io import read_config
from curvescan.matchers.cfsma.config import CfSmaConfig
from curvescan.paper.calibration import (
    TOLERANCES,
    calibrate,
    planes_of_log,
    simulated_planes,
)
from curvescan.simulation import SENSORS
from tests.scenes import room_scan

LMS = SENSORS["sick-lms200"]


@pytest.mark.slow
@pytest.mark.parametrize("sigma", [0.005, 0.01, 0.02])
def test_the_noise_of_the_sensor_is_found(sigma):
    sensor = replace(LMS, sigma_range=sigma)
    found = calibrate(simulated_planes(sensor, (4.0, 6.0), n_scans=10), sensor, n_scans=2)
    # ten planes of some 200 readings: the median absolute deviation is good to about 2 %
    assert found.config.segmentation.range_sigma == pytest.approx(sigma, rel=0.08)


@pytest.mark.slow
def test_more_noise_needs_more_tolerance_and_finds_no_more_corners():
    quiet, loud = (
        calibrate(simulated_planes(sensor, (4.0, 6.0), n_scans=20), sensor, n_scans=5)
        for sensor in (replace(LMS, sigma_range=s) for s in (0.003, 0.015))
    )
    assert quiet.config.curvature.arc_tolerance < loud.config.curvature.arc_tolerance
    for found in (quiet, loud):
        at = list(TOLERANCES).index(found.config.curvature.arc_tolerance)
        assert (found.false_peaks[:, at] <= 0.1).all()
        assert (np.diff(found.detection) <= 1e-12).all()
        assert 0.3 < found.config.functions.min_correlation < 0.9
    assert (loud.false_peaks[:, 0] > 1.0).all()


@pytest.mark.slow
def test_planes_too_near_are_left_out_and_said():
    found = calibrate(simulated_planes(LMS, (0.5, 5.0), n_scans=10), LMS, n_scans=2)
    assert found.is_free.tolist() == [False, True]


def test_planes_are_found_in_a_log():
    walls = planes_of_log(
        [
            LaserScan(
                3.0 / np.cos(np.linspace(-0.8, 0.8, 161))
                + 0.005 * np.random.default_rng(k).standard_normal(161),
                angle_min=-0.8,
                angle_increment=0.01,
            )
            for k in range(3)
        ],
        "walls",
    )
    assert [len(plane) for plane in walls[0].planes] == [161] * 3
    with pytest.raises(InvalidArgumentError, match="shows no plane of 20 readings"):
        planes_of_log([room_scan()], "a room, whose corners are no planes")


def test_a_plane_out_of_sight_is_told():
    with pytest.raises(InvalidArgumentError, match="choose smaller distances"):
        simulated_planes(LMS, [7.99])


def test_the_command_writes_a_configuration_that_can_be_read(tmp_path, capsys):
    assert run(["calibrate", "--out", str(tmp_path / "c"), "--distances", "5"]) == 0
    assert "U_k" in capsys.readouterr().out
    assert (tmp_path / "c" / "calibration.png").stat().st_size > 1000
    config = read_config(tmp_path / "c" / "cfsma.toml", {"cfsma": CfSmaConfig()})["cfsma"]
    assert config.segmentation.range_sigma == pytest.approx(0.01, rel=0.1)
