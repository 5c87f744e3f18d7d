"""The version says which commit it was made of: a tree reads its .git, a wheel what the build wrote."""

from __future__ import annotations

import runpy
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from curvescan import _version
from tests.conftest import ROOT

COMMIT, OTHER = "0123456789abcdef" * 2 + "01234567", "fedcba98" * 5


@pytest.fixture
def package(tmp_path):
    """A package in a tree, without a repository yet."""
    folder = tmp_path / "tree" / "src" / "curvescan"
    folder.mkdir(parents=True)
    (folder / "_version.py").write_text(Path(_version.__file__).read_text("utf-8"), "utf-8")
    return folder


def told(package):
    return runpy.run_path(str(package / "_version.py"))["commit"]()


def write(path, text):
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text, "utf-8")


@pytest.mark.parametrize(
    "files",
    [
        {"HEAD": COMMIT},
        {"HEAD": "ref: refs/heads/a/b\n", "refs/heads/a/b": COMMIT + "\n"},
        {"HEAD": "ref: refs/heads/a\n", "packed-refs": f"# pack-refs\n{OTHER} refs/heads/a-b\n{COMMIT} refs/heads/a\n"},
    ],
    ids=["detached", "branch", "packed"],
)
def test_a_tree_tells_the_commit_it_is_at(package, files):
    for name, text in files.items():
        write(package.parent.parent / ".git" / name, text)
    assert told(package) == COMMIT


def test_a_worktree_tells_its_own(package, tmp_path):
    git = tmp_path / "main" / ".git"
    write(package.parent.parent / ".git", f"gitdir: {git / 'worktrees' / 'one'}\n")
    write(git / "worktrees" / "one" / "HEAD", "ref: refs/heads/one\n")
    write(git / "worktrees" / "one" / "commondir", "../..\n")
    write(git / "refs" / "heads" / "one", COMMIT)
    write(git / "HEAD", OTHER)
    assert told(package) == COMMIT


@pytest.mark.parametrize("head", ["", "ref: refs/heads/gone\n", "no commit", "a" * 39])
def test_where_nothing_says_it_there_is_none(package, head):
    write(package.parent.parent / ".git" / "HEAD", head)
    assert told(package) is None


def test_an_installed_package_tells_what_was_built_and_not_whose_repository_it_lies_in(package, tmp_path):
    installed = tmp_path / "site-packages" / "curvescan"
    package.parent.rename(installed.parent)
    write(tmp_path / ".git" / "HEAD", OTHER)
    write(installed.parent / ".git" / "HEAD", OTHER)
    assert told(installed) is None
    write(installed / "_commit.txt", COMMIT + "\n")
    assert told(installed) == COMMIT


def test_the_version_stands_first_and_the_commit_short(monkeypatch):
    monkeypatch.setattr(_version, "commit", lambda: COMMIT)
    assert _version.described() == f"curvescan {_version.__version__} (commit 0123456789ab)"
    monkeypatch.setattr(_version, "commit", lambda: None)
    assert _version.described() == f"curvescan {_version.__version__}"


@pytest.mark.parametrize("way", ["tree", "variable"])
def test_a_wheel_carries_the_commit_that_it_was_built_from_and_the_machine_code_that_it_is_given(
    way, tmp_path, monkeypatch
):
    pytest.importorskip("hatchling.build")
    pytest.importorskip("hatch_fancy_pypi_readme")
    if way == "variable":
        monkeypatch.setenv("CURVESCAN_COMMIT", COMMIT)
        monkeypatch.setenv("CURVESCAN_KERNELS", str(tmp_path / "kernels"))
        write(tmp_path / "kernels" / "curvescan-kernels-0" / "a.nbc", "code")
    elif _version.commit() is None:
        pytest.skip("the sources are no repository")
    code = f"from hatchling.build import build_wheel; print(build_wheel({str(tmp_path)!r}))"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True, timeout=300)
    [wheel] = tmp_path.glob("*.whl")
    with zipfile.ZipFile(wheel) as archive:
        found = archive.read("curvescan/_commit.txt").decode().strip()
        assert "curvescan/__init__.pyi" in archive.namelist()
        brought = [name for name in archive.namelist() if name.startswith("curvescan/_kernels/")]
    assert found == (COMMIT if way == "variable" else _version.commit())
    assert brought == (["curvescan/_kernels/curvescan-kernels-0/a.nbc"] if way == "variable" else [])
    assert not (ROOT / "src" / "curvescan" / "_commit.txt").exists()
