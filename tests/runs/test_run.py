"""cs.run: what `curvescan odometry` calls, and the same from Python."""

from __future__ import annotations

import json

import numpy as np
import pytest

import curvescan as cs
from curvescan.cli.main import run as command

FILES = (
    "map.pgm",
    "map.png",
    "map.yaml",
    "occupancy.png",
    "run.json",
    "trajectory.csv",
    "trajectory.tum",
    "view.npz",
    "wheels.png",
)


@pytest.fixture(scope="module")
def log_file(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "office.npz"
    cs.write_log(path, cs.simulate("office", n_scans=12, seed=3))
    return path


def test_a_run_writes_what_the_command_writes(log_file, tmp_path):
    result = cs.run(log_file, out=tmp_path / "a", exports=("kitti", "g2o"))
    assert command(["odometry", str(log_file), "--out", str(tmp_path / "b"), "--export", "kitti", "g2o"]) == 0
    assert result.files == (*FILES, "trajectory.kitti", "graph.g2o")
    for name in (*FILES, "trajectory.kitti", "graph.g2o"):
        a, b = (tmp_path / folder / name for folder in "ab")
        if name.endswith((".tum", ".csv", ".pgm", ".kitti", ".g2o")):
            assert a.read_bytes() == b.read_bytes()
        else:
            assert a.exists()
            assert b.exists()
    records = [json.loads((tmp_path / folder / "run.json").read_text()) for folder in "ab"]
    for key in ("input", "config", "method", "outcomes", "verdict", "occupancy"):
        assert records[0][key] == records[1][key]
    assert result.verdict.is_trusted
    assert result.left_out == ()


def test_a_run_without_a_folder_writes_nothing_and_gives_the_same(log_file, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    log = cs.read_log(log_file)
    result = cs.run(log)
    assert not list(tmp_path.iterdir())
    odometry = cs.odometry_for(log)
    expected = [odometry.add(scan).pose for scan in log]
    np.testing.assert_array_equal(result.trajectory.poses, expected)
    assert "\n" not in repr(result)


def test_a_run_says_what_is_wrong_with_its_arguments(log_file, tmp_path):
    with pytest.raises(
        cs.InvalidArgumentError, match=r"exports must be of kitti, g2o, mcap, got 'g20': did you mean 'g2o'"
    ):
        cs.run(log_file, out=tmp_path / "o", exports=("g20",))
    with pytest.raises(cs.InvalidArgumentError, match="give out="):
        cs.run(log_file, exports=("g2o",))
    with pytest.raises(cs.InvalidArgumentError, match="occupancy has an unknown key 'resolutio'"):
        cs.run(log_file, occupancy={"resolutio": 1.0})
    with pytest.raises(cs.InvalidArgumentError, match="unknown method"):
        cs.run(log_file, method="curvescam")
    assert not (tmp_path / "o").exists()


def test_reversed_beams_are_judged_alike_by_run_odometry_and_info(tmp_path, monkeypatch):
    from curvescan.diagnostics.beam_order import BeamOrder

    log = cs.simulate("office", n_scans=6, seed=1)
    found = BeamOrder(n_pairs=19, gain=-1.0, standard_error=0.1)
    monkeypatch.setattr("curvescan.diagnostics.sensor.beam_order_of_log", lambda log: found)
    result = cs.run(log)
    assert not result.prepared.sensor.can_deskew
    assert result.engine.config.deskew is False
    assert cs.odometry_for(log).config.deskew is False
    (issue,) = (i for i in cs.find_issues(cs.inspect_log(log)) if i.kind == "beams_reversed")
    assert issue in result.issues
    assert issue.sentence.endswith("try backwards=True")


def test_a_prior_that_turns_against_the_scans_is_refused(tmp_path):
    log = cs.simulate("office", n_scans=60, seed=2)
    path = tmp_path / "log.npz"
    cs.write_log(path, log)
    mirrored = cs.read_log(path, clockwise=True)
    with pytest.raises(
        cs.InvalidArgumentError, match=r"wheel odometry of log.npz turns against its scans.*clockwise=True"
    ):
        cs.run(mirrored, odometry_prior=True)
