"""What README and documentation show runs as it stands, and what they link to exists."""

from __future__ import annotations

import importlib
import json
import os
import re
import shlex
from pathlib import Path

import pytest

import curvescan as cs
from curvescan.cli.command_line import COMMANDS
from curvescan.cli.main import run as command
from curvescan.evaluation.relations import BENCHMARKS
from tests.conftest import ROOT

DOCS = ROOT / "docs"
GENERATED = ("_build", "gallery", "reference/generated", "reference/commands")
# pages that the build writes, as links name them
BUILT = {DOCS / "reference/commands.md", DOCS / "gallery/index.rst"} | {
    DOCS / "gallery" / f"{script.stem}.rst" for script in (ROOT / "examples/gallery").glob("plot_*.py")
}


def _documents() -> list[Path]:
    return [ROOT / "README.md"] + [
        path for path in sorted(DOCS.rglob("*.md")) if not path.relative_to(DOCS).as_posix().startswith(GENERATED)
    ]


def _name(path: Path) -> str:
    return path.relative_to(ROOT).as_posix()


def _blocks(path: Path) -> str:
    """Return the Python blocks of a document, later ones go on from earlier ones; lines keep their numbers."""
    lines, fence = [], ""
    for line in path.read_text(encoding="utf-8").splitlines():
        if line.startswith("```"):
            lines.append("")
            fence = "" if fence else line
        else:
            lines.append(line if fence == "```python" else "")
    return "\n".join(lines)


WITH_PYTHON = [path for path in _documents() if "```python" in path.read_text(encoding="utf-8")]


@pytest.fixture(scope="module")
def logs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with simulated logs under the names that the documents use."""
    folder = tmp_path_factory.mktemp("logs")
    log = cs.simulate("office", n_scans=25, seed=1)
    for name in ("intel.clf", "robot.bag", "drive.mcap"):
        cs.write_log(folder / name, log)
    return folder


def test_documents_show_python():
    assert len(WITH_PYTHON) >= 8


@pytest.mark.slow
@pytest.mark.parametrize("path", WITH_PYTHON, ids=_name)
def test_the_python_of_a_document_runs(path, logs, tmp_path, monkeypatch, capsys):
    for log in logs.iterdir():
        (tmp_path / log.name).symlink_to(log)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(cs.datasets, "fetch", lambda name: tmp_path / f"{name}.clf")
    exec(compile(_blocks(path), _name(path), "exec"), {"__name__": "__main__"})  # noqa: S102


def _commands(path: Path) -> list[list[str]]:
    """Return the words of each curvescan command in a document's blocks and sentences."""
    text = path.read_text(encoding="utf-8").replace("\\\n", " ")
    inline = re.findall(r"`(curvescan [a-z][^`\n]*)`", text)
    lines = [line for line in text.splitlines() if line.startswith("curvescan ")] + inline
    return [shlex.split(line, comments=True) for line in lines]


def test_the_commands_of_the_documents_are_there_with_their_flags(capsys):
    shown = [words for path in _documents() for words in _commands(path)]
    assert len(shown) > 60
    wanted: dict[str, set[str]] = {}
    for _, name, *rest in shown:
        if name not in COMMANDS:
            continue  # a sentence that begins with the project's name
        flags = {word.partition("=")[0] for word in rest if word.startswith("--")}
        wanted[name] = wanted.get(name, set()) | flags
    for name, flags in wanted.items():
        with pytest.raises(SystemExit, match=r"^0$"):
            command([name, "--help-all"])
        known = set(re.findall(r"--[\w.-]+", capsys.readouterr().out))
        assert flags <= known, f"curvescan {name}"


@pytest.mark.parametrize("path", _documents(), ids=_name)
def test_what_a_document_links_to_is_there(path):
    text = re.sub(r"```.*?```", "", path.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in re.findall(r"\]\((?!https?:|#)([^)#]+)", text):
        there = Path(os.path.normpath(path.parent / target))
        assert there.exists() or there in BUILT, f"links to {target}"
        # the site holds the documentation alone
        is_page = DOCS in path.parents and there.suffix in (".md", ".rst")
        assert not is_page or DOCS in there.parents, f"{target} is no page of the site"


def test_every_page_is_in_a_table_of_contents():
    named = {DOCS / "index.md", DOCS / "calibration/calibration.md", DOCS / "calibration/sweep.md"}
    for path in _documents():
        for tree in re.findall(r"```{toctree}\n(.*?)```", path.read_text(encoding="utf-8"), re.S):
            for entry in re.findall(r"^(?!:)(\S+)$", tree, re.M):
                named.add(Path(os.path.normpath(path.parent / f"{entry}.md")))
    missing = [_name(path) for path in _documents()[1:] if path not in named]
    assert not missing


def test_the_reference_lists_every_public_name():
    text = (DOCS / "reference/api.rst").read_text(encoding="utf-8")
    listed = set(re.findall(r"^   ([A-Za-z_]\w*)$", text, re.M))
    # constants and modules are described in sentences, not on pages of their own
    described = {name for name in ("MATCHERS", "datasets", "plot", "se2") if re.search(rf"\b{name}``", text)}
    assert set(cs.__all__) - {"__version__"} <= listed | described


def test_the_reference_lists_what_the_guide_imports_and_names():
    text = (DOCS / "reference/api.rst").read_text(encoding="utf-8")
    listed, module = set(), ""
    for line in text.splitlines():
        if found := re.match(r"\.\. currentmodule:: (\S+)$", line):
            module = found[1]
        elif found := re.match(r"   ([A-Za-z_]\w*)$", line):
            listed.add(found[1])
            assert hasattr(importlib.import_module(module), found[1]), f"{module} has no {found[1]}"
    for path in _documents():
        named = re.findall(r"`(curvescan\.[\w.]+)\.(\w+)[(`]", path.read_text(encoding="utf-8"))
        for module, imported in re.findall(r"^from (curvescan[\w.]*) import (.*)$", _blocks(path), re.M):
            named += [(module, name) for name in imported.split(", ")]
        if "design-notes" not in path.parts:
            things = [name for module, name in named if callable(getattr(importlib.import_module(module), name, None))]
            assert set(things) <= listed, _name(path)


def _figures_of_the_comparison() -> set[float]:
    """Return every error in bench/comparison.jsonl and every published one, metres and degrees."""
    text = (ROOT / "bench/comparison.jsonl").read_text(encoding="utf-8")
    rows = [json.loads(line) for line in text.splitlines()]
    assert {(row["log"], row["task"]) for row in rows} >= {("intel", "slam"), ("aces", "slam")}
    pairs = [row[name] for row in rows for name in row if name.endswith(("translation", "rotation"))]
    for log in BENCHMARKS.values():
        for error in log.errors:
            pairs += [error.translation, error.rotation or ()]
    return {figure for pair in pairs for figure in pair if figure is not None}


def test_the_errors_in_the_readme_are_those_of_the_comparison():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (?:\*\*curvescan\*\*|Cartographer|RBPF|graph mapping|Karto).*$", readme, re.M)
    assert len(rows) >= 4
    known = _figures_of_the_comparison()
    for figure in re.findall(r"\b\d\.\d+\b", "\n".join(rows)):
        n_digits = len(figure.partition(".")[2])
        assert any(f"{one:.{n_digits}f}" == figure for one in known), f"{figure} is measured nowhere"
