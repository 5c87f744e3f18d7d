"""What a command writes, what it never replaces, and what it says in the end."""

from __future__ import annotations

import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

import curvescan as cs
from curvescan.cli.main import run
from curvescan.io import write_log
from curvescan.io.arrays.memory import MemoryLog
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.map_server import read_map, write_map
from curvescan.mapping.occupancy import OccupancyGrid


@pytest.fixture(scope="module")
def drive() -> cs.Simulation:
    return cs.simulate("office", n_scans=60, seed=4)


@pytest.fixture
def log(drive: cs.Simulation, tmp_path: Path) -> Path:
    write_log(tmp_path / "drive.npz", MemoryLog(scans=tuple(drive)[:8]))
    return tmp_path / "drive.npz"


def test_a_log_with_the_name_of_a_result_is_not_replaced(log, tmp_path, capsys):
    out = tmp_path / "out"
    out.mkdir()
    named = log.rename(out / "view.npz")
    before = named.read_bytes()
    assert run(["odometry", str(named), "--out", str(out)]) == 1
    assert "has the name of a result, which would replace it: choose another folder" in capsys.readouterr().err
    assert named.read_bytes() == before
    assert [path.name for path in out.iterdir()] == ["view.npz"]
    with pytest.raises(cs.OutputError, match="has the name of a result"):
        cs.run(named, "odometry").save(out)
    assert named.read_bytes() == before


@pytest.mark.parametrize(
    ("name", "said"), [("drive.npz", "a name that ends in .mcap"), ("d.mcap", "is the log itself")]
)
def test_a_recording_replaces_no_log(log, tmp_path, capsys, name, said):
    write_log(tmp_path / "d.mcap", cs.read_log(log))
    given = tmp_path / name
    before = given.read_bytes()
    assert run(["live", str(given), "--no-page", "--speed", "0", "--record", str(given)]) == 1
    assert said in capsys.readouterr().err
    assert given.read_bytes() == before


def test_a_page_replaces_no_log(log, tmp_path):
    before = log.read_bytes()
    with pytest.raises(cs.InvalidArgumentError, match=r"needs a name that ends in \.html, got"):
        cs.view(cs.run(log, "odometry")).save(log)
    assert log.read_bytes() == before
    with pytest.raises(cs.InvalidArgumentError, match="or a run, got NoneType"):
        cs.view(None)


def test_what_goes_with_the_run_before_is_told(log, tmp_path, capsys):
    out = tmp_path / "out"
    for command, gone in (("slam", ""), ("slam", ""), ("odometry", "closures.csv, graph.g2o, graph.png, map.csmap")):
        assert run([command, str(log), "--out", str(out)]) in (0, 3)
        told = [line for line in capsys.readouterr().err.splitlines() if line.startswith("removed from")]
        assert len(told) == bool(gone)
        assert gone in "".join(told)


def test_a_map_is_not_changed_in_the_folder_of_its_run(log, tmp_path, capsys):
    out = tmp_path / "out"
    assert run(["slam", str(log), "--out", str(out)]) in (0, 3)
    before = (out / "map.csmap").read_bytes()
    assert run(["map", str(out / "map.csmap"), "--turn", "90", "--out", str(out)]) == 1
    assert "holds a run, whose other results would not fit the map any more" in capsys.readouterr().err
    assert (out / "map.csmap").read_bytes() == before
    assert run(["map", str(out / "map.csmap"), "--turn", "nan", "--out", str(tmp_path / "turned")]) == 1
    assert "--turn must be finite degrees, got nan" in capsys.readouterr().err


def test_a_map_is_not_changed_in_place_of_itself(tmp_path, capsys):
    grid = OccupancyGrid(log_odds=np.ones((4, 5), np.float32), origin=np.zeros(2), config=OccupancyConfig())
    write_map(tmp_path, grid)
    (tmp_path / "floor.yaml").write_bytes((tmp_path / "map.yaml").read_bytes())
    other = tmp_path / "other"
    write_map(other, grid)
    before = {path: path.read_bytes() for path in tmp_path.rglob("*.*")}
    for given in (
        ["map.yaml"],
        ["map.pgm"],
        ["floor.yaml"],
        ["other/map.yaml", "--compare", str(tmp_path / "map.yaml")],
    ):
        assert run(["map", str(tmp_path / given[0]), *given[1:], "--turn", "90", "--out", str(tmp_path)]) == 1
        assert "has the name of a result, which would replace it" in capsys.readouterr().err
    assert {path: path.read_bytes() for path in tmp_path.rglob("*.*")} == before
    assert run(["map", str(other / "map.yaml"), "--turn", "90", "--out", str(tmp_path)]) == 0


def test_the_occupancy_of_a_map_that_is_continued_shows_all_of_it(drive, tmp_path):
    scans = list(drive)
    first = cs.run(scans, "slam", out=tmp_path / "first")
    blank = [replace(scan, ranges=np.full(len(scan), np.nan)) for scan in scans[:5]]
    for k, new in enumerate((scans[-10:], blank)):
        cs.run(new, "slam", map=first.map, out=tmp_path / f"{k}")
        grid, whole = read_map(tmp_path / f"{k}" / "map.yaml"), first.map.occupancy()
        off = cKDTree(grid.occupied_centres).query(whole.occupied_centres)[0]
        assert np.mean(off < 0.15) > 0.75  # of the first drive there are the keyframes


def test_a_map_that_is_saved_holds_its_occupancy(drive, tmp_path):
    slam = cs.Slam()
    for scan in drive:
        slam.add(scan)
    slam.finish()
    slam.map.save(tmp_path / "floor.csmap")
    saved = cs.load_map(tmp_path / "floor.csmap")
    assert saved.grid is not None
    np.testing.assert_array_equal(saved.grid.log_odds, slam.map.occupancy().log_odds)


def test_what_a_format_does_not_say_of_the_mount_is_told(drive, tmp_path, capsys):
    folder = tmp_path / "mines"
    folder.mkdir()
    path = folder / "drive.clf"
    lines = []
    for k, scan in enumerate(tuple(drive)[:3]):
        ranges = " ".join(f"{r:.3f}" for r in np.nan_to_num(scan.ranges, posinf=80.0))
        lines.append(f"FLASER {len(scan)} {ranges} {k}.5 0 0 {k} 0 0 {k} host {k}\n")
    path.write_text("".join(lines))
    assert run(["convert", str(path), str(tmp_path / "drive.npz")]) == 0
    assert "not kept: where the laser sits on the robot" in capsys.readouterr().err


@pytest.mark.parametrize("given", [("0", "0", "0", "-1", "5"), ("nan", "0", "0"), ("0", "0", "0", "0", "5")])
def test_an_initial_pose_that_is_none_is_told_as_it_was_given(log, tmp_path, capsys, given):
    assert run(["localize", str(log), "--map", str(log), "--initial-pose", *given, "--out", str(tmp_path / "o")]) == 1
    assert f"finite X Y DEG and deviations M DEG > 0, got {' '.join(given)}" in capsys.readouterr().err


def test_options_of_another_source_are_refused(log, capsys):
    for arguments, said in (
        ([str(log), "--scans", "10"], "--scans is of the simulated robot"),
        (["--port", "/dev/null"], "--port /dev/null needs --driver"),
    ):
        assert run(["live", "--no-page", *arguments]) == 1
        assert said in capsys.readouterr().err


def test_a_batch_of_no_logs_is_none(tmp_path, capsys):
    assert run(["batch", "--out", str(tmp_path / "out")]) == 1
    assert "a batch needs at least one log" in capsys.readouterr().err


def test_a_match_that_fails_says_so_last(tmp_path, capsys, drive):
    scans = (drive[0], replace(drive[1], ranges=np.full(len(drive[1]), np.nan)))
    write_log(tmp_path / "two.npz", MemoryLog(scans=scans))
    assert run(["match", str(tmp_path / "two.npz"), "0", "1", "--out", str(tmp_path / "out")]) == 3
    assert "what helps:" in capsys.readouterr().out.splitlines()[-1]


def test_a_drive_of_one_scan_is_not_to_be_trusted(tmp_path, capsys):
    assert run(["demo", "--scans", "1", "--out", str(tmp_path / "demo")]) == 3
    assert capsys.readouterr().out.splitlines()[-1].startswith("not to be trusted")


@pytest.mark.filterwarnings("default")
def test_a_warning_is_told_once_a_log(tmp_path, capsys, drive):
    lines = []
    for k, scan in enumerate(tuple(drive)[:3]):
        ranges = " ".join(f"{1000 * r:.0f}" for r in np.nan_to_num(scan.ranges, posinf=80.0))
        lines.append(f"FLASER {len(scan)} {ranges} {k} 0 0 {k} 0 0 {k} host {k}\n")
    (tmp_path / "mm.clf").write_text("".join(lines))
    run(["info", str(tmp_path / "mm.clf")])
    told = capsys.readouterr().err
    assert told.count("divide them by 1000") == 1
    assert "Warning" not in told


@pytest.mark.skipif(os.name == "nt", reason="no pipes to head there")
def test_a_reader_that_goes_away_is_no_error(log):
    command = f"{sys.executable} -m curvescan info {log} | true; exit ${{PIPESTATUS[0]}}"
    done = subprocess.run(["bash", "-c", command], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="no device that is always full")
def test_what_cannot_be_printed_is_one_sentence(log):
    with Path("/dev/full").open("w") as full:
        command = [sys.executable, "-m", "curvescan", "info", str(log)]
        done = subprocess.run(command, stdout=full, stderr=subprocess.PIPE, text=True, check=False)
    assert done.returncode == 1
    assert done.stderr.splitlines()[-1].startswith("curvescan: cannot print: No space left on device; make room")
    assert "Traceback" not in done.stderr
