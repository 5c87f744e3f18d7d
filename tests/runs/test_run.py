"""cs.run: what `curvescan odometry` calls, and the same from Python."""

from __future__ import annotations

import json

import numpy as np
import pytest
from matplotlib.figure import Figure

import curvescan as cs
from curvescan.cli.main import run as command
from curvescan.diagnostics.sensor import judge_sensor

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
    odometry = cs.Odometry()
    expected = [odometry.add(scan).pose for scan in log]
    np.testing.assert_array_equal(result.trajectory.poses, expected)
    assert "\n" not in repr(result)


def test_a_run_says_what_is_wrong_with_its_arguments(log_file, tmp_path):
    with pytest.raises(cs.InvalidArgumentError, match=r"unknown export 'g20': did you mean 'g2o'"):
        cs.run(log_file, out=tmp_path / "o", exports=("g20",))
    with pytest.raises(cs.InvalidArgumentError, match="give out="):
        cs.run(log_file, exports=("g2o",))
    with pytest.raises(cs.InvalidArgumentError, match="occupancy has an unknown key 'resolutio'"):
        cs.run(log_file, occupancy={"resolutio": 1.0})
    with pytest.raises(cs.InvalidArgumentError, match="unknown method"):
        cs.run(log_file, method="curvescam")
    for n in (0, 1.5, True, "a", None):
        with pytest.raises(cs.InvalidArgumentError, match="n_processes must be a whole number of at least 1"):
            cs.run(log_file, n_processes=n)
    assert not (tmp_path / "o").exists()


def test_reversed_beams_are_judged_alike_by_run_odometry_and_info(tmp_path, monkeypatch):
    from curvescan.diagnostics.sensor import BeamOrder

    log = cs.simulate("office", n_scans=6, seed=1)
    found = BeamOrder(n_pairs=19, gain=-1.0, standard_error=0.1)
    monkeypatch.setattr("curvescan.diagnostics.sensor.beam_order_of_log", lambda log: found)
    result = cs.run(log)
    assert not result.prepared.sensor.can_deskew
    assert result.engine.config.deskew is False
    assert judge_sensor(log).can_deskew is False
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


@pytest.mark.slow
def test_one_call_gives_one_kind_of_object(log_file, tmp_path):
    slam = cs.run(log_file, "slam")
    slam.map.save(tmp_path / "floor.csmap")
    found = cs.localize(log_file, tmp_path / "floor.csmap")
    for run, kind in ((cs.run(log_file), cs.OccupancyGrid), (slam, cs.SlamMap), (found, cs.SlamMap)):
        assert isinstance(run, cs.Run)
        assert isinstance(run.map, kind)
        assert len(run.trajectory) == len(run.steps) == 12
        assert all(isinstance(step, cs.Step) for step in run.steps)
        assert run.verdict.sentence
        assert run.plot(ax=Figure().subplots()).images
        assert run._repr_png_().startswith(b"\x89PNG")
        assert run.verdict.sentence in run._repr_html_()
        assert "\n" not in repr(run)
        files = run.save(tmp_path / "saved" / type(run.engine).__name__)
        assert {"trajectory.tum", "map.png", "run.json"} <= set(files)
    assert found.steps[0].ok
    assert found.steps[0].covariance_global is not None
    np.testing.assert_array_equal(slam.steps[5].pose_odom, slam.record.odometry.poses[5])
    # the match of a step is drawn with the scans of the log
    step = slam.steps[4]
    cs.plot.match(step.match, slam.log[step.reference], slam.log[4], ax=Figure().subplots())


@pytest.mark.slow
def test_paths_stand_for_maps(log_file, tmp_path):
    log, path = cs.read_log(log_file), tmp_path / "floor.csmap"
    cs.run(log, "slam").map.save(path)
    assert len(cs.load_map(path)) == len(cs.load_map(str(path)))
    assert cs.Localizer(str(path)).add(log[3]).ok
    slam = cs.Slam(map=str(path))
    slam.add(log[3])
    assert slam.map.n_sessions == 2
    for given in (None, 3):
        with pytest.raises(cs.InvalidArgumentError, match="a map must be given as a path, got "):
            cs.Localizer(given)
    with pytest.raises(cs.LogFormatError, match="no free place"):  # a plain map is localized in; this one is empty
        cs.Localizer(cs.OccupancyBuilder().grid())


def test_scans_are_a_log(log_file):
    scans = list(cs.read_log(log_file))
    assert cs.run(scans).trajectory == cs.run(log_file).trajectory
    with pytest.raises(cs.InvalidArgumentError, match="an iterable of LaserScan or the path of a file, got int"):
        cs.run(3)
    with pytest.raises(cs.InvalidArgumentError, match="got list with a float"):
        cs.run([*scans, 1.0])
    with pytest.raises(cs.InvalidArgumentError, match="a log must be given as a path, got list"):
        cs.read_log(scans)


def test_an_engine_that_is_none_is_told_with_the_nearest(log_file):
    with pytest.raises(
        cs.InvalidArgumentError, match=r"engine must be .odometry. or .slam., got 'slamm'; did you mean 'slam'\?$"
    ):
        cs.run(log_file, "slamm")
    with pytest.raises(cs.InvalidArgumentError, match="odometry continues no map: give engine='slam'"):
        cs.run(log_file, map="floor.csmap")


def test_a_run_is_evaluated_in_one_call(log_file, tmp_path):
    run = cs.run(log_file)
    cs.write_tum(tmp_path / "own.tum", run.trajectory)
    errors = [
        cs.evaluate(source, reference=tmp_path / "own.tum") for source in (run, run.trajectory, tmp_path / "own.tum")
    ]
    assert all(one.ate_best.max() < 1e-9 for one in errors)
    assert repr(errors[0]).startswith("ReferenceErrors(12 poses over ")
    one, other = run.trajectory.stamps[[0, 5]]
    (tmp_path / "r").write_text(f"{one:.9f} {other:.9f} 0 0 0 0 0 0\n")
    errors = cs.evaluate(run, relations=tmp_path / "r")
    assert errors.translation[0] == pytest.approx(np.hypot(*run.trajectory.poses[5, :2]))
    assert repr(errors).startswith("RelationErrors(1 of 1 relations, mean ")
    with pytest.raises(cs.InvalidArgumentError, match="give either relations= or reference="):
        cs.evaluate(run)
    with pytest.raises(cs.InvalidArgumentError, match="a Run, a Trajectory or a path, got ndarray"):
        cs.evaluate(run.trajectory.poses, reference=run)


@pytest.mark.parametrize("engine", ["odometry", "slam"])
def test_a_log_without_scans_is_no_log(engine, tmp_path):
    with pytest.raises(cs.InvalidArgumentError, match="a log must hold at least one scan, got 0"):
        cs.run([], engine, out=tmp_path / "out")
    assert not (tmp_path / "out").exists()


def test_an_unknown_option_is_told():
    with pytest.raises(cs.InvalidArgumentError, match="run has an unknown key 'odometry_priors': did you mean 'odom"):
        cs.run([], odometry_priors=True)
    with pytest.raises(cs.InvalidArgumentError, match="localize has an unknown key 'truth'"):
        cs.localize([], "floor.csmap", truth=None)


@pytest.mark.slow
def test_the_record_of_a_run_is_json_where_a_parameter_is_infinite(log_file, tmp_path):
    cs.run(log_file, config={"keyframes": {"distance": float("inf")}}, out=tmp_path / "a")
    record = json.loads((tmp_path / "a" / "run.json").read_text(), parse_constant=pytest.fail)
    assert record["config"]["odometry"]["keyframes"]["distance"] == "inf"
