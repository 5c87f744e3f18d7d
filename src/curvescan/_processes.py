"""Cores, processes that import what this one can, and a lock on a file that ends with the process that holds it."""

import os
import sys
from pathlib import Path
from typing import BinaryIO

GARBAGE_THRESHOLD = 50_000  # at 700 a twentieth of the imports, and of an odometry, goes into looking for garbage


def n_usable_cores() -> int:
    """Return how many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def has_own_python() -> bool:
    """Return whether the interpreter can be started again: a program that embeds Python does not name its own."""
    return "python" in Path(sys.executable or "").name


def python_command(module: str, call: str) -> list[str]:
    """Return the command of a process that imports as this one does, rarely looks for garbage, and calls a function."""
    paths = [str(Path(entry).absolute()) for entry in sys.path]
    begin = f"import gc, sys; gc.set_threshold({GARBAGE_THRESHOLD}); sys.path[:] = {paths}"
    return [sys.executable, "-c", f"{begin}; from {module} import {call.partition('(')[0]}; {call}"]


def lock(file: BinaryIO) -> None:
    """Lock an open file for this process. Raises OSError."""
    try:
        import fcntl
    except ImportError:  # Windows: a byte far behind the end, so that the file can be read meanwhile
        import msvcrt

        file.seek(1 << 40)
        msvcrt.locking(file.fileno(), msvcrt.LK_NBLCK, 1)  # type: ignore[attr-defined,unused-ignore]
    else:
        fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
