"""Moving finished results into the folder where they belong, so that it never holds files of two runs.

Where the folder is not there, or holds nothing but what the new results replace, it changes in one step. Else, where
it holds files of others, which stay, the old results are moved out before the new ones are moved in: whatever happens
in between, all files seen there are of one run.
"""

from __future__ import annotations

import json
import os
import sys
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from curvescan.errors import OutputError
from curvescan.io.files.windows import replace

RECORDS = ("run.json", "results.json")
"""Files that list, under ``"files"``, the results they belong to."""


def move_results(temporary: Path, target: Path, inputs: Sequence[Path] = ()) -> None:
    """Move all files of a temporary folder into `target`, in place of those of the same names and of the run before.

    Of the run before are the files that its record lists; those that the new record lists too stay.

    Raises OutputError, OSError.
    """
    new = {file.relative_to(temporary) for file in _files(temporary)}
    _check_goals([target / name for name in sorted(new)], target)
    if not target.exists():
        _give_ordinary_rights(temporary)
        replace(temporary, target)
        return
    replaced = {name for name in new if _is_there(target / name)}
    old = replaced | _results_before(temporary, target, new, inputs)
    is_all = bool(old) and all(file.relative_to(target) in old for file in _files(target))
    if is_all and temporary.parent != target and _exchanged(temporary, target):
        return
    if len(old) == 1 == len(replaced):  # a single file can be replaced in one step, and first
        name = replaced.pop()
        replace(temporary / name, target / name)
        old, new = set(), new - {name}
    _swap_files(temporary, target, old, new)


def _swap_files(temporary: Path, target: Path, old: set[Path], new: set[Path]) -> None:
    """Move the old files out, the record first, and the new ones in, the record last; undo it where that fails."""
    retired = temporary / ".retired"
    moves = [(target / name, retired / name) for name in sorted(old, key=_records_first)]
    whole = [entry for entry in temporary.iterdir() if not (target / entry.name).exists()]
    moves += [(entry, target / entry.name) for entry in whole if entry.is_dir()]
    apart = [name for name in new if not any((temporary / name).is_relative_to(e) for e, _ in moves)]
    moves += [(temporary / name, target / name) for name in sorted(apart, key=_records_first, reverse=True)]
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
    for folder in {parent for name in old for parent in name.parents if parent.name}:
        with suppress(OSError):  # not empty
            (target / folder).rmdir()


def _records_first(name: Path) -> tuple[bool, Path]:
    return name.name not in RECORDS, name


def _results_before(temporary: Path, target: Path, new: set[Path], inputs: Sequence[Path]) -> set[Path]:
    """Return the files of the run before that the new one does not have."""
    before: set[Path] = set()
    for record in RECORDS:
        if Path(record) in new:
            before |= _listed(target / record) - _listed(temporary / record)
    kept = [Path(os.path.realpath(path)) for path in inputs]
    return {
        name
        for name in before - new
        if (target / name).is_file() and not any((target / name).is_relative_to(path) for path in kept)
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


def _exchanged(temporary: Path, target: Path) -> bool:
    """Put one folder in the other's place, in one step; False where that cannot be done, or pulls a place away."""
    with suppress(OSError):
        if Path.cwd().is_relative_to(target):  # the shell's folder too, most likely
            return False
    state = target.stat()
    try:
        temporary.chmod(state.st_mode & 0o7777)
        if hasattr(os, "chown") and (state.st_uid, state.st_gid) != (os.geteuid(), os.getegid()):
            os.chown(temporary, state.st_uid, state.st_gid)
        return _exchange(temporary, target)
    except OSError:
        return False


def _exchange(one: Path, other: Path) -> bool:
    import ctypes

    try:
        library = ctypes.CDLL(None, use_errno=True)
    except (OSError, TypeError):  # Windows
        return False
    first, second = os.fsencode(one), os.fsencode(other)
    if sys.platform == "darwin":
        swap = getattr(library, "renamex_np", None)
        return swap is not None and swap(first, second, ctypes.c_uint(2)) == 0
    rename = getattr(library, "renameat2", None)
    here, exchange = ctypes.c_int(-100), ctypes.c_uint(2)
    return rename is not None and rename(here, first, here, second, exchange) == 0


def _files(folder: Path) -> Iterator[Path]:
    """Yield all that is in a folder, however deep, but folders with something in them."""
    with os.scandir(folder) as entries:
        for entry in sorted(entries, key=lambda entry: entry.name):
            if entry.is_dir(follow_symlinks=False):
                yield from _files(Path(entry.path))
            else:
                yield Path(entry.path)


def _is_there(path: Path) -> bool:
    return path.exists() or path.is_symlink()


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
