"""Configurations through TOML files."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from curvescan import InvalidArgumentError, LogFileError, OutputError
from curvescan.io import read_config, write_config
from curvescan.matchers import MATCHERS, find_matcher
from curvescan.matchers.cfsma.config import CfSmaConfig, CurvatureConfig, LandmarksConfig
from curvescan.odometry import MotionConfig, OdometryConfig

DEFAULTS = {"cfsma": CfSmaConfig(), "odometry": OdometryConfig()}


@given(st.floats(1e-6, 10.0), st.integers(1, 10_000))
def test_a_configuration_comes_back_to_the_bit(tmp_path_factory, tolerance, n):
    path = tmp_path_factory.mktemp("config") / "config.toml"
    config = CfSmaConfig(curvature=CurvatureConfig(arc_tolerance=tolerance), landmarks=LandmarksConfig(n_neighbours=n))
    write_config(path, {"cfsma": config, "odometry": OdometryConfig(motion=MotionConfig(max_repeats=n))})
    found = read_config(path, DEFAULTS)
    assert found == {"cfsma": config, "odometry": OdometryConfig(motion=MotionConfig(max_repeats=n))}


@pytest.mark.parametrize("method", sorted(MATCHERS))
def test_every_method_can_be_configured_from_a_file(tmp_path, method):
    path = tmp_path / "config.toml"
    config = find_matcher(method).config
    write_config(path, {method: config})
    assert read_config(path, {method: config}) == {method: config}


def test_what_a_file_leaves_out_keeps_its_default(tmp_path):
    path = tmp_path / "config.toml"
    path.write_text("[cfsma.landmarks]\nmin_curvature = 1\n")
    found = read_config(path, DEFAULTS)
    assert found["cfsma"] == CfSmaConfig(landmarks=LandmarksConfig(min_curvature=1.0))
    assert found["odometry"] == OdometryConfig()


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[cfsma.landmark]\n", "unknown key 'landmark': did you mean 'landmarks'"),
        ("[cfsma.landmarks]\nmin_curvatur = 1\n", r"\[cfsma.landmarks\].*did you mean 'min_curvature'"),
        ("[idc]\n", "unknown key 'idc'"),
        ("[cfsma.landmarks]\nn_neighbours = 1.5\n", "n_neighbours must be of type int, got 1.5"),
        ("[cfsma.landmarks]\nn_neighbours = true\n", "must be of type int, got True"),
        ("[cfsma.landmarks]\nn_neighbours = 0\n", "n_neighbours must be at least 1, got 0"),
        ("[cfsma]\nlandmarks = 3\n", r"\[cfsma.landmarks\] must be a table, got 3"),
        ("not toml", "is not a TOML file"),
    ],
)
def test_faults_are_named(tmp_path, text, message):
    path = tmp_path / "config.toml"
    path.write_text(text)
    with pytest.raises(InvalidArgumentError, match=message):
        read_config(path, DEFAULTS)


def test_a_missing_file_is_told(tmp_path):
    with pytest.raises(LogFileError, match="nowhere"):
        read_config(tmp_path / "nowhere.toml", DEFAULTS)


def test_a_place_that_cannot_be_written_and_a_path_that_is_none_are_told(tmp_path):
    (tmp_path / "file").touch()
    with pytest.raises(OutputError, match="is a file"):
        write_config(tmp_path / "file" / "config.toml", DEFAULTS)
    with pytest.raises(InvalidArgumentError, match="what is to be written must be given as a path, got int"):
        write_config(5, DEFAULTS)
    with pytest.raises(InvalidArgumentError, match="a configuration must be given as a path, got int"):
        read_config(5, DEFAULTS)
