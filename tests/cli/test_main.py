"""The commands as a user runs them: what they print, write and return, and how they fail."""

from __future__ import annotations

import gzip
import io
import json
import os
import signal
import subprocess
import sys
import threading
from dataclasses import replace
from pathlib import Path
from typing import get_args

import numpy as np
import pytest
from rich.console import Console

from curvescan._version import described
from curvescan.benchmarks.scenarios import SCENARIOS
from curvescan.cli import console
from curvescan.cli.command_line import COMMANDS, run
from curvescan.cli.console import with_flags
from curvescan.cli.options import (
    BenchmarkName,
    MatcherFlags,
    Method,
    OdometryFlags,
    SensorName,
    WorldName,
    results_folder,
)
from curvescan.diagnostics.sensor import BeamOrder
from curvescan.evaluation.relations import BENCHMARKS
from curvescan.matchers import MATCHERS
from curvescan.odometry import KeyframesConfig, Odometry, OdometryConfig
from curvescan.simulation import WORLDS
from curvescan.simulation.sensing.sensors import SENSORS
from tests.scenes import room_scan


def flaser(scan, k):
    ranges = " ".join(f"{r:.3f}" for r in scan.ranges)
    pose = f"{0.02 * k:.3f} 0.0 0.0"
    return f"FLASER {len(scan)} {ranges} {pose} {pose} {100 + 0.2 * k:.6f} host {0.2 * k:.6f}\n"


@pytest.fixture
def log(tmp_path):
    """Eight scans of a sensor that moves on by 2 cm each time."""
    path = tmp_path / "room.log"
    scans = [room_scan((0.02 * k, 0.0, 0.0), sigma=0.003, seed=k) for k in range(8)]
    path.write_text("".join(flaser(scan, k) for k, scan in enumerate(scans)))
    return path


def leftovers(folder):
    return [p.name for p in folder.iterdir() if p.name.startswith(".")]


def test_odometry_writes_all_files(log, tmp_path, capsys):
    out = tmp_path / "deep" / "result"
    assert run(["odometry", str(log), "--out", str(out)]) == 0
    printed = capsys.readouterr().out
    assert "8 scans" in printed
    written = next(line for line in printed.splitlines() if line.startswith(f"wrote {out}/"))
    assert {"trajectory.tum", "map.png", "run.json"} <= set(written.removeprefix(f"wrote {out}/").split(", "))
    lines = (out / "trajectory.tum").read_text().splitlines()
    assert [line.split()[0] for line in lines[:2]] == ["100.0", "100.2"]
    assert all(len(line.split()) == 8 for line in lines)
    record = json.loads((out / "run.json").read_text())
    assert record["input"]["scans"] == 8
    assert record["verdict"] == {"is_trusted": True, "reasons": []}
    assert printed.splitlines()[-1].startswith("trusted")
    assert (out / "map.png").stat().st_size > 1000


def test_a_wreck_ends_with_the_reason_and_a_status_of_its_own(tmp_path, capsys):
    path, out = tmp_path / "wreck.clf", tmp_path / "out"
    scans = [room_scan((0.02 * k, 0.0, 0.0), sigma=0.003, seed=k) for k in range(8)]
    lines = [flaser(scan, k) for k, scan in enumerate(scans)]
    for k in (3, 4, 5):
        lines[k] = flaser(replace(scans[k], ranges=np.zeros(len(scans[k]))), k)
    path.write_text("".join(lines))
    assert run(["odometry", str(path), "--out", str(out)]) == 3
    last = capsys.readouterr().out.splitlines()[-1]
    assert last.startswith("not to be trusted: 3 of 7 scans are not matched")
    verdict = json.loads((out / "run.json").read_text())["verdict"]
    assert not verdict["is_trusted"]
    assert last.endswith(with_flags("; ".join(verdict["reasons"])))


def test_odometry_takes_gzip_and_parameters(log, tmp_path):
    packed = tmp_path / "packed.clf"
    packed.write_bytes(gzip.compress(log.read_bytes()))
    arguments = ["odometry", str(packed), "--out", str(tmp_path / "o"), "--method", "cfsma"]
    assert run([*arguments, "--cfsma.landmarks.n-neighbours", "12"]) == 0
    record = json.loads((tmp_path / "o" / "run.json").read_text())
    assert record["config"]["cfsma"]["landmarks"]["n_neighbours"] == 12


@pytest.mark.parametrize("method", MATCHERS)
def test_a_chain_that_suits_the_method_is_that_of_the_library(method):
    matching = MatcherFlags(method=method)
    given = OdometryFlags(matching=matching, odometry=OdometryConfig(keyframes=KeyframesConfig(distance=0.3)))
    last = OdometryConfig.scan_to_scan()
    assert given.config("keys") == given.odometry
    assert given.config("last") == last
    assert OdometryFlags(matching=matching).config("auto") == OdometryConfig.of_method(method)
    assert given.config("auto") == (given.odometry if method == "curvescan" else last)


def test_the_order_of_the_beams_is_asked_for_where_it_matters(log, tmp_path, capsys, monkeypatch):
    asked = []
    monkeypatch.setattr(
        "curvescan.diagnostics.sensor.beam_order_of_log",
        lambda log: asked.append(log) or BeamOrder(n_pairs=9, gain=-1.0, standard_error=0.1),
    )
    for flags, n_asked in (([], 1), (["--odometry.no-deskew"], 0)):
        asked.clear()
        assert run(["odometry", str(log), "--out", str(tmp_path / "o"), *flags]) == 0
        assert len(asked) == n_asked
        remark = "sweeps are not deskewed: their beams are listed in reverse"
        assert (remark in " ".join(capsys.readouterr().err.split())) == bool(n_asked)
        record = json.loads((tmp_path / "o" / "run.json").read_text())
        assert record["config"]["odometry"]["deskew"] is False


@pytest.mark.slow
@pytest.mark.parametrize("method", ["idc", "cox", "histogram", "icp", "plicp"])
def test_odometry_and_match_run_every_method(log, tmp_path, capsys, method):
    out = tmp_path / "o"
    assert run(["odometry", str(log), "--out", str(out), "--method", method]) == 0
    record = json.loads((out / "run.json").read_text())
    assert list(record["config"]) == [method, "odometry"]
    assert record["outcomes"]["matched"] == 7
    assert run(["match", str(log), "0", "3", "--out", str(tmp_path / "m"), "--method", method]) == 0
    assert "matched.png" in capsys.readouterr().out


def test_the_parameters_of_a_rival_are_flags(log, tmp_path):
    arguments = ["odometry", str(log), "--out", str(tmp_path / "o"), "--method", "idc"]
    assert run([*arguments, "--idc.window.decay", "0.3", "--idc.kept-share", "0.7"]) == 0
    config = json.loads((tmp_path / "o" / "run.json").read_text())["config"]["idc"]
    assert config["window"]["decay"] == 0.3
    assert config["kept_share"] == 0.7


def test_a_config_file_sets_parameters_and_flags_change_them(log, tmp_path, capsys):
    config = tmp_path / "my.toml"
    config.write_text("[cfsma.landmarks]\nn_neighbours = 12\nmin_similarity = 0.3\n")
    out = tmp_path / "o"
    arguments = ["odometry", str(log), "--out", str(out), "--method", "cfsma"]
    arguments += ["--config", str(config), "--cfsma.landmarks.n-neighbours", "15"]
    assert run(arguments) == 0
    landmarks = json.loads((out / "run.json").read_text())["config"]["cfsma"]["landmarks"]
    assert landmarks["n_neighbours"] == 15
    assert landmarks["min_similarity"] == 0.3
    config.write_text("[cfsma.landmarks]\nneighbours = 12\n")
    assert run(arguments) == 1
    assert "did you mean 'n_neighbours'" in capsys.readouterr().err
    assert run(["odometry", str(log), "--out", str(out), "--config", "nowhere.toml"]) == 1
    assert "cannot read nowhere.toml" in capsys.readouterr().err


def test_match_prints_the_pose_and_draws(log, tmp_path, capsys):
    out = tmp_path / "m"
    assert run(["match", str(log), "0", "3", "--out", str(out)]) == 0
    assert "scan 3 seen from scan 0" in capsys.readouterr().out
    record = json.loads((out / "match.json").read_text())
    assert record["outcome"] == "matched"
    assert record["pose"][0] == pytest.approx(0.06, abs=0.03)


def test_info_tells_what_is_in_a_log(log, capsys):
    assert run(["info", str(log)]) == 0
    printed = capsys.readouterr().out
    assert "CARMEN log" in printed
    assert "361" in printed
    assert "180.00 deg from -90.00 deg in steps of 0.5 deg" in printed


def test_info_as_json(log, tmp_path, capsys):
    assert run(["info", str(log), "--json"]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["usable"] is True
    assert printed["report"]["n_scans"] == 8
    assert "no_beam_times" in [issue["kind"] for issue in printed["issues"]]
    # what is not usable says so in both forms
    short = tmp_path / "short.log"
    short.write_text(log.read_text().splitlines()[0] + "\n")
    assert run(["info", str(short)]) == 1
    assert "not usable: motion takes two scans" in capsys.readouterr().out
    assert run(["info", str(short), "--json"]) == 1
    assert json.loads(capsys.readouterr().out)["usable"] is False


def test_odometry_takes_the_cells_of_the_map(log, tmp_path, capsys):
    out = tmp_path / "o"
    assert run(["odometry", str(log), "--out", str(out), "--map.resolution", "0.2"]) == 0
    assert "map.pgm, map.png, map.yaml" in capsys.readouterr().out
    assert "resolution: 0.2\n" in (out / "map.yaml").read_text()
    with pytest.raises(SystemExit) as exit_info:
        run(["odometry", str(log), "--out", str(out), "--map.resolution", "0"])
    assert exit_info.value.code == 2


def test_brackets_in_a_file_are_brackets(log, tmp_path, capsys):
    strange = tmp_path / "[bold]x[y].log"
    strange.write_text("[/red] 1 2 3\n" + log.read_text())
    assert run(["info", str(strange)]) == 0
    printed = capsys.readouterr().out
    assert "[bold]x[y].log" in printed
    assert "1 [/red]" in printed
    out = tmp_path / "[o]"
    assert run(["match", str(strange), "0", "1", "--out", str(out)]) == 0
    assert "[bold]x[y].log: scan 1" in capsys.readouterr().out


def test_demo_needs_no_data(tmp_path, capsys):
    assert run(["demo", "--out", str(tmp_path / "d"), "--world", "room", "--scans", "5"]) == 0
    printed = capsys.readouterr().out
    assert "wheel odometry" in printed
    assert (tmp_path / "d" / "map.png").exists()


@pytest.mark.slow
def test_bench_measures_and_tabulates(log, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr("curvescan.benchmarks.benchmark.BEAM_COUNTS", (181, 361))
    monkeypatch.setattr("curvescan.benchmarks.benchmark.SCENARIOS", SCENARIOS[:2])
    arguments = ["bench", "--pairs", "2", "--runs", "5", "--logs", str(log), "--out", str(tmp_path / "bench")]
    assert run(arguments) == 0
    printed = capsys.readouterr().out
    written = (tmp_path / "bench" / "bench.md").read_text()
    for title in ("Time of a scan of 361 beams", "Experiment 1, cfsma, 5 runs", "real logs"):
        assert title in printed
        assert title in written
    assert "| room.log | cfsma | 7 |" in written


def bad_inputs(tmp_path):
    empty, text, cut = tmp_path / "empty.log", tmp_path / "notes.txt", tmp_path / "cut.log"
    empty.touch()
    text.write_text("Dear diary\n" * 20)
    cut.write_text("FLASER 361 1.0 1.0")
    return {
        "missing": (tmp_path / "nowhere.log", "nowhere.log does not exist"),
        "empty": (empty, "empty.log is empty"),
        "folder": (tmp_path, "is a folder"),
        "text": (text, "text of an unknown format (it begins 'Dear diary')"),
        "cut": (cut, "line cut short"),
    }


@pytest.mark.parametrize("kind", ["missing", "empty", "folder", "text", "cut"])
@pytest.mark.parametrize("command", ["info", "odometry", "match"])
def test_bad_input_is_one_sentence_and_status_1(command, kind, tmp_path, capsys):
    path, word = bad_inputs(tmp_path)[kind]
    rest = {"info": [], "odometry": ["--out"], "match": ["0", "1", "--out"]}[command]
    if rest:
        rest = [*rest, str(tmp_path / "out")]
    assert run([command, str(path), *rest]) == 1
    error = capsys.readouterr().err
    assert error.startswith("curvescan: ")
    assert word in error
    assert "Traceback" not in error
    assert len(error.strip().splitlines()) == 1
    assert not (tmp_path / "out").exists()
    assert not leftovers(tmp_path)


def test_an_output_that_cannot_be_written_is_told_before_the_work(log, tmp_path, capsys):
    taken = tmp_path / "taken"
    taken.write_text("a file")
    for out in (taken, taken / "below"):
        assert run(["odometry", str(log), "--out", str(out)]) == 1
        captured = capsys.readouterr()
        assert "taken" in captured.err
        assert len(captured.err.strip().splitlines()) == 1
    assert taken.read_text() == "a file"


def test_a_scan_that_does_not_exist_is_told(log, tmp_path, capsys):
    assert run(["match", str(log), "0", "8", "--out", str(tmp_path / "m")]) == 1
    assert "there is no scan 8: room.log has 8 scans, numbered 0 to 7" in capsys.readouterr().err


def test_parameters_out_of_range_are_told(log, tmp_path, capsys):
    arguments = ["odometry", str(log), "--out", str(tmp_path / "o")]
    with pytest.raises(SystemExit) as exit_info:
        run([*arguments, "--cfsma.functions.length", "100"])
    assert exit_info.value.code == 2
    assert "two, at least 8, got 100" in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


def test_a_command_that_does_not_exist_is_told_with_the_nearest(capsys):
    assert run(["odometri", "a"]) == 2
    assert (
        "there is no command 'odometri': did you mean 'odometry'? all commands: curvescan -h" in capsys.readouterr().err
    )
    assert run(["-x", "info"]) == 2
    assert "there is no command '-x': all commands: curvescan -h" in capsys.readouterr().err
    with pytest.raises(SystemExit, match=r"^0$"):
        run(["--help-all"])
    assert "odometry" in capsys.readouterr().out
    assert run(["fly"]) == 2
    assert "there is no command 'fly': all commands: curvescan -h" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ("odometry LOG --nofl", "odometry does not take '--nofl'; help: curvescan odometry -h"),
        ("odometry LOG --lazer-only", "'--lazer-only': did you mean '--laser-only'?; help: curvescan odometry -h"),
        ("odometry --lazer-only LOG", "'--lazer-only': did you mean '--laser-only'?; help: curvescan odometry -h"),
        ("map MAP --crop 1 2", "--crop takes X0 Y0 X1 Y1, got '1 2'; help: curvescan map -h"),
        ("odometry LOG --mounts", "odometry does not take '--mounts'; help: curvescan odometry -h"),
        ("slam LOG --range-max x", "--range-max takes a number, got 'x'; help: curvescan slam -h"),
        ("slam LOG --drop 1 x", "--drop takes I J, got '1 x'; help: curvescan slam -h"),
        ("localize A --map B --initial-pose 1 2 x", "--initial-pose takes X Y DEG [M DEG], got '1 2 x'; help: "),
        ("odometry LOG --out", "--out takes PATH, got nothing; help: curvescan odometry -h"),
        ("match LOG a 1", "I takes a whole number, got 'a'; help: curvescan match -h"),
        ("match LOG 1", "Missing from curvescan match: J Number of the current scan, from 0; help: curvescan match -h"),
        ("odometry LOG --chain x", "invalid choice 'x' for argument '--chain'. Expected one of ('auto', 'keys', "),
        ("odometry LOG --map.resolution 0", "resolution must be a positive number of metres, got 0.0; help: "),
    ],
)
def test_a_wrong_command_line_is_one_sentence_that_names_the_commands_own_help(arguments, sentence, capsys):
    with pytest.raises(SystemExit, match=r"^2$"):
        run(arguments.split())
    printed = capsys.readouterr()
    assert sentence in printed.err
    assert printed.err.startswith("curvescan: ")
    assert printed.err.count("\n") == 1
    assert printed.out == ""


def test_scans_that_do_not_match_are_one_sentence(log, tmp_path, capsys):
    arguments = ["match", str(log), "0", "1", "--out", str(tmp_path / "m")]
    assert run([*arguments, "--method", "cfsma", "--cfsma.landmarks.min-similarity", "1"]) == 3
    printed = capsys.readouterr().out
    assert "; what helps: scans that share more" in printed
    assert ".;" not in printed


def test_results_have_a_folder_of_their_own_by_default(log, tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for _ in range(2):
        assert run(["odometry", str(log)]) == 0
    assert {"room-odometry", "room-odometry-2"} <= {path.name for path in tmp_path.iterdir()}
    assert "wrote room-odometry-2/" in capsys.readouterr().out
    assert (tmp_path / "room-odometry-2" / "run.json").exists()
    packed = tmp_path / "hall.csv.gz"
    assert results_folder(None, packed, "slam") == Path("hall-slam")
    assert results_folder(tmp_path / "here", packed, "slam") == tmp_path / "here"


def test_scans_that_do_not_match_have_a_status_of_their_own(log, tmp_path, capsys):
    log.write_text(log.read_text() + flaser(replace(room_scan(), ranges=np.zeros(361)), 8))
    assert run(["match", str(log), "0", "8", "--out", str(tmp_path / "m")]) == 3
    assert "scan 8 seen from scan 0: A scan has no segment" in capsys.readouterr().out
    assert (tmp_path / "m" / "matched.png").stat().st_size > 1000


def test_info_wraps_and_ends_with_the_command_to_run(log, capsys, monkeypatch):
    monkeypatch.setattr(console.OUT, "_width", 60)
    assert run(["info", str(log)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines[:-1])) <= 60
    assert any(line.startswith(" " * 19) and line.strip() for line in lines)
    assert "to map it: curvescan slam" in " ".join(lines[-2:])


@pytest.mark.parametrize(("columns", "width"), [(None, 120), ("70", 70)])
def test_what_is_piped_is_as_wide_as_is_asked(log, columns, width):
    environment = {name: value for name, value in os.environ.items() if name != "COLUMNS"}
    command = [sys.executable, "-m", "curvescan", "info", str(log)]
    done = subprocess.run(
        command, env=environment | ({"COLUMNS": columns} if columns else {}), capture_output=True, check=True
    )
    lines = done.stdout.decode().splitlines()
    assert width - 25 < max(map(len, lines[:-1])) <= width


def test_a_picture_without_its_yaml_file_is_refused_with_what_is_needed(log, tmp_path, capsys):
    (tmp_path / "floor.pgm").write_bytes(b"P5\n1 1\n255\n0")
    assert run(["localize", str(log), "--map", str(tmp_path / "floor.pgm")]) == 1
    assert "floor.yaml beside it" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [["odometry"], ["info", "a", "--no-such"]])
def test_a_wrong_command_line_is_status_2(arguments):
    with pytest.raises(SystemExit) as exit_info:
        run(arguments)
    assert exit_info.value.code == 2


@pytest.mark.parametrize("command", [[], *[[name] for name in COMMANDS]])
def test_help_explains_itself_and_loads_nothing_heavy(command):
    code = (
        "import sys; from curvescan.cli.main import run\n"
        "try: status = run(sys.argv[1:])\n"
        "except SystemExit as end: status = end.code\n"
        "assert not {'numba', 'matplotlib'} & set(sys.modules), 'heavy'\n"
        "sys.exit(status)"
    )
    done = subprocess.run([sys.executable, "-c", code, *command, "--help"], capture_output=True, text=True, timeout=600)
    assert done.returncode == 0, done.stderr
    assert "usage: curvescan" in done.stdout


def test_version(capsys):
    assert run(["--version"]) == 0
    assert capsys.readouterr().out == described() + "\n"


def test_the_methods_of_the_command_line_are_those_of_the_library():
    assert set(get_args(Method)) == set(MATCHERS)
    assert set(get_args(WorldName)) == set(WORLDS)
    assert set(get_args(SensorName)) == set(SENSORS)
    assert set(get_args(BenchmarkName)) == set(BENCHMARKS)


def test_ctrl_c_keeps_what_there_is(log, tmp_path, capsys, monkeypatch):
    add = Odometry.add

    def interrupted_at_five(self, scan, odometry_pose=None):
        step = add(self, scan, odometry_pose)
        if step.index == 5:
            signal.raise_signal(signal.SIGINT)
        return step

    monkeypatch.setattr(Odometry, "add", interrupted_at_five)
    out = tmp_path / "out"
    before = signal.signal(signal.SIGINT, signal.default_int_handler)  # jobs in the background
    try:
        assert run(["odometry", str(log), "--out", str(out)]) == 3
    finally:
        signal.signal(signal.SIGINT, before)
    told = capsys.readouterr().out
    assert "of 8 (partial)" in told
    assert "not to be trusted: the run was interrupted after" in told
    record = json.loads((out / "run.json").read_text())
    assert record["is_partial"] is True
    assert record["scans"] in (5, 6)
    assert len((out / "trajectory.tum").read_text().splitlines()) == record["scans"]
    assert not leftovers(tmp_path)


def test_ctrl_c_before_there_is_anything_leaves_nothing(log, tmp_path, capsys, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("curvescan.runs.run.save_run", interrupted)
    assert run(["odometry", str(log), "--out", str(tmp_path / "out")]) == 130
    assert "interrupted, nothing written" in capsys.readouterr().err
    assert not (tmp_path / "out").exists()
    assert not leftovers(tmp_path)


def test_the_module_runs_as_the_command_does():
    done = subprocess.run([sys.executable, "-m", "curvescan", "--version"], capture_output=True, text=True, timeout=600)
    assert done.stdout == described() + "\n"


@pytest.mark.slow
@pytest.mark.parametrize(("name", "n_scans"), [("malaga-sena-loop/malaga-sena-loop.clf.gz", 224)])
def test_a_real_log_runs_through(real_data: Path, tmp_path, name, n_scans):
    assert run(["odometry", str(real_data / name), "--out", str(tmp_path / "o")]) == 0
    assert np.loadtxt(tmp_path / "o" / "trajectory.tum").shape == (n_scans, 8)


def test_a_progress_bar_tells_all_steps_and_runs_no_thread_beside_the_work(monkeypatch):
    shown = Console(file=io.StringIO(), force_terminal=True, width=120)
    monkeypatch.setattr(console, "ERR", shown)
    before = set(threading.enumerate())  # threads of earlier tests may end meanwhile
    with console.progress_bar("work", 40) as advance:
        for _ in range(40):
            advance()
        assert set(threading.enumerate()) <= before
    assert "40/40" in shown.file.getvalue()


@pytest.mark.parametrize("name", ["esc\x1b[31mred.log", "bad\udcff.log", "a$b$x_{.log", "n" * 200 + ".log"])
def test_names_of_files_are_printed_plainly(log, tmp_path, capsys, name):
    strange = tmp_path / name
    log.rename(strange)
    for words in (["info"], ["odometry", "--out", f"{tmp_path}/{name[:-4]}"]):
        assert run([words[0], str(strange), *words[1:]]) == 0
    missing = tmp_path / f"no-{name}"
    assert run(["info", str(missing)]) == 1
    captured = capsys.readouterr()
    printed = captured.out + captured.err
    assert "\x1b" not in printed
    assert printed.isascii() or "\udcff" not in printed
    assert name[:3] in printed
    assert (tmp_path / name[:-4] / "map.png").stat().st_size > 1000


def test_what_could_not_be_read_is_told_by_the_run(log, tmp_path, capsys):
    log.write_text(log.read_text() + "FLASER 361 1.0 1.0")
    assert run(["odometry", str(log), "--out", str(tmp_path / "o")]) == 0
    assert "cut short" in " ".join(capsys.readouterr().err.split())


@pytest.mark.parametrize("is_threaded", [False, True])
def test_a_process_ends_with_its_clean_ups_done_and_its_threads_over(is_threaded: bool) -> None:
    thread = "threading.Thread(target=lambda: (time.sleep(0.5), print('thread over'))).start()"
    code = (
        "import atexit, sys, threading, time; from curvescan.cli.main import main; "
        "atexit.register(print, 'cleaned up');"
        f"{thread * is_threaded or 'pass'}; sys.argv = ['curvescan', 'info', 'missing.clf']; main()"
    )
    buffered = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    ended = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=False, env=buffered)
    assert ended.returncode == 1
    assert ended.stdout.split("\n") == [*["thread over"] * is_threaded, "cleaned up", ""]
