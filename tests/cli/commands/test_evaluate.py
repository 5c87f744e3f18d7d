"""curvescan evaluate as a user runs it: what it prints and writes, and how it refuses."""

from __future__ import annotations

import json

import numpy as np
import pytest

import curvescan as cs
from curvescan.cli.main import run
from curvescan.io import write_csv, write_tum
from curvescan.io.trajectories.trajectory import Trajectory


@pytest.fixture
def folder(tmp_path):
    """A result of `curvescan odometry` of 60 scans, and true relations and poses of the robot that carried it."""
    rng = np.random.default_rng(1)
    motions = np.column_stack([np.full(59, 0.2), np.zeros(59), np.full(59, 0.1)])
    robot = [np.zeros(3)]
    for motion in motions:
        robot.append(cs.se2.compose(robot[-1], motion))
    robot = np.array(robot)
    stamps = 100.0 + 0.25 * np.arange(60)
    mount = [0.2, 0.0, np.radians(30.0)]
    noise = rng.normal(0.0, [0.01, 0.01, 0.01], (60, 3))
    own = cs.se2.compose(cs.se2.compose(robot, mount), noise)
    result = tmp_path / "result"
    result.mkdir()
    write_csv(result / "trajectory.csv", Trajectory(stamps=stamps, poses=own), ["matched"] * len(own))
    write_tum(result / "trajectory.tum", Trajectory(stamps=stamps, poses=own))
    write_tum(tmp_path / "truth.tum", Trajectory(stamps=stamps[::2], poses=robot[::2]))
    with (tmp_path / "intel.relations").open("w") as file:
        for i, j in [*((k, k + 6) for k in range(0, 50, 3)), (2, 58), (59, 1), (30, 27)]:
            x, y, yaw = cs.se2.between(robot[i], robot[j])
            file.write(f"{stamps[i]:.6f} {stamps[j]:.6f} {x:.6f} {y:.6f} 0 0 0 {yaw:.6f}\n")
        file.write("1 2 0 0 0 0 0 0\n")
    return tmp_path


MOUNT = ["--laser-pose", "0.2", "0", "30"]


def test_relations_are_measured_and_set_beside_what_was_published(folder, capsys):
    out = folder / "deep" / "evaluation"
    arguments = ["evaluate", str(folder / "result"), "--relations", str(folder / "intel.relations")]
    assert run([*arguments, *MOUNT, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "20 of 21 relations join two scans" in printed
    assert "1 relations are left out" in printed
    assert "Published on Intel" in printed
    assert "0.031 ± 0.026 m" in printed
    record = json.loads((out / "evaluation.json").read_text())["relations"]
    assert (record["near"]["translation_m"]["n"], record["far"]["rotation_rad"]["n"]) == (18, 2)
    # two noisy poses: sqrt(2) times 1 cm in x and in y, and what 0.01 rad makes of the mount
    assert 0.01 < record["near"]["translation_m"]["mean"] < 0.04
    assert 0.005 < record["near"]["rotation_rad"]["mean"] < 0.03
    report = (out / "evaluation.md").read_text()
    assert "Errors of relations" in report
    assert "![" in report
    for name in ("errors.png", "trajectory.png"):
        assert (out / name).stat().st_size > 5000
    assert run([*arguments, *MOUNT, "--near", "2", "--benchmark", "aces"]) == 0
    printed = capsys.readouterr().out
    assert "near, under 2 s apart" in printed
    assert "Published on ACES" in printed


def test_a_reference_is_measured(folder, capsys):
    out = folder / "evaluation"
    arguments = ["evaluate", str(folder / "result" / "trajectory.tum"), "--reference"]
    assert run([*arguments, str(folder / "truth.tum"), *MOUNT, "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "30 of 60 poses have one of the 30 reference poses, 30 of them at exactly" in printed
    assert "for each degree turned" in printed
    record = json.loads((out / "evaluation.json").read_text())["reference"]
    assert record["paired_by"] == "stamp"
    assert 0.005 < record["ate_best_m"]["rmse"] < 0.025
    assert record["ate_best_m"]["rmse"] < record["ate_first_m"]["rmse"]
    assert record["rpe_frame_translation_m"]["n"] == 29
    assert 5 <= record["rpe_metre_translation_m"]["n"] <= 11
    assert {p.name for p in out.iterdir()} == {"evaluation.md", "evaluation.json", "errors.png", "trajectory.png"}
    # poses that are the laser's already are not carried to it again
    assert run([*arguments, str(folder / "result"), *MOUNT]) == 0
    printed = capsys.readouterr().out
    assert "--laser-pose is left aside" in printed
    assert "0.0000 m" in printed


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "give either --relations or --reference"),
        (["--relations", "R", "--reference", "T"], "give either --relations"),
        (["--relations", "none"], "relations file none does not exist"),
        (["--reference", "none"], "trajectory none does not exist"),
        (["--relations", "empty"], "holds no relation"),
        (["--reference", "empty"], "is empty"),
        (["--relations", "R", "--laser-pose", "0", "nan", "0"], "must be finite"),
        (["--relations", "R", "--near", "-1"], "near must be at least 0 s"),
        (["--reference", "T", "--tolerance", "-1"], "tolerance must be at least 0 s"),
        (["--reference", "late"], "got 0: the trajectory's stamps run from 100"),
        (["--relations", "late.relations"], "none of the 1 relations joins"),
    ],
)
def test_what_cannot_be_measured_is_told_in_a_sentence(folder, capsys, arguments, sentence):
    (folder / "empty").touch()
    (folder / "late").write_text("5000 0 0 0 0 0 0 1\n5001 0 0 0 0 0 0 1\n")
    (folder / "late.relations").write_text("5000 5001 0 0 0 0 0 0\n")
    names = {"R": "intel.relations", "T": "truth.tum"}
    known = {"empty", "late", "late.relations", *names}
    paths = [str(folder / names.get(a, a)) if a in known else a for a in arguments]
    out = folder / "out"
    assert run(["evaluate", str(folder / "result"), *paths, "--out", str(out)]) == 1
    error = capsys.readouterr().err
    assert error.startswith("curvescan: ")
    assert error.count("\n") == 1
    assert sentence in error
    assert not out.exists()


def test_poses_whose_stamps_tell_nothing_are_paired_in_their_order(folder, capsys):
    poses = np.column_stack([np.arange(5.0), np.zeros(5), np.zeros(5)])
    write_tum(folder / "a.tum", Trajectory(stamps=np.full(5, 1e9), poses=poses))
    write_tum(folder / "b.tum", Trajectory(stamps=np.arange(5.0), poses=poses))
    arguments = ["evaluate", str(folder / "a.tum"), "--reference", str(folder / "b.tum")]
    assert run([*arguments, "--out", str(folder / "o")]) == 0
    assert "paired in their order: most time stamps repeat" in capsys.readouterr().out
    # errors of exactly 0 are drawn too
    assert (folder / "o" / "errors.png").exists()


def test_a_benchmark_is_one_of_those_known(capsys):
    with pytest.raises(SystemExit, match=r"^2$"):
        run(["evaluate", "T", "--relations", "R", "--benchmark", "x"])
    assert "mit-killian-court" in capsys.readouterr().err


@pytest.mark.parametrize("laser_pose", [(0.0, 0.0), None, "x", ((0.0,), 0.0), (0.0, 0.0, np.inf)])
def test_a_pose_of_the_laser_that_is_none_is_refused(folder, laser_pose):
    with pytest.raises(cs.InvalidArgumentError, match="laser_pose must be three finite numbers x, y, theta"):
        cs.evaluate(folder / "result", reference=folder / "truth.tum", laser_pose=laser_pose)
