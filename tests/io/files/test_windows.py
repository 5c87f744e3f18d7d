"""What Windows does otherwise, simulated here: a folder's rights and files that are held open."""

from __future__ import annotations

import os
import re
from pathlib import Path

import pytest

from curvescan.io.files import windows
from tests.conftest import ROOT


@pytest.fixture
def on_windows(monkeypatch):
    monkeypatch.setattr(windows, "IS_WINDOWS", True)


@pytest.mark.skipif(os.name != "posix", reason="rights are a mode on POSIX alone")
def test_a_temporary_folder_has_its_parents_rights_where_a_mode_cannot_give_them(tmp_path, on_windows):
    (tmp_path / "ordinary").mkdir()
    made = windows.make_temporary(".curvescan-", tmp_path)
    assert made.stat().st_mode == (tmp_path / "ordinary").stat().st_mode
    assert re.fullmatch(r"\.curvescan-[a-z0-9_]{8}", made.name)
    assert windows.make_temporary(".curvescan-", tmp_path) != made


def test_a_temporary_folder_is_its_owners_alone_elsewhere(tmp_path):
    assert windows.make_temporary(".curvescan-", tmp_path).stat().st_mode & 0o777 == 0o700


def held_open(monkeypatch, n_times):
    """Have a file refused to be replaced so many times."""
    usual, tries = Path.replace, []

    def replace(self, target):
        tries.append(target)
        if len(tries) <= n_times:
            raise PermissionError("in use by another process")
        return usual(self, target)

    monkeypatch.setattr(Path, "replace", replace)
    return tries


def test_a_file_that_is_held_open_for_a_moment_is_replaced(tmp_path, monkeypatch, on_windows):
    (tmp_path / "new").write_text("new")
    (tmp_path / "old").write_text("old")
    tries = held_open(monkeypatch, 3)
    windows.replace(tmp_path / "new", tmp_path / "old")
    assert (tmp_path / "old").read_text() == "new"
    assert len(tries) == 4


@pytest.mark.parametrize("is_windows", [True, False])
def test_a_file_that_stays_open_is_an_error(is_windows, tmp_path, monkeypatch):
    monkeypatch.setattr(windows, "IS_WINDOWS", is_windows)
    monkeypatch.setattr(windows, "_WAITS_S", (0.001,) * 5)
    (tmp_path / "new").write_text("new")
    tries = held_open(monkeypatch, 100)
    with pytest.raises(PermissionError):
        windows.replace(tmp_path / "new", tmp_path / "old")
    assert len(tries) == (6 if is_windows else 1)


def test_no_text_is_written_with_the_systems_line_ends():
    for path in sorted((ROOT / "src").rglob("*.py")):
        text = path.read_text("utf-8")
        for call in re.findall(r"\.write_text\((?:[^()]|\((?:[^()]|\([^()]*\))*\))*\)", text):
            assert 'newline="\\n"' in call, f"{path}: {call}"
