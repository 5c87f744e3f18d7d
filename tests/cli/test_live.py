"""curvescan live, without and with its page; curvescan without arguments."""

import json
import re
import subprocess
import sys
import time
import urllib.request

import pytest

from curvescan import read_log, simulate, write_log
from curvescan.cli.main import run


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
    assert (told["scans"], told["dropped"], told["is_partial"]) == (40, 0, False)
    assert len(read_log(record)) == 40


def test_the_simulated_robot(tmp_path, capsys):
    assert run(["live", "--speed", "0", "--scans", "10", "--no-page", "--odometry-only"]) == 0
    assert "simulated office-floor" in capsys.readouterr().out


@pytest.mark.slow
def test_the_page_of_a_run_and_its_end(log):
    command = [sys.executable, "-m", "curvescan", "live", str(log), "--http-port", "0"]
    with subprocess.Popen(
        [*command, "--speed", "4", "--keep-open"], stderr=subprocess.PIPE, text=True
    ) as process:
        try:
            url = re.search(r"http://[\d.:]+/", process.stderr.readline()).group()
            with urllib.request.urlopen(url, timeout=10) as answer:
                assert b"curvescan" in answer.read()
            deadline, seen = time.monotonic() + 120.0, b""
            with urllib.request.urlopen(url + "events", timeout=60) as events:
                while b'"kind":"ended"' not in seen and time.monotonic() < deadline:
                    seen += events.readline()
            assert b"event: map" in seen
            assert b"event: scan" in seen
            assert b"has ended after 40 scans" in seen
        finally:
            process.terminate()  # as a service manager does: like Ctrl-C
        assert process.wait(20) == 0


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--driver", "lds2d:LDROBOT-LD19"], "needs --port"),
        (["--driver", "nothing", "--port", "/dev/null"], "there is no driver"),
        (["LOG", "--driver", "rplidar", "--port", "/dev/null"], "exclude each other"),
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
