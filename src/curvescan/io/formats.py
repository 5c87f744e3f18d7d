"""The table of log formats, and how a file's first bytes identify them.

A format is one row: a name, a sniff that looks at the first bytes after unpacking, and the reader as
``"module:function"``, imported when a file of the format is met. Rows are tried in order.
"""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, cast

from curvescan.errors import LogFormatError
from curvescan.io.arrays.coreslam import N_COLUMNS
from curvescan.io.arrays.csv_file import header_names, is_content
from curvescan.io.log import Log
from curvescan.io.ros.bags.bag_files import BagKind

HEAD_BYTES = 1 << 16  # how many unpacked bytes a sniff gets: room for the long PARAM preamble of a CARMEN log


class LogReader(Protocol):
    """Opens a log of one format; the function or class a row of the table names."""

    def __call__(self, path: Path, *, range_max: float | None, topic: str | None) -> Log:
        """Return the log, having made sure that it holds a scan.

        range_max: Upper limit of a valid reading, metres, in place of that of the log; None to use the log's; topic:
        Which of several lasers to read, where a format names them; None for the only one.
        """


@dataclass(frozen=True, kw_only=True)
class LogFormat:
    """One row of the table of formats."""

    name: str  # in words: ``"CARMEN log"``
    sniff: Callable[[bytes], bool]
    """Whether the first HEAD_BYTES of a file, unpacked, look like this format. It never raises."""
    reader: str  # ``"module:function"`` of a LogReader

    def load(self) -> LogReader:
        """Return the reader, importing its module."""
        module, _, name = self.reader.partition(":")
        return cast(LogReader, getattr(importlib.import_module(module), name))


_CARMEN_TAGS = re.compile(
    rb"^[ \t]*(# *CARMEN Logfile|(PARAM|SYNC|ODOM|TRUEPOS|NEFF|[FR]LASER|LASER[3-5]"
    rb"|RAWLASER[1-5]|ROBOTLASER[1-5])[ \t\r]*([ \t\r\n]|\Z))",
    re.MULTILINE,
)


def is_carmen(head: bytes) -> bool:
    """Return whether a line starts with CARMEN's header or one of its message names."""
    return _CARMEN_TAGS.search(head) is not None


def is_csv(head: bytes) -> bool:
    """Return whether the first line that is no comment names columns of scans."""
    line = next((line for line in head.splitlines() if is_content(line)), b"")
    names = header_names(line[:4096])
    return "stamp" in names and ("ranges" in names or "angle_min" in names)


def is_npz(head: bytes) -> bool:
    """Return whether it is a zip archive whose first member is an array of NumPy."""
    n_name = int.from_bytes(head[26:28], "little")
    return head.startswith(b"PK\x03\x04") and head[30 : 30 + n_name].endswith(b".npy")


def is_coreslam(head: bytes) -> bool:
    """Return whether the first line has as many columns as a CoreSLAM log, all of them numbers."""
    fields = next((line for line in head.splitlines() if line.strip()), b"").split()
    return len(fields) in N_COLUMNS and all(map(_NUMBER.fullmatch, fields))


_NUMBER = re.compile(rb"[-+]?[0-9.]+(e[-+]?[0-9]+)?")

FORMATS: tuple[LogFormat, ...] = (
    *(LogFormat(name=kind.value, sniff=kind.begins, reader="curvescan.io.ros.reader:RosbagLog") for kind in BagKind),
    LogFormat(name="NPZ of scans", sniff=is_npz, reader="curvescan.io.arrays.npz_reader:open_npz"),
    LogFormat(name="CSV of scans", sniff=is_csv, reader="curvescan.io.arrays.csv_file:open_csv"),
    LogFormat(name="CoreSLAM log", sniff=is_coreslam, reader="curvescan.io.arrays.coreslam:open_coreslam"),
    LogFormat(name="CARMEN log", sniff=is_carmen, reader="curvescan.io.carmen.reader:CarmenLog"),
)

_OWN_FORMAT = "https://github.com/curvescan/curvescan/blob/main/docs/howto/format.md"
_UNPACK = "unpack it first"
_FOREIGN: tuple[tuple[bytes, str, str], ...] = (
    (b"BZh", "compressed with bzip2", _UNPACK),
    (b"\xfd7zXZ\x00", "compressed with xz", _UNPACK),
    (b"\x28\xb5\x2f\xfd", "compressed with zstd", _UNPACK),
    (b"\x1f\x8b", "compressed twice with gzip", _UNPACK),
    (b"PK\x03\x04", "a zip archive", _UNPACK),
    (b"\x89PNG\r\n\x1a\n", "a PNG picture", "give the log itself"),
    (b"\xff\xd8\xff", "a JPEG picture", "give the log itself"),
    (b"%PDF", "a PDF document", "give the log itself"),
)


def find_format(head: bytes, path: Path) -> LogFormat:
    """Return the row of the table that a file belongs to. Raises LogFormatError."""
    if not head.strip():
        raise LogFormatError(f"{path} is empty: a log must hold at least one scan")
    for row in FORMATS:
        if row.sniff(head):
            return row
    for magic, kind, remedy in _FOREIGN:
        if head.startswith(magic):
            raise LogFormatError(f"{path} is {kind}, not a log that can be read: {remedy}")
    known = ", ".join(row.name for row in FORMATS)
    if b"\x00" in head:
        raise LogFormatError(f"{path} holds binary data of an unknown format; read are: {known}")
    first = next(line for line in head.splitlines() if line.strip()).strip()
    shown = first[:40].decode("utf-8", errors="replace")
    raise LogFormatError(
        f"{path} is text of an unknown format (it begins {shown!r}); read are: {known}. {_OWN_FORMAT} shows "
        "how to read any other in eight lines"
    )
