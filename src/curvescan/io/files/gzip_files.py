"""Whole gzip-compressed files: unpacked to a temporary file for readers that jump to and fro, and written as text."""

from __future__ import annotations

import errno
import gzip
import io
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

from curvescan.errors import LogFileError
from curvescan.io.files.lines import GZIP_MAGIC, BrokenGzipError, read_chunks


def unpack(path: Path, target: Path) -> bool:
    """Write what a gzip-compressed file unpacks to, and return whether it was whole."""
    try:
        with target.open("wb") as file:
            for chunk in read_chunks(path):
                file.write(chunk)
    except BrokenGzipError:
        return False
    except LogFileError:
        raise
    except OSError as error:
        full = ": free some space, or name a larger folder in TMPDIR"
        raise LogFileError(
            f"cannot unpack {path} to {target.parent}: {error.strerror or error}"
            f"{full if error.errno == errno.ENOSPC else ''}"
        ) from error
    return True


def is_packed(path: Path) -> bool:
    """Return whether a file begins like gzip-compressed data. Raises LogFileError."""
    try:
        with path.open("rb") as file:
            return file.read(len(GZIP_MAGIC)) == GZIP_MAGIC
    except OSError as error:
        raise LogFileError(f"cannot read {path}: {error.strerror or error}") from error


@contextmanager
def text_file(path: Path) -> Iterator[TextIO]:
    """Yield a new text file, gzip-compressed where its name ends in ``.gz``."""
    with path.open("xb") as raw:
        if path.suffix != ".gz":
            with io.TextIOWrapper(raw, encoding="ascii", newline="") as text:
                yield text
            return
        # without name and time, the same log gives the same bytes
        with (
            gzip.GzipFile(filename="", mode="wb", fileobj=raw, mtime=0, compresslevel=6) as packed,
            io.TextIOWrapper(packed, encoding="ascii", newline="") as text,
        ):
            yield text
