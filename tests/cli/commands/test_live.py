"""curvescan live, without and with its page; curvescan without arguments."""

import json
import re
import subprocess
import sys
import time
import urllib.request
from dataclasses import replace

import numpy as np
import pytest

from curvescan import read_log, simulate, write_log
from curvescan.cli.main import run
from curvescan.diagnostics.sensor import BeamOrder
from curvescan.simulation import SENSORS


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "room.npz"
    write_log(path, simulate("room", sensor="spinning-360", n_scans=40))
    return path


def test_without_arguments_three_commands_are_shown(capsys):
    assert run([]) == 0
    shown = capsys.readouterr().out
    assert [line.split()[1] for line in shown.splitlines() if line.startswith("  curvescan")] == [
        "live",
        "demo",
        "odometry",
    ]


@pytest.mark.slow
def test_a_replay_leaves_the_results_of_the_odometry(log, tmp_path, capsys):
    options = ["--speed", "0", "--no-page", "--odometry-only"]
    out, record = tmp_path / "out", tmp_path / "run.mcap"
    arguments = ["live", str(log), *options, "--out", str(out), "--record", str(record)]
    assert run(arguments) == 0
    assert "40 scans" in capsys.readouterr().out
    offline = tmp_path / "offline"
    assert run(["odometry", str(log), "--out", str(offline)]) in (0, 3)
    assert (out / "trajectory.tum").read_text() == (offline / "trajectory.tum").read_text()
    told = json.loads((out / "run.json").read_text())
    assert (told["scans"], told["live"]["dropped"], told["is_partial"]) == (40, 0, False)
    # the same files, the same maps
    names = {file.name for file in offline.iterdir()}
    assert {file.name for file in out.iterdir()} == names
    assert (out / "map.pgm").read_bytes() == (offline / "map.pgm").read_bytes()
    assert len(read_log(record)) == 40


@pytest.mark.slow
def test_a_replay_is_mended_and_ends_with_the_verdict_of_the_offline_run(tmp_path, capsys):
    # codes of 6 m in beams all around, and three scans in a row that saw nothing
    rng, scans = np.random.default_rng(1), []
    for k, scan in enumerate(simulate("office", sensor="spinning-360", n_scans=80, seed=1, odometry_noise=None)):
        is_code = rng.random(len(scan)) < 0.3
        ranges = np.where(is_code, 6.0, scan.ranges) if k not in (40, 41, 42) else np.zeros(len(scan))
        scans.append(replace(scan, ranges=ranges, range_max=20.0))
    path = tmp_path / "spoilt.npz"
    write_log(path, scans)
    last, records = {}, {}
    for name, options in (("live", ["--speed", "0", "--no-page", "--odometry-only"]), ("odometry", [])):
        assert run([name, str(path), *options, "--out", str(tmp_path / name)]) == 3
        told = capsys.readouterr()
        assert "ignored: readings at one range in all directions" in told.err
        last[name] = told.out.splitlines()[-1]
        records[name] = json.loads((tmp_path / name / "run.json").read_text())
    assert last["live"] == last["odometry"]
    assert last["live"].startswith("not to be trusted: 3 of 79 scans are not matched")
    assert records["live"]["verdict"] == records["odometry"]["verdict"]
    assert records["live"]["mended"] == records["odometry"]["mended"] != []
    # without a folder too, and as it is
    assert run(["live", str(path), *["--speed", "0", "--no-page", "--odometry-only", "--as-is"]]) == 3
    told = capsys.readouterr()
    assert "ignored" not in told.err
    assert told.out.splitlines()[-1].startswith("not to be trusted")


@pytest.mark.slow
def test_beams_in_reverse_are_not_deskewed_as_offline(log, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(
        "curvescan.diagnostics.sensor.beam_order_of_log",
        lambda log: BeamOrder(n_pairs=9, gain=-1.0, standard_error=0.1),
    )
    timed = tmp_path / "timed.npz"
    sensor = replace(SENSORS["spinning-360"], time_increment=0.1 / 360)
    write_log(timed, simulate("room", sensor=sensor, n_scans=30))
    tracks = {}
    for name in ("odometry", "slam"):
        live, offline = tmp_path / f"live-{name}", tmp_path / name
        options = ["--speed", "0", "--no-page", *(["--odometry-only"] * (name == "odometry"))]
        assert run(["live", str(timed), *options, "--out", str(live)]) == 0
        told = " ".join(capsys.readouterr().err.split())
        assert "sweeps are not deskewed: their beams are listed in reverse" in told
        assert run([name, str(timed), "--out", str(offline)]) in (0, 3)
        tracks[name] = (live / "trajectory.tum").read_text()
        assert tracks[name] == (offline / "trajectory.tum").read_text()
    monkeypatch.undo()
    out = tmp_path / "deskewed"
    assert run(["live", str(timed), *options, "--odometry-only", "--out", str(out)]) == 0
    assert (out / "trajectory.tum").read_text() != tracks["odometry"]


@pytest.mark.slow
def test_a_robot_finds_itself_in_the_map_of_slam(tmp_path, capsys):
    log = tmp_path / "office.npz"
    write_log(log, simulate("office", sensor="spinning-360", n_scans=80, seed=3))
    assert run(["slam", str(log), "--out", str(tmp_path / "slam")]) in (0, 3)
    out = tmp_path / "live"
    options = ["--speed", "0", "--no-page", "--out", str(out)]
    assert run(["live", str(log), "--map", str(tmp_path / "slam" / "map.csmap"), *options]) == 0
    assert "Followed in the map" in capsys.readouterr().out
    told = json.loads((out / "run.json").read_text())
    assert told["live"]["mode"] == "localization"
    poses = [np.loadtxt(p / "trajectory.tum")[:, 1:3] for p in (out, tmp_path / "slam")]
    known = np.isfinite(poses[0]).all(axis=1)
    assert known[-40:].all()
    assert np.hypot(*(poses[0] - poses[1])[known].T).max() < 0.1


@pytest.mark.slow
def test_the_simulated_robot(tmp_path, capsys):
    assert run(["live", "--speed", "0", "--scans", "10", "--no-page", "--odometry-only"]) == 0
    assert "simulated office-floor" in capsys.readouterr().out


@pytest.mark.slow
def test_the_page_of_a_run_and_its_end(log):
    command = [sys.executable, "-m", "curvescan", "live", str(log), "--http-port", "0"]
    with subprocess.Popen([*command, "--speed", "4", "--keep-open"], stderr=subprocess.PIPE, text=True) as process:
        try:
            url = re.search(r"http://[\d.:]+/", process.stderr.readline()).group()
            with urllib.request.urlopen(url, timeout=10) as answer:
                assert b"curvescan" in answer.read()
            deadline, seen = time.monotonic() + 400.0, b""  # it may have to compile first
            with urllib.request.urlopen(url + "events", timeout=60) as events:
                while b'"kind":"ended"' not in seen and time.monotonic() < deadline:
                    seen += events.readline()
            assert b"event: map" in seen
            assert b"event: scan" in seen
            assert b"has ended after 40 scans" in seen
            while "Ctrl-C closes the page" not in (line := process.stderr.readline()):
                assert line  # it has not ended
        finally:
            process.terminate()  # as a service manager does: like Ctrl-C
        assert process.wait(20) == 0


@pytest.mark.slow
def test_sigterm_ends_a_run_with_a_line_and_its_results(log, tmp_path):
    out = tmp_path / "out"
    command = [sys.executable, "-m", "curvescan", "live", str(log), "--http-port", "0", "--speed", "0.05"]
    with subprocess.Popen([*command, "--out", str(out)], stderr=subprocess.PIPE, text=True) as process:
        url = re.search(r"http://[\d.:]+/", process.stderr.readline()).group()
        deadline, seen = time.monotonic() + 400.0, b""  # it may have to compile first
        with urllib.request.urlopen(url + "events", timeout=400) as events:
            while b"event: scan" not in seen and time.monotonic() < deadline:
                seen += events.readline()
        process.terminate()
        said = process.communicate(timeout=60)[1]
    assert "stopped; finishing Slam(" in said
    assert process.returncode in (0, 3)
    assert 1 <= len((out / "trajectory.tum").read_text().splitlines()) < 40
    assert json.loads((out / "run.json").read_text())["is_partial"]


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--driver", "lds2d:LDROBOT-LD19"], "needs --port"),
        (["--driver", "nothing", "--port", "/dev/null"], "there is no driver"),
        (["LOG", "--driver", "rplidar", "--port", "/dev/null"], "exclude each other"),
        (
            ["--driver", "rplidar", "--port", "/dev/null", "--clockwise", "--drop-stale", "--upright", "--topic", "/a"],
            "a laser at a port has no use for --topic, --upright, --drop-stale: give",
        ),
        (["--driver", "rplidar", "--port", "/dev/null", "--odometry-prior"], "no use for --odometry-prior: give"),
        (["--driver", "rplidar", "--port", "/dev/null", "--rig"], "a laser at a port has no use for --rig: give"),
        (["--driver", "rplidar", "--port", "/dev/null", "--ignore-beams", "-1", "0"], "whole numbers >= 0"),
        (["--clockwise", "--range-max", "3"], "the simulated robot has no use for --range-max, --clockwise: give"),
        (["LOG", "--map", "m.csmap", "--odometry-only"], "exclude each other"),
        (["no-such-file.clf"], "no-such-file.clf"),
        (["LOG", "--speed", "-1"], "speed must be >= 0"),
        (["LOG", "--host", "192.0.2.1"], "cannot serve the page"),
    ],
)
def test_what_cannot_be_is_one_sentence(log, arguments, sentence, capsys):
    given = [str(log) if a == "LOG" else a for a in arguments]
    assert run(["live", *given]) == 1
    told = capsys.readouterr().err.splitlines()[-1]
    assert told.startswith("curvescan: ")
    assert sentence in told
