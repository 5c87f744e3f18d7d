"""Calibration: the parameters that planes and corners decide."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import partial

import numpy as np
import pytest

from curvescan import InvalidArgumentError, LaserScan
from curvescan.cli.main import run
from curvescan.io import read_config
from curvescan.matchers.cfsma.config import CfSmaConfig
from curvescan.paper.calibration import TOLERANCES, calibrate, planes_of_log, simulated_planes
from curvescan.paper.calibration_pairs import calibrate_on_pairs
from curvescan.simulation import SENSORS
from tests.scenes import room_scan

LMS = SENSORS["sick-lms200"]
REAL = SENSORS["sick-lms200-5mm"]


@pytest.mark.slow
@pytest.mark.parametrize("sigma", [0.005, 0.01, 0.02])
def test_the_noise_of_the_sensor_is_found(sigma):
    sensor = replace(LMS, sigma_range=sigma)
    found = calibrate(simulated_planes(sensor, (4.0, 6.0), n_scans=10), sensor, n_scans=2)
    # ten planes of some 200 readings: the median absolute deviation is good to about 2 %
    assert found.noise == pytest.approx(sigma, rel=0.08)


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
                3.0 / np.cos(np.linspace(-0.8, 0.8, 161)) + 0.005 * np.random.default_rng(k).standard_normal(161),
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


@pytest.mark.slow
def test_the_command_writes_a_configuration_that_can_be_read(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("curvescan.paper.calibration.calibrate", partial(calibrate, n_scans=8))
    assert run(["calibrate", "--out", str(tmp_path / "c"), "--distances", "5"]) == 0
    assert "U_k" in capsys.readouterr().out
    assert (tmp_path / "c" / "calibration.png").stat().st_size > 1000
    config = read_config(tmp_path / "c" / "cfsma.toml", {"cfsma": CfSmaConfig()})["cfsma"]
    assert config.segmentation.range_sigma == CfSmaConfig().segmentation.range_sigma
    page = (tmp_path / "c" / "calibration.md").read_text()
    [noise] = re.findall(r"range noise of the planes \| (\S+) m", page)
    assert float(noise) == pytest.approx(0.005, rel=0.1)
    assert not (tmp_path / "c" / "sweep.md").exists()


@pytest.mark.slow
def test_what_is_shipped_is_what_the_calibration_of_a_real_lms200_finds():
    found = calibrate(simulated_planes(REAL, (1.0, 2.0, 4.0, 7.0)), REAL).config
    shipped = CfSmaConfig()
    assert found.segmentation.range_sigma == shipped.segmentation.range_sigma
    assert found.curvature.arc_tolerance == shipped.curvature.arc_tolerance
    assert found.landmarks.min_curvature == shipped.landmarks.min_curvature
    # the paper's 30, 0.2 and 0.4 are kept: these differ by what makes no difference
    assert 15 <= found.landmarks.n_neighbours <= 40
    assert 0.05 <= found.landmarks.min_similarity <= 0.5
    assert 0.3 <= found.functions.min_correlation <= 0.6


def test_a_wrong_pair_of_corners_is_told_from_a_right_one():
    found = calibrate_on_pairs(CfSmaConfig(), REAL, n_pairs=10)
    assert (np.diff(found.right_kept) <= 0.0).all()
    assert (np.diff(found.wrong_rejected) >= 0.0).all()
    assert found.wrong_rejected[-1] > 1.0 - found.right_kept[-1]
    assert (found.seconds > 0.0).all()
