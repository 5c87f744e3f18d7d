"""A lock on a file that ends with the process that holds it, however it ends."""

from __future__ import annotations

from typing import BinaryIO


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
