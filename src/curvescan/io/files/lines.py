"""Lines of a text file, plain or gzip-compressed, in bounded memory; whole gzip files unpacked and written.

Compression is detected by its first two bytes, never by the name of the file. Compressed data that break off deliver
what stands before the break; a line that never ends is dropped. Both are read errors, neither is fatal.
"""

import errno
import gzip
import io
import math
import os
import re
import shutil
import stat
import tempfile
import weakref
import zlib
from codecs import BOM_UTF8
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TextIO

from curvescan.errors import InvalidArgumentError, LogFileError, LogFormatError


class BrokenRecordError(LogFormatError):
    """A line, row or message breaks the rule that stands in the error's text; of its values the text holds numbers."""


@dataclass(frozen=True, kw_only=True)
class ReadError:
    """One kind of error met while reading a log: counted, reported, not fatal."""

    rule: str  # what was broken, as a phrase: ``"FLASER line cut short"``; numbers in it are of the first breach
    count: int  # how often
    first: str  # where it was met first: ``"line 17"``

    @property
    def is_end(self) -> bool:
        """Whether the end of the file is missing: what comes after could not be read."""
        return "what stands before" in self.rule

    def __str__(self) -> str:
        return f"{self.rule} ({self.count} times, first in {self.first})"


_NUMBER = re.compile(r"\b\d[\w.+-]*")  # a rule broken by another number is the same rule


class ReadErrorCounter:
    """Counts read errors by rule, with the place where each was met first; its size grows with the rules alone."""

    def __init__(self, unit: str = "line") -> None:
        self._unit = unit
        self._found: dict[str, ReadError] = {}  # by rule without its numbers

    def add(self, rule: str, number: int) -> None:
        """Count one breach of `rule`, a phrase such as ``"FLASER line cut short"``."""
        kind = _NUMBER.sub("", rule)
        known = self._found.get(kind) or ReadError(rule=rule, count=0, first=f"{self._unit} {number}")
        self._found[kind] = replace(known, count=known.count + 1)

    def read_errors(self) -> tuple[ReadError, ...]:
        """Return one ReadError a rule, most frequent first, then in the order they were met."""
        return tuple(sorted(self._found.values(), key=lambda error: -error.count))


def printable(text: str, longest: int = 60) -> str:
    """Return a text on one line, with ``?`` for what cannot be printed, cut to `longest` characters."""
    line = "".join(ch if ch.isprintable() else "?" for ch in text[: longest + 1])
    return line if len(line) <= longest else f"{line[: longest - 3]}..."


def as_path(given: str | os.PathLike[str], what: str) -> Path:
    """Return the path of a file. Raises InvalidArgumentError where none is given."""
    try:
        return Path(os.fspath(given))
    except TypeError:
        raise InvalidArgumentError(f"{what} must be given as a path, got {type(given).__name__}") from None


MIN_UNPACKED_LIMIT = 64 << 20  # up to this many bytes a file may always unpack to
MAX_UNPACKED_RATIO = 100  # beyond, it may unpack to this many times its size
ZSTD_MAGIC = b"\x28\xb5\x2f\xfd"


def unpacked_limit(path: Path) -> int:
    """Return how many bytes a compressed file may unpack to: what claims more could fill memory or disk."""
    return max(MIN_UNPACKED_LIMIT, MAX_UNPACKED_RATIO * path.stat().st_size)


GZIP_MAGIC = b"\x1f\x8b"
MAX_LINE_BYTES = 1 << 20  # longest line that is read: twenty times a line of 5,000 readings with remissions
_CHUNK_BYTES = 1 << 16
LONG_LINE = "line longer than 1 MiB"
BROKEN_GZIP = "compressed data break off or are damaged: what stands before the break is read"


class BrokenGzipError(LogFormatError):
    """Compressed data break off or are damaged at this point of the stream."""


def read_head(path: Path, n_bytes: int) -> bytes:
    """Return the first `n_bytes` of a file after unpacking, fewer when the file is shorter or has a byte-order mark."""
    head = b""
    try:
        for chunk in read_chunks(path):
            head += chunk
            if len(head) >= n_bytes:
                break
    except BrokenGzipError:
        if not head:
            raise
    return head[:n_bytes].removeprefix(BOM_UTF8)


def read_line_at(path: Path, offset: int) -> bytes:
    """Return the line that begins at an offset, without its newline. Raises LogFileError."""
    with _opened(path) as raw:
        try:
            stream = _unpacked(raw)
            stream.seek(offset)
            line = stream.readline(MAX_LINE_BYTES + 1)
        except (EOFError, gzip.BadGzipFile, zlib.error, OSError) as error:
            raise LogFileError(f"cannot read {path}: {error}: has it changed?") from error
    return line.removesuffix(b"\n")


def read_lines(path: Path, read_errors: ReadErrorCounter) -> Iterator[tuple[int, int, bytes]]:
    """Yield each line: its number, from 1, where it begins after unpacking, and its bytes without the newline.

    A byte-order mark, which Windows puts before the first line, is left out. Raises LogFileError.
    """
    number, tail, is_dropping = 0, b"", False
    start = 0  # of what is split next
    try:
        for chunk in read_chunks(path):
            *lines, tail = (tail + chunk).split(b"\n")
            for line in lines:
                number, begin = number + 1, start
                start += len(line) + 1
                if is_dropping or len(line) > MAX_LINE_BYTES:
                    is_dropping = False
                    read_errors.add(LONG_LINE, number)
                else:
                    yield _unmarked(number, begin, line)
            if is_dropping or len(tail) > MAX_LINE_BYTES:
                start += len(tail)
                is_dropping, tail = True, b""
    except BrokenGzipError:
        read_errors.add(BROKEN_GZIP, number + 1)
    if is_dropping:
        read_errors.add(LONG_LINE, number + 1)
    elif tail:
        yield _unmarked(number + 1, start, tail)


def _unmarked(number: int, begin: int, line: bytes) -> tuple[int, int, bytes]:
    n = len(BOM_UTF8) if begin == 0 and line.startswith(BOM_UTF8) else 0
    return number, begin + n, line[n:]


def read_chunks(path: Path) -> Iterator[bytes]:
    """Yield the bytes of a file in pieces of at most 64 KiB, unpacked when it is gzip-compressed."""
    # read1 hands over what is unpacked before it meets a break; read would lose up to a buffer of it
    with _opened(path) as raw:
        try:
            stream = _unpacked(raw)
            left = math.inf if stream is raw else unpacked_limit(path)
            while chunk := stream.read1(_CHUNK_BYTES):
                left -= len(chunk)
                if left < 0:
                    raise LogFormatError(
                        f"{path} unpacks to more than {unpacked_limit(path) >> 20:,} MiB, too much for a log of its "
                        "size: if it is sound, unpack it first"
                    )
                yield chunk
        except (EOFError, gzip.BadGzipFile, zlib.error) as error:
            raise BrokenGzipError(
                f"{path} starts like a gzip file but cannot be unpacked ({error}): "
                "get the file again, or unpack it by other means"
            ) from error
        except OSError as error:
            raise LogFileError(f"cannot read {path}: {error.strerror or error}") from error


def _unpacked(raw: io.BufferedReader) -> io.BufferedIOBase:
    is_gzip = raw.read(2) == GZIP_MAGIC
    raw.seek(0)
    return gzip.GzipFile(fileobj=raw) if is_gzip else raw


@contextmanager
def _opened(path: Path) -> Iterator[io.BufferedReader]:
    try:
        mode = path.stat().st_mode
        if stat.S_ISDIR(mode):
            raise LogFileError(f"a log must be a file, and {path} is a folder: give the path of a log inside it")
        if not stat.S_ISREG(mode):
            raise LogFileError(
                f"a log is read more than once and must be a regular file, and {path} is a pipe or "
                "a device: save its content to a file"
            )
        raw = path.open("rb")
    except FileNotFoundError as error:
        raise LogFileError(f"log file {path} does not exist: check the path") from error
    except PermissionError as error:
        raise LogFileError(f"no permission to read {path}: check its access rights") from error
    except LogFileError:
        raise
    except (OSError, ValueError) as error:
        # ValueError: a path with a NUL character
        raise LogFileError(f"cannot open {str(path)!r}: {error}") from error
    with raw:
        yield raw


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


def temporary_folder(owner: object) -> Path:
    """Return a new folder for what is unpacked, which goes when its owner does."""
    folder = Path(tempfile.mkdtemp(prefix="curvescan-"))
    weakref.finalize(owner, shutil.rmtree, folder, ignore_errors=True)
    return folder


def is_packed(path: Path) -> bool:
    """Return whether a file begins like gzip-compressed data. Raises LogFileError."""
    with _opened(path) as raw:
        return raw.read(len(GZIP_MAGIC)) == GZIP_MAGIC


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
