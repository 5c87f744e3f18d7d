"""output_folder and output_file: results are written beside their place and renamed, whole or not at all.

The temporary folder is hidden, on the file system of the target, and locked while its process lives: what a killed
process left is removed by the next output to that place.
"""

import errno
import json
import os
import re
import secrets
import shutil
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from curvescan._interrupts import cleaned_up_by, held_back, note_written
from curvescan.errors import CurvescanError, OutputError
from curvescan.io.files.lines import as_path, printable

__all__ = ["HIDDEN_PREFIX", "check_is_other", "hidden_folder", "output_file", "output_folder"]

HIDDEN_PREFIX = ".curvescan-"  # beginning of the names of temporary folders
RECORDS = ("run.json", "results.json")  # files that list, under ``"files"``, the results they belong to
IS_WINDOWS = os.name == "nt"
_NAME = re.compile(re.escape(HIDDEN_PREFIX) + r"[a-z0-9_]{8}")
_RETIRED = ".retired"
_MAX_PATH = 4_000  # characters of a path in a sentence
_LARGEST_SWEPT = 10_000  # larger folders are not searched: ours have a handful of neighbours
_WAITS_S = (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5)


@contextmanager
def output_folder(path: str | os.PathLike[str], *, inputs: Sequence[str | os.PathLike[str]] = ()) -> Iterator[Path]:
    """Yield a temporary folder whose files are moved to `path` when the block ends without an error.

    A target that was missing appears in one step. In one that exists, files of the same names are replaced, and those
    of the run before, which its run.json or results.json lists; other files stay. After an error the target is as
    before. A process that is killed leaves files of one run; the other run's are in the hidden folder, which then
    stays. Raises OutputError.
    """
    with _temporary(path, is_file=False) as (temporary, target):
        yield temporary
        with held_back():
            _move(temporary, target, inputs)
            note_written(printable(os.fspath(path), _MAX_PATH))


@contextmanager
def output_file(path: str | os.PathLike[str]) -> Iterator[Path]:
    """Yield a temporary path; the file that the block writes there replaces `path` in one step when the block ends.

    After an error, and when the process is killed, `path` is as before. A symbolic link stays: its target is replaced.
    """
    with _temporary(path, is_file=True) as (temporary, target):
        yield temporary / target.name
        with held_back():
            replace(temporary / target.name, target)
            if not target.parent.name.startswith(HIDDEN_PREFIX):
                note_written(printable(os.fspath(path), _MAX_PATH))


def check_is_other(target: Path, source: Path) -> None:
    """Raise OutputError where a file to write is the log that it is made of, or lies in its folder."""
    real, origin = Path(os.path.realpath(target)), Path(os.path.realpath(source))
    is_same = target.exists() and source.exists() and target.samefile(source)
    if is_same or real == origin or origin in real.parents or real in origin.parents:
        raise OutputError(
            f"{target} is the log itself, or shares its folder with it: choose another name"
            if is_same or real == origin
            else f"{target} lies within the log {source}, or around it: choose another name"
        )


@contextmanager
def _temporary(path: str | os.PathLike[str], *, is_file: bool) -> Iterator[tuple[Path, Path]]:
    """Yield a hidden folder, gone when the block ends, and the target; an error takes the new parents along."""
    made: list[Path] = []
    with cleaned_up_by(lambda: _remove(made)), _one_sentence(path):
        try:
            target = Path(os.path.realpath(path))
            _check(target, is_file=is_file)
            for parent in reversed([parent for parent in target.parents if not parent.exists()]):
                parent.mkdir()
                made.append(parent)
            with hidden_folder(target if target.exists() and not is_file else target.parent) as temporary:
                yield temporary, target
        except BaseException:
            with held_back():
                _remove(made)
            raise


@contextmanager
def _one_sentence(path: str | os.PathLike[str]) -> Iterator[None]:
    """Say as an OutputError why results cannot be written to `path`; the disk may also become full."""
    try:
        if "\0" in str(as_path(path, "what is to be written")):
            raise OSError(errno.EINVAL, "embedded null character in path")
        yield
    except CurvescanError:
        raise
    except OSError as error:
        remedy = "choose another folder"
        if error.errno in (errno.ENOSPC, errno.EDQUOT, errno.EFBIG):
            remedy = f"make room, or {remedy}"
        raise OutputError(
            f"cannot write results to {os.fspath(path)!r}: {error.strerror or error}; {remedy}"
        ) from error


def _check(target: Path, *, is_file: bool) -> None:
    folder = target.parent if is_file else target
    if folder.exists() and not folder.is_dir():
        raise OutputError(f"{folder} is a file: results need a folder, choose another name")
    if is_file and target.exists() and not target.is_file():
        kind = "folder" if target.is_dir() else "device or a pipe"
        raise OutputError(f"{target} is a {kind}: a result needs a file, choose another name")


def _remove(made: list[Path]) -> None:
    for parent in reversed(made):
        try:
            parent.rmdir()
        except OSError:
            return  # no longer empty: somebody else uses it


@contextmanager
def hidden_folder(parent: Path) -> Iterator[Path]:
    """Yield a new hidden folder, locked, and remove it at the end; first those of killed processes are removed."""
    _sweep(parent)
    path, lock = _make_locked(parent)
    try:
        with cleaned_up_by(lambda: shutil.rmtree(path, ignore_errors=True)):
            yield path
    finally:
        with held_back():
            shutil.rmtree(path, ignore_errors=True)
            if lock is not None:
                os.close(lock)


def _sweep(parent: Path) -> None:
    """Remove hidden folders that no living process has locked; where folders cannot be locked, none are."""
    if parent.name.startswith(HIDDEN_PREFIX):
        return  # a folder of our own
    with suppress(OSError), os.scandir(parent) as entries:
        for n, entry in enumerate(entries):
            if n > _LARGEST_SWEPT:
                return
            is_ours = _NAME.fullmatch(entry.name) and entry.is_dir(follow_symlinks=False)
            if is_ours and not (Path(entry.path) / _RETIRED).exists():
                lock = _lock(Path(entry.path), is_waiting=False)
                if lock is not None:
                    shutil.rmtree(entry.path, ignore_errors=True)
                    os.close(lock)


def _make_locked(parent: Path) -> tuple[Path, int | None]:
    while True:
        path = parent / f"{HIDDEN_PREFIX}{secrets.token_hex(4)}"
        with suppress(FileExistsError):
            path.mkdir()
            lock = _lock(path, is_waiting=True)
            if path.exists():
                return path, lock
            if lock is not None:  # swept before it was locked
                os.close(lock)


def _lock(folder: Path, *, is_waiting: bool) -> int | None:
    """Return a file descriptor whose life is that of a lock on a folder; None where there is none to be had."""
    try:
        import fcntl
    except ImportError:  # Windows, where a folder cannot be opened either
        return None
    lock = None
    try:
        lock = os.open(folder, os.O_RDONLY)
        fcntl.flock(lock, fcntl.LOCK_EX | (0 if is_waiting else fcntl.LOCK_NB))
    except OSError:
        if lock is not None:
            os.close(lock)
        return None
    return lock


def replace(source: Path, goal: Path) -> None:
    """Move a file or folder to where a file may be, in one step; Windows is given a second. Raises OSError."""
    for wait in _WAITS_S if IS_WINDOWS else ():
        try:
            source.replace(goal)
        except PermissionError:
            time.sleep(wait)
        else:
            return
    source.replace(goal)


def _move(temporary: Path, target: Path, inputs: Sequence[str | os.PathLike[str]]) -> None:
    """Move all files of a temporary folder into `target`, in place of those of the same names and of the run before."""
    if not target.exists():
        replace(temporary, target)
        return
    new = [*_units(temporary, target)]
    for name in new:  # before the first move, so that the target does not end half old, half new
        goal = target / name
        if goal.is_dir():
            raise OutputError(f"{goal} is a folder and a result has its name: remove or rename it")
        if goal.exists() and (temporary / name).is_dir():
            raise OutputError(f"{goal} is a file where results need a folder: remove it")
    replaced = {name for name in new if (target / name).exists() or (target / name).is_symlink()}
    old = replaced | _results_before(temporary, target, inputs)
    if len(old) == len(replaced) == 1:  # a single file can be replaced in one step, and first
        name = replaced.pop()
        replace(temporary / name, target / name)
        new.remove(name)
        old = set()
    moves = [(target / name, temporary / _RETIRED / name) for name in sorted(old, key=_records_first)]
    moves += [(temporary / name, target / name) for name in sorted(new, key=_records_first, reverse=True)]
    done: list[tuple[Path, Path]] = []
    try:
        for source, goal in moves:
            goal.parent.mkdir(parents=True, exist_ok=True)
            replace(source, goal)
            done.append((source, goal))
    except BaseException:
        for source, goal in reversed(done):
            with suppress(OSError):
                replace(goal, source)
        raise
    for folder in sorted({parent for name in old for parent in name.parents if parent.name}, reverse=True):
        with suppress(OSError):  # not empty
            (target / folder).rmdir()


def _units(temporary: Path, target: Path, folder: Path = Path()) -> Iterator[Path]:
    """Yield what is moved as it is: each file, and each folder that the target does not have."""
    for entry in sorted((temporary / folder).iterdir()):
        name = folder / entry.name
        if entry.is_dir() and not entry.is_symlink() and (target / name).is_dir():
            yield from _units(temporary, target, name)
        else:
            yield name


def _records_first(name: Path) -> tuple[bool, Path]:
    return name.name not in RECORDS, name


def _results_before(temporary: Path, target: Path, inputs: Sequence[str | os.PathLike[str]]) -> set[Path]:
    """Return the files that the record of the run before lists and the new one does not have."""
    before: set[Path] = set()
    for record in RECORDS:
        if (temporary / record).exists():
            before |= _listed(target / record) - _listed(temporary / record)
    kept = [Path(os.path.realpath(path)) for path in inputs]
    return {
        name
        for name in before
        if (target / name).is_file()
        and not (temporary / name).exists()
        and not any((target / name).is_relative_to(path) for path in kept)
    }


def _listed(record: Path) -> set[Path]:
    """Return the files that a record lists; none of them lies outside its folder."""
    try:
        content: Any = json.loads(record.read_bytes())
    except (OSError, ValueError, RecursionError):
        return set()
    names = content.get("files") if isinstance(content, dict) else None
    listed = {Path(name) for name in names or () if isinstance(name, str) and "\0" not in name}
    return {name for name in listed if not name.is_absolute() and ".." not in name.parts}
