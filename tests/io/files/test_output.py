"""output_folder: all results or none, and a bad place is refused before the work."""

from __future__ import annotations

import json
import os
import re
import shutil
import signal
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from curvescan.errors import OutputError
from curvescan.io import output_folder
from curvescan.io.files import output
from curvescan.io.files.output import HIDDEN_PREFIX, hidden_folder, output_file
from tests.conftest import ROOT


def tree(folder: Path) -> dict[str, str | None]:
    """Return every path below a folder with the text of the files."""
    return {
        str(path.relative_to(folder)): path.read_text() if path.is_file() else None
        for path in sorted(folder.rglob("*"))
    }


def test_results_are_moved_when_the_block_ends(tmp_path: Path) -> None:
    target = tmp_path / "out"
    with output_folder(target) as folder:
        (folder / "a.txt").write_text("1")
        (folder / "sub").mkdir()
        (folder / "sub" / "b.txt").write_text("2")
        assert not target.exists()
        assert folder.parent == tmp_path
        assert folder.name.startswith(".")
    assert tree(tmp_path) == {"out": None, "out/a.txt": "1", "out/sub": None, "out/sub/b.txt": "2"}


def test_parents_are_made(tmp_path: Path) -> None:
    with output_folder(tmp_path / "x" / "y" / "out") as folder:
        (folder / "a").write_text("1")
    assert (tmp_path / "x" / "y" / "out" / "a").read_text() == "1"


def test_target_has_ordinary_access_rights(tmp_path: Path) -> None:
    (tmp_path / "plain").mkdir()
    with output_folder(tmp_path / "out"):
        pass
    # a temporary folder is private; the results are not meant to be
    assert (tmp_path / "out").stat().st_mode == (tmp_path / "plain").stat().st_mode


def test_existing_files_are_replaced_and_others_stay(tmp_path: Path) -> None:
    target = tmp_path / "out"
    target.mkdir()
    (target / "a").write_text("old")
    (target / "other").write_text("kept")
    with output_folder(target) as folder:
        (folder / "a").write_text("new")
        seen = {name: text for name, text in tree(target).items() if not name.startswith(HIDDEN_PREFIX)}
        assert seen == {"a": "old", "other": "kept"}
    assert tree(tmp_path) == {"out": None, "out/a": "new", "out/other": "kept"}


@pytest.mark.parametrize("error", [ValueError, KeyboardInterrupt, SystemExit])
@pytest.mark.parametrize("is_there", [False, True])
def test_after_an_error_all_is_as_before(tmp_path: Path, error: type[BaseException], is_there: bool) -> None:
    target = tmp_path / "x" / "out"
    if is_there:
        target.mkdir(parents=True)
        (target / "a").write_text("old")
    before = tree(tmp_path)

    def work() -> None:
        with output_folder(target) as folder:
            (folder / "a").write_text("new")
            raise error

    with pytest.raises(error):
        work()
    assert tree(tmp_path) == before


def test_parents_that_others_use_meanwhile_stay(tmp_path: Path) -> None:
    def work() -> None:
        with output_folder(tmp_path / "x" / "y" / "out"):
            (tmp_path / "x" / "theirs").write_text("1")
            raise ValueError

    with pytest.raises(ValueError):  # noqa: PT011
        work()
    assert tree(tmp_path) == {"x": None, "x/theirs": "1"}


def refused(path: Path | str, sentence: str) -> None:
    """Check that a place is refused before the block runs."""
    n_runs = 0
    with pytest.raises(OutputError, match=sentence), output_folder(path):
        n_runs += 1
    assert n_runs == 0


def test_target_that_is_a_file(tmp_path: Path) -> None:
    (tmp_path / "out").write_text("mine")
    refused(tmp_path / "out", "is a file: results need a folder")
    assert tree(tmp_path) == {"out": "mine"}


def test_target_below_a_file(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("mine")
    refused(tmp_path / "file" / "out", "cannot write results to .*; choose another folder")
    refused(tmp_path / "file" / "x" / "out", "cannot write results to .*; choose another folder")
    assert tree(tmp_path) == {"file": "mine"}


def test_path_that_cannot_exist(tmp_path: Path) -> None:
    refused(f"{tmp_path}/a\0b", "cannot write results")
    refused(tmp_path / ("n" * 300) / "out", "cannot write results")
    assert tree(tmp_path) == {}


@pytest.mark.skipif(not Path("/proc/self").exists(), reason="no /proc on this system")
def test_place_that_no_user_can_write() -> None:
    refused("/proc/out", "cannot write results to '/proc/out'")
    refused("/proc/self", "cannot write results to '/proc/self'")


def refuse_to_make_in(parent: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Have no folder made in another: the tests may run as root, whom no access right stops."""
    mkdir = Path.mkdir

    def refuse(path: Path, **options: bool) -> None:
        if path.parent == parent and not path.exists():
            raise PermissionError(13, "Permission denied")
        mkdir(path, **options)

    monkeypatch.setattr(Path, "mkdir", refuse)


def test_existing_target_without_permission(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "out"
    target.mkdir()
    refuse_to_make_in(target, monkeypatch)
    refused(target, "Permission denied; choose another folder")
    assert tree(tmp_path) == {"out": None}


def test_target_whose_parent_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "out"
    target.mkdir()
    refuse_to_make_in(tmp_path, monkeypatch)
    with output_folder(target) as folder:
        assert folder.parent == target
        (folder / "a").write_text("1")
    assert tree(tmp_path) == {"out": None, "out/a": "1"}


def test_parents_made_before_one_fails_are_removed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    mkdir = Path.mkdir

    def refuse_second(path: Path) -> None:
        if path.name == "second":
            raise PermissionError(13, "Permission denied")
        mkdir(path)

    monkeypatch.setattr(Path, "mkdir", refuse_second)
    refused(tmp_path / "first" / "second" / "out", "Permission denied")
    assert tree(tmp_path) == {}


def test_target_that_is_a_link_to_a_folder(tmp_path: Path) -> None:
    (tmp_path / "real").mkdir()
    (tmp_path / "link").symlink_to(tmp_path / "real")
    with output_folder(tmp_path / "link") as folder:
        (folder / "a").write_text("1")
    assert (tmp_path / "link").is_symlink()
    assert tree(tmp_path / "real") == {"a": "1"}


@pytest.mark.skipif(not os.path.ismount("/dev/shm"), reason="no second file system at hand")
def test_target_that_is_a_mount_point() -> None:
    target = Path("/dev/shm")
    name = f"curvescan-test-{os.getpid()}"
    try:
        with output_folder(target) as folder:
            # beside it is another file system, from which nothing can be moved in one step
            assert folder.parent == target
            (folder / name).write_text("1")
        assert (target / name).read_text() == "1"
        assert not folder.exists()
    finally:
        (target / name).unlink(missing_ok=True)


def test_new_target_is_not_there_when_the_move_fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(path: Path, goal: Path) -> None:
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "replace", refuse)

    def work() -> None:
        with output_folder(tmp_path / "x" / "out") as folder:
            (folder / "a").write_text("1")

    with pytest.raises(OutputError, match="No space left on device"):
        work()
    assert tree(tmp_path) == {}


def write_run(target: Path, number: int, *names: str, inputs: tuple[Path, ...] = ()) -> None:
    """Write a run's results: its number in every file, and a record that lists them."""
    with output_folder(target, inputs=inputs) as folder:
        for name in names:
            (folder / name).parent.mkdir(exist_ok=True)
            (folder / name).write_text(f"{number}")
        record = {"number": number, "files": [*names, "run.json"]}
        (folder / "run.json").write_text(json.dumps(record))


def runs_in(target: Path) -> set[int]:
    """Return the numbers of the runs whose files are in a folder, as anybody sees it."""
    numbers = set()
    for path in target.rglob("*"):
        if path.is_file() and path.name != "notes" and HIDDEN_PREFIX not in str(path):
            content = json.loads(path.read_text())
            numbers.add(content["number"] if isinstance(content, dict) else content)
    return numbers


@pytest.mark.parametrize("has_notes", [False, True])
def test_a_folder_never_holds_files_of_two_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, has_notes: bool
) -> None:
    target, seen = tmp_path / "out", []
    write_run(target, 1, "a", "b", "sub/c", "old/d")
    if has_notes:
        (target / "notes").write_text("mine")
    replace = Path.replace

    def watch(path: Path, goal: Path) -> None:
        replace(path, goal)
        seen.append((runs_in(target), (target / "run.json").exists()))

    monkeypatch.setattr(Path, "replace", watch)
    write_run(target, 2, "a", "b", "sub/c", "new/e")
    assert len(seen) == 10
    assert all(len(runs) <= 1 for runs, _ in seen)
    # a folder without a record is not complete
    assert [has_record for _, has_record in seen] == [*[False] * 9, True]
    names = ["a", "b", "new", "new/e", *["notes"] * has_notes, "run.json", "sub", "sub/c"]
    assert [*tree(target)] == names


def test_a_move_that_fails_is_undone(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    target = tmp_path / "out"
    write_run(target, 1, "a", "b", "sub/c")
    (target / "notes").write_text("mine")
    before, replace = tree(tmp_path), Path.replace
    for n_moves in range(1, 9):
        failing = iter([False] * (n_moves - 1) + [True])

        def fail(path: Path, goal: Path, failing: Iterator[bool] = failing) -> None:
            if next(failing, False):
                raise OSError(28, "No space left on device")
            replace(path, goal)

        monkeypatch.setattr(Path, "replace", fail)
        with pytest.raises(OutputError, match="No space left on device; make room, or"):
            write_run(target, 2, "a", "b", "sub/d")
        assert tree(tmp_path) == before


def test_what_the_results_are_made_from_stays(tmp_path: Path) -> None:
    target = tmp_path / "out"
    write_run(target, 1, "map", "log", "other")
    write_run(target, 2, "a", inputs=(target / "map", target / "log"))
    assert [*tree(target)] == ["a", "log", "map", "run.json"]


def test_what_is_no_run_replaces_none(tmp_path: Path) -> None:
    target = tmp_path / "out"
    write_run(target, 1, "a", "b")
    with output_folder(target) as folder:
        (folder / "evaluation").write_text("2")
    assert [*tree(target)] == ["a", "b", "evaluation", "run.json"]


def test_a_record_names_no_file_outside_its_folder(tmp_path: Path) -> None:
    for name in ("mine", "out-mine"):
        (tmp_path / name).write_text("mine")
    target = tmp_path / "out"
    write_run(target, 1, "a")
    files = ["../mine", str(tmp_path / "out-mine"), "a\0b", 7, "missing", ""]
    (target / "run.json").write_text(json.dumps({"files": files}))
    write_run(target, 2, "b")
    assert {*tree(tmp_path)} == {"mine", "out", "out-mine", "out/a", "out/b", "out/run.json"}


def test_a_process_killed_in_the_middle_of_the_move_loses_nothing(tmp_path: Path) -> None:
    fork = getattr(os, "fork", None)
    if fork is None:
        pytest.skip("no fork on this system")
    for n_moves in range(1, 9):
        target = tmp_path / f"out-{n_moves}"
        write_run(target, 1, "a", "b", "sub/c")
        child = fork()
        if child == 0:
            done = []

            def kill(path: Path, goal: Path, replace: Callable[[Path, Path], object] = Path.replace) -> None:
                replace(path, goal)
                done.append(goal)  # noqa: B023
                if len(done) == n_moves:  # noqa: B023
                    os.kill(os.getpid(), signal.SIGKILL)

            Path.replace = kill  # type: ignore[assignment, method-assign]
            write_run(target, 2, "a", "b", "sub/d")
            os._exit(0)
        assert os.waitpid(child, 0)[1] == signal.SIGKILL
        assert len(runs_in(target)) <= 1
        before = [path for path in target.rglob("*") if path.is_file()]
        assert len(before) == 8  # four of each run
        with output_folder(target) as folder:
            (folder / "next").write_text("3")
        assert {*before} < {*target.rglob("*")}


def test_the_folder_that_the_shell_is_in_stays_that_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_run(tmp_path / "out", 1, "a")
    monkeypatch.chdir(tmp_path / "out")
    before = Path().stat().st_ino
    write_run(Path(), 2, "a")
    assert (Path().stat().st_ino, runs_in(tmp_path / "out")) == (before, {2})


def test_folders_of_killed_processes_are_swept_and_no_others(tmp_path: Path) -> None:
    pytest.importorskip("fcntl", reason="no locks on folders")
    killed, other = tmp_path / f"{HIDDEN_PREFIX}abcdefgh", tmp_path / f"{HIDDEN_PREFIX}notes"
    for folder in (killed, other):
        folder.mkdir()
        (folder / "a").write_text("half")
    with output_folder(tmp_path / "out") as first:
        (first / "a").write_text("1")
        with output_folder(tmp_path / "out") as second:
            (second / "b").write_text("2")
        assert first.exists()
    assert [*tree(tmp_path)] == [f"{HIDDEN_PREFIX}notes", f"{HIDDEN_PREFIX}notes/a", "out", "out/a", "out/b"]


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), OSError("4 of 8 written")])
def test_a_disk_that_fills_in_the_middle_is_one_sentence(tmp_path: Path, error: OSError) -> None:
    def work() -> None:
        with output_folder(tmp_path / "x" / "out") as folder:
            (folder / "a").write_text("1")
            raise error

    with pytest.raises(OutputError, match=r"cannot write results to .*(No space|4 of 8)"):
        work()
    assert tree(tmp_path) == {}


def test_file_is_replaced_when_the_block_ends(tmp_path: Path) -> None:
    path = tmp_path / "sub" / "a.txt"
    for old, new in ((None, "1"), ("1", "2")):
        with output_file(path) as file:
            assert file.parent.parent == path.parent  # a hidden folder, where the file will be
            file.write_text(new)
            assert (path.read_text() if path.exists() else None) == old
        assert tree(tmp_path) == {"sub": None, "sub/a.txt": new}
    with pytest.raises(ValueError), output_file(path) as file:  # noqa: PT011, PT012
        file.write_text("3")
        raise ValueError
    assert tree(tmp_path) == {"sub": None, "sub/a.txt": "2"}


def test_file_behind_a_link_is_replaced_and_the_link_stays(tmp_path: Path) -> None:
    (tmp_path / "real").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "real")
    with output_file(tmp_path / "link") as file:
        file.write_text("new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real").read_text() == "new"


def test_places_where_no_file_can_be(tmp_path: Path) -> None:
    for path in (tmp_path, "/dev/null", f"{tmp_path}/a\0b"):
        with pytest.raises(OutputError), output_file(path):
            pass


@pytest.mark.parametrize("path", ["a", "sub/b"])
def test_result_in_the_way_of_what_is_there(tmp_path: Path, path: str) -> None:
    target = tmp_path / "out"
    (target / "a").mkdir(parents=True)
    (target / "sub").write_text("a file")
    (target / "0").write_text("old")
    before = tree(tmp_path)

    def work() -> None:
        with output_folder(target) as folder:
            (folder / "0").write_text("new")
            (folder / path).parent.mkdir(exist_ok=True)
            (folder / path).write_text("1")

    with pytest.raises(OutputError, match=r"is a (file|folder) .*remove"):
        work()
    assert tree(tmp_path) == before


@pytest.fixture
def on_windows(monkeypatch: pytest.MonkeyPatch) -> None:
    """What Windows does otherwise, simulated: a file that somebody reads cannot be replaced."""
    monkeypatch.setattr(output, "IS_WINDOWS", True)


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
    output.replace(tmp_path / "new", tmp_path / "old")
    assert (tmp_path / "old").read_text() == "new"
    assert len(tries) == 4


@pytest.mark.parametrize("is_windows", [True, False])
def test_a_file_that_stays_open_is_an_error(is_windows, tmp_path, monkeypatch):
    monkeypatch.setattr(output, "IS_WINDOWS", is_windows)
    monkeypatch.setattr(output, "_WAITS_S", (0.001,) * 5)
    (tmp_path / "new").write_text("new")
    tries = held_open(monkeypatch, 100)
    with pytest.raises(PermissionError):
        output.replace(tmp_path / "new", tmp_path / "old")
    assert len(tries) == (6 if is_windows else 1)


def test_no_text_is_written_with_the_systems_line_ends():
    for path in sorted((ROOT / "src").rglob("*.py")):
        text = path.read_text("utf-8")
        for call in re.findall(r"\.write_text\((?:[^()]|\((?:[^()]|\([^()]*\))*\))*\)", text):
            assert 'newline="\\n"' in call, f"{path}: {call}"


def test_a_temporary_folder_that_is_swept_before_it_is_locked_is_made_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = []

    def swept_once(folder: Path, *, is_waiting: bool) -> None:
        made.append(folder)
        if len(made) == 1:
            shutil.rmtree(folder)

    monkeypatch.setattr(output, "_lock", swept_once)
    with hidden_folder(tmp_path) as folder:
        assert folder.is_dir()
    assert len(set(made)) == 2
    assert not list(tmp_path.iterdir())
