"""output_folder: results appear in their folder together, or not at all."""

from __future__ import annotations

import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from curvescan.errors import OutputError


@contextmanager
def output_folder(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary folder whose files are moved to `path` when the block ends without an error.

    The temporary folder is hidden, on the file system of the target and beside it (inside it where the target is a
    mount point or its parent cannot be written). It is made, and the target's access rights are tried, before the
    block runs, so that a place that cannot be written costs no work. Files of the same name in the target are replaced,
    each in one step; other files there stay. After an error the target is as before, and parent folders that were
    made for it are gone.

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
    made: list[Path] = []
    temporary: Path | None = None
    try:
        try:
            target = Path(os.path.realpath(path))
            _check_is_free(target)
            made = _make_parents(target)
            temporary = _make_temporary(target)
        except (OSError, ValueError) as error:
            raise _cannot_write(path, error) from error
        yield temporary
        try:
            _move_all(temporary, target)
        except OSError as error:
            raise _cannot_write(path, error) from error
    except BaseException:
        _remove(temporary, made)
        raise
    _remove(temporary, [])


def _check_is_free(target: Path) -> None:
    if target.exists() and not target.is_dir():
        raise OutputError(f"{target} is a file: results need a folder, choose another name")


def _make_parents(target: Path) -> list[Path]:
    missing = [parent for parent in target.parents if not parent.exists()]
    made: list[Path] = []
    try:
        for parent in reversed(missing):
            parent.mkdir()
            made.append(parent)
    except OSError:
        _remove(None, made)
        raise
    return made


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


def _new_hidden_folder(parent: Path) -> Path:
    return Path(tempfile.mkdtemp(prefix=".curvescan-", dir=parent))


def _move_all(temporary: Path, target: Path) -> None:
    files = sorted(path for path in temporary.rglob("*") if not path.is_dir())
    moves = [(file, target / file.relative_to(temporary)) for file in files]
    _check_goals([goal for _, goal in moves], target)
    is_new = not target.exists()
    try:
        for file, goal in moves:
            goal.parent.mkdir(parents=True, exist_ok=True)
            file.replace(goal)
        target.mkdir(exist_ok=True)
    except OSError:
        if is_new:
            shutil.rmtree(target, ignore_errors=True)
        raise


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


def _cannot_write(path: str | os.PathLike[str], error: Exception) -> OutputError:
    if isinstance(error, OutputError):
        return error
    reason = getattr(error, "strerror", None) or str(error)
    return OutputError(
        f"cannot write results to {os.fspath(path)!r}: {reason}; choose another folder"
    )
