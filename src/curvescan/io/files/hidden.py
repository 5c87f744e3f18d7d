"""Hidden temporary folders: made where results will go, locked while their process lives, swept when it was killed."""

from __future__ import annotations

import os
import re
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from curvescan._interrupts import cleaned_up_by, held_back
from curvescan.io.files.windows import make_temporary

HIDDEN_PREFIX = ".curvescan-"
"""Beginning of the names of temporary folders."""

_NAME = re.compile(re.escape(HIDDEN_PREFIX) + r"[a-z0-9_]{8}")
_LARGEST_SWEPT = 10_000
"""Folders of more entries are not searched: only ours are swept, and they have a handful of neighbours."""


@contextmanager
def hidden_folder(parent: Path) -> Iterator[Path]:
    """Yield a new hidden folder, locked; at the end it is removed with what is in it, also where a signal ends all.

    Those that killed processes left in `parent` are removed first.

    Raises OSError.
    """
    sweep(parent)
    path, lock = _make_locked(parent)
    try:
        with cleaned_up_by(lambda: shutil.rmtree(path, ignore_errors=True)):
            yield path
    finally:
        with held_back():
            shutil.rmtree(path, ignore_errors=True)
            if lock is not None:
                os.close(lock)


def sweep(parent: Path) -> None:
    """Remove hidden folders that no living process has locked; where folders cannot be locked, none are."""
    if parent.name.startswith(HIDDEN_PREFIX):
        return  # a folder of our own
    with suppress(OSError), os.scandir(parent) as entries:
        for n, entry in enumerate(entries):
            if n > _LARGEST_SWEPT:
                return
            if _NAME.fullmatch(entry.name) and entry.is_dir(follow_symlinks=False):
                _remove_unlocked(Path(entry.path))


def _remove_unlocked(folder: Path) -> None:
    lock = _lock(folder, is_waiting=False)
    if lock is not None:
        shutil.rmtree(folder, ignore_errors=True)
        os.close(lock)


def _make_locked(parent: Path) -> tuple[Path, int | None]:
    while True:
        path = make_temporary(HIDDEN_PREFIX, parent)
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
