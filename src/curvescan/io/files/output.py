"""output_folder and output_file: results appear together and whole, or not at all, even when the process is killed."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from curvescan.errors import OutputError

HIDDEN_PREFIX = ".curvescan-"
"""Beginning of the names of temporary folders; one that is left belongs to a process that was killed."""


@contextmanager
def output_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary folder whose files are moved to `path` when the block ends without an error.

    The temporary folder is hidden, on the file system of the target and beside it (inside it where the target is a
    mount point or its parent cannot be written). It is made, and the target's access rights are tried, before the
    block runs, so that a place that cannot be written costs no work. A target that was missing appears with all its
    files in one step. In one that exists, new folders appear in one step, files of the same name are replaced, each in
    one step, and other files stay. After an error the target is as before, and parent folders that were made for it
    are gone. A process that is killed leaves each file old or new, whole, and perhaps the hidden folder.

    Parameters
    ----------
    path : str or path-like
        Folder of the results; it and its parents are made where they are missing.

    Yields
    ------
    Path
        The temporary folder, empty.

    Raises
    ------
    OutputError
        When the results cannot be written there.
    """
    with _temporary(path, _check_is_free, _make_temporary) as (temporary, target):
        yield temporary
        with _one_sentence(path):
            _move_all(temporary, target)


@contextmanager
def output_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path; the file that the block writes there replaces `path` in one step when the block ends.

    After an error, and when the process is killed, `path` is as before. A symbolic link stays, and what it leads to is
    replaced. Missing parent folders are made.

    Parameters
    ----------
    path : str or path-like
        The file.

    Yields
    ------
    Path
        A file of the same name that does not yet exist, in a hidden folder beside `path`.

    Raises
    ------
    OutputError
        When the file cannot be written there.
    """
    with _temporary(path, _check_takes_file, _make_beside) as (temporary, target):
        yield temporary / target.name
        with _one_sentence(path):
            (temporary / target.name).replace(target)


@contextmanager
def _temporary(
    path: str | os.PathLike[str], check: Callable[[Path], None], make: Callable[[Path], Path]
) -> Iterator[tuple[Path, Path]]:
    """Yield a temporary folder, gone when the block ends, and the target; an error takes the new parents along."""
    made: list[Path] = []
    temporary: Path | None = None
    try:
        with _one_sentence(path):
            target = Path(os.path.realpath(path))
            check(target)
            _make_parents(target, made)
            temporary = make(target)
        yield temporary, target
    except BaseException:
        _remove(temporary, made)
        raise
    _remove(temporary, [])


@contextmanager
def _one_sentence(path: str | os.PathLike[str]) -> Iterator[None]:
    """Say as an OutputError why results cannot be written to `path`."""
    try:
        yield
    except OutputError:
        raise
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise OutputError(
            f"cannot write results to {os.fspath(path)!r}: {reason}; choose another folder"
        ) from error


def _check_is_free(target: Path) -> None:
    if target.exists() and not target.is_dir():
        raise OutputError(f"{target} is a file: results need a folder, choose another name")


def _check_takes_file(target: Path) -> None:
    _check_is_free(target.parent)
    if target.exists() and not target.is_file():
        kind = "folder" if target.is_dir() else "device or a pipe"
        raise OutputError(f"{target} is a {kind}: a result needs a file, choose another name")


def _make_parents(target: Path, made: list[Path]) -> None:
    """Make the folders that are missing above the target, and list each as soon as it is made."""
    for parent in reversed([parent for parent in target.parents if not parent.exists()]):
        parent.mkdir()
        made.append(parent)


def _make_temporary(target: Path) -> Path:
    if not target.exists():
        return _new_hidden_folder(target.parent)
    # tried in any case: the results must at last go into the target itself
    inside = _new_hidden_folder(target)
    try:
        beside = _new_hidden_folder(target.parent)
    except OSError:
        return inside
    if beside.stat().st_dev != inside.stat().st_dev:
        beside.rmdir()
        return inside
    inside.rmdir()
    return beside


def _make_beside(target: Path) -> Path:
    return _new_hidden_folder(target.parent)


def _new_hidden_folder(parent: Path) -> Path:
    return Path(tempfile.mkdtemp(prefix=HIDDEN_PREFIX, dir=parent))


def _move_all(temporary: Path, target: Path) -> None:
    files = sorted(path for path in temporary.rglob("*") if not path.is_dir())
    _check_goals([target / file.relative_to(temporary) for file in files], target)
    if not target.exists():
        _give_ordinary_rights(temporary)
    _move(temporary, target)


def _move(source: Path, goal: Path) -> None:
    """Move a file, or a folder's content: in one step where the goal is a file or is not there."""
    if not (source.is_dir() and goal.is_dir()):
        source.replace(goal)
        return
    for entry in sorted(source.iterdir()):
        _move(entry, goal / entry.name)


def _give_ordinary_rights(temporary: Path) -> None:
    # it was made for its owner alone; the mode of a new folder is found by making one
    ordinary = temporary / ".rights"
    ordinary.mkdir()
    temporary.chmod(ordinary.stat().st_mode & 0o7777)
    ordinary.rmdir()


def _check_goals(goals: list[Path], target: Path) -> None:
    # looked at before the first move, so that the target does not end half old, half new
    for goal in goals:
        if goal.is_dir():
            raise OutputError(f"{goal} is a folder and a result has its name: remove or rename it")
        for parent in goal.parents:
            if parent == target:
                break
            if parent.exists() and not parent.is_dir():
                raise OutputError(f"{parent} is a file where results need a folder: remove it")


def _remove(temporary: Path | None, made: list[Path]) -> None:
    if temporary is not None:
        shutil.rmtree(temporary, ignore_errors=True)
    for parent in reversed(made):
        try:
            parent.rmdir()
        except OSError:
            return  # no longer empty: somebody else uses it
