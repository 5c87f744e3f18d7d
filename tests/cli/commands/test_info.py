"""curvescan convert as a user runs it."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
import pytest

from curvescan.cli.main import run
from curvescan.io import read_log, write_log
from tests.logs import assert_same_scans, rich_log


def test_there_and_back_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(tmp_path / "a.npz", rich_log())
    names = ["a.npz", "b.bag", "c", "d.mcap", "e.csv.gz"]
    for source, target in itertools.pairwise(names):
        assert run(["convert", str(tmp_path / source), str(tmp_path / target)]) == 0
        assert f"{target}: 12 scans of {source}" in capsys.readouterr().out
    assert_same_scans(rich_log(), read_log(tmp_path / "e.csv.gz"))


def test_what_is_lost_or_skipped_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "a.csv"
    source.write_text("stamp,angle_min,angle_increment,ranges\n1,0,0.1,1\n2,0,0,1\n")
    assert run(["convert", str(source), str(tmp_path / "a.bag")]) == 0
    told = " ".join(capsys.readouterr().err.split())
    assert "not read: angle_increment must not be 0: give the angle from a beam to the next" in told
    assert "(1 times, first in line 3)" in told
    assert "not kept: digits beyond float32" in told


def test_format_and_limits(tmp_path: Path) -> None:
    write_log(tmp_path / "a.npz", rich_log())
    command = ["convert", str(tmp_path / "a.npz"), str(tmp_path / "b.x"), "--format", "csv"]
    assert run([*command, "--range-max", "3", "--ignore-beams", "2", "0"]) == 0
    log = read_log(tmp_path / "b.x")
    assert {scan.range_max for scan in log} == {3.0}
    assert all(np.isnan(scan.ranges[:2]).all() for scan in log)


def test_refusals(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_log(tmp_path / "a.npz", rich_log())
    for target in ("a.npz", "a.xyz"):
        assert run(["convert", str(tmp_path / "a.npz"), str(tmp_path / target)]) == 1
        assert capsys.readouterr().err.splitlines()[-1].startswith("curvescan: ")
    assert [path.name for path in tmp_path.iterdir()] == ["a.npz"]
