"""Ctrl-C and SIGTERM at any moment of a command: a sentence, an exit status, and never half a result."""

from __future__ import annotations

import json
import subprocess
import sys

import pytest

import curvescan as cs

pytestmark = pytest.mark.skipif(sys.platform == "win32", reason="no POSIX signals")

# a shell may have started the tests with Ctrl-C ignored
COMMAND = """
import importlib.abc, os, signal, sys

signal.signal(signal.SIGINT, signal.default_int_handler)
signal.signal(signal.SIGTERM, signal.SIG_DFL)
sys.argv[1:] = {words!r}
number = signal.{number}

def interrupt():
    print("arrives", flush=True)
    signal.raise_signal(number)

{prelude}
from curvescan.cli.main import main
{setting}
main()
"""

ON_IMPORT = """
class Interrupting(importlib.abc.MetaPathFinder):
    def find_spec(self, name, path, target=None):
        if name == "{name}":
            try:
                interrupt()
            except BaseException:
                raise ImportError("swallowed")

sys.meta_path.insert(0, Interrupting())
"""

PATCHED = """
import {module}
usual = {module}.{name}

def patched(*args, **kwargs):
    {before}
    result = usual(*args, **kwargs)
    {after}
    return result

{module}.{name} = patched
"""


@pytest.fixture(scope="module")
def log(tmp_path_factory):
    path = tmp_path_factory.mktemp("log") / "office.npz"
    cs.write_log(path, cs.simulate("office", n_scans=12, seed=2))
    return path


def run_interrupted(log, out, number="SIGINT", *, command="odometry", prelude="", setting=""):
    """Run a command that sends itself a signal at a place of its own, and return how it ended."""
    words = [command, str(log), "--out", str(out)]
    code = COMMAND.format(words=words, number=number, prelude=prelude, setting=setting)
    return subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=600, check=False)


def patched(module, name, *, is_after=False):
    lines = ["pass", "interrupt()"]
    return PATCHED.format(module=module, name=name, before=lines[not is_after], after=lines[is_after])


def files(folder):
    return {p.relative_to(folder): p.read_bytes() for p in folder.rglob("*") if p.is_file()}


STATUS = {"SIGINT": 130, "SIGTERM": 143}


@pytest.mark.parametrize(
    ("number", "name"), [("SIGINT", "tyro"), ("SIGTERM", "numpy"), ("SIGINT", "curvescan.cli.commands.slam")]
)
def test_while_the_command_is_imported(log, tmp_path, number, name):
    done = run_interrupted(log, tmp_path / "out", number, prelude=ON_IMPORT.format(name=name))
    assert done.stdout == "arrives\n"
    assert done.returncode == STATUS[number]
    assert done.stderr == "curvescan: interrupted, nothing written\n"
    assert not (tmp_path / "out").exists()


PLACES = {
    "reading": ("curvescan.io.arrays.npz", "open_npz"),
    "map": ("curvescan.runs.results", "build_maps"),
    "picture": ("curvescan.plots.map", "draw_map"),
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "place", "is_after"),
    [
        ("SIGTERM", "reading", True),
        ("SIGINT", "map", False),
        ("SIGINT", "picture", True),
        ("SIGTERM", "picture", False),
    ],
)
def test_before_the_results_are_whole_the_old_ones_stay(log, tmp_path, number, place, is_after):
    out = tmp_path / "deep" / "out"
    out.mkdir(parents=True)
    (out / "map.png").write_text("old")
    (out / "run.json").write_text('{"files": ["map.png", "run.json"]}')
    before = files(tmp_path)
    done = run_interrupted(log, out, number, setting=patched(*PLACES[place], is_after=is_after))
    assert done.stdout == "arrives\n"
    assert done.returncode == STATUS[number]
    assert done.stderr.splitlines()[-1] == "curvescan: interrupted, nothing written"
    assert "Traceback" not in done.stderr
    assert files(tmp_path) == before
    assert [p.name for p in tmp_path.rglob(".*")] == []


@pytest.mark.slow
@pytest.mark.parametrize("command", ["odometry", "slam"])
def test_while_the_results_are_moved_they_are_moved_whole(log, tmp_path, command):
    out = tmp_path / "out"
    out.mkdir()
    (out / "old.png").write_text("old")
    (out / "run.json").write_text('{"files": ["old.png", "run.json"]}')
    setting = patched("curvescan.io.files.output", "_results_before", is_after=True)
    done = run_interrupted(log, out, command=command, setting=setting)
    assert done.stdout == "arrives\n"
    assert done.returncode == 130
    sentence = done.stderr.splitlines()[-1]
    assert sentence == f"curvescan: interrupted; the results in {out} are written"
    assert "Traceback" not in done.stderr
    listed = json.loads((out / "run.json").read_text())["files"]
    assert sorted(str(path) for path in files(out)) == listed
    assert "old.png" not in listed
    assert [p.name for p in tmp_path.iterdir()] == ["out"]


@pytest.mark.slow
@pytest.mark.parametrize(("number", "command"), [("SIGINT", "odometry"), ("SIGTERM", "slam")])
def test_while_scans_are_matched_what_there_is_is_kept(log, tmp_path, number, command):
    out = tmp_path / "out"
    setting = """
from curvescan.odometry import Odometry
add = Odometry.add

def interrupted_at_five(self, scan, *rest, **names):
    if scan.stamp > 0.9:
        Odometry.add = add
        interrupt()
    return add(self, scan, *rest, **names)

from curvescan.runs import run
load_kernels = run.load_kernels
def then_patch(*args):
    load_kernels(*args)
    Odometry.add = interrupted_at_five
run.load_kernels = then_patch
"""
    done = run_interrupted(log, out, number, command=command, setting=setting)
    assert done.stdout.startswith("arrives\n")
    assert done.returncode in (0, 3)
    assert "Traceback" not in done.stderr
    record = json.loads((out / "run.json").read_text())
    assert record["is_partial"] is True
    assert 4 <= record["scans"] <= 7
    assert sorted(str(path) for path in files(out)) == record["files"]


def test_an_ignored_signal_stays_ignored(log, tmp_path):
    """As in a job that a shell started in the background."""
    prelude = "signal.signal(number, signal.SIG_IGN)\n" + ON_IMPORT.format(name="tyro")
    done = run_interrupted(log, tmp_path / "out", "SIGINT", command="info", prelude=prelude)
    assert done.stdout == "arrives\n"
    assert done.returncode == 2  # `info` knows no --out
    assert "interrupted" not in done.stderr
