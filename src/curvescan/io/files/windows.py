"""What Windows does otherwise: the rights of temporary folders, and replacing a file that somebody reads."""

from __future__ import annotations

import os
import secrets
import tempfile
import time
from pathlib import Path

IS_WINDOWS = os.name == "nt"
_WAITS_S = (0.01, 0.02, 0.05, 0.1, 0.2, 0.3, 0.5)


def make_temporary(prefix: str, parent: Path) -> Path:
    """Return a new folder with a name of its own: the prefix and eight characters.

    Elsewhere it is its owner's alone until it is moved into place and gets ordinary rights. On Windows rights move along and
    cannot be set by a mode, so that results would stay their owner's alone: there it has those of its parent from the start.
    """
    if not IS_WINDOWS:
        return Path(tempfile.mkdtemp(prefix=prefix, dir=parent))
    while True:
        folder = parent / f"{prefix}{secrets.token_hex(4)}"
        try:
            folder.mkdir()
        except FileExistsError:
            continue
        return folder


def replace(source: Path, goal: Path) -> None:
    """Move a file or folder to where a file may be, in one step.

    Windows refuses that while a program has the old file open, if only an indexer for a moment: it is tried for a
    second.

    Raises OSError.
    """
    for wait in _WAITS_S if IS_WINDOWS else ():
        try:
            source.replace(goal)
        except PermissionError:
            time.sleep(wait)
        else:
            return
    source.replace(goal)
