"""The files of a ROS bag: which kind they are, which of a folder belong together, and how they are unpacked.

A ROS 2 bag is a folder with its storage in one file, or in several that follow each other: ``name_0.db3``,
``name_1.db3``. It is found by its content; ``metadata.yaml`` is not needed.
"""

import bz2
import importlib
import re
import sys
from collections.abc import Callable, Iterator
from contextlib import suppress
from enum import Enum
from pathlib import Path
from typing import Any

from curvescan.errors import LogFileError, LogFormatError
from curvescan.io.files.lines import MAX_UNPACKED_RATIO, MIN_UNPACKED_LIMIT, ZSTD_MAGIC, read_head

_MAGIC_BYTES = 16


class BagKind(Enum):
    """How a ROS bag stores its messages; the value names it in words."""

    ROS1 = "ROS 1 bag"
    SQLITE = "ROS 2 bag (sqlite3)"
    MCAP = "ROS 2 bag (MCAP)"

    def begins(self, head: bytes) -> bool:
        """Return whether the first bytes of a file, unpacked, are those of this kind."""
        return head.startswith(_MAGICS[self])


_MAGICS = {BagKind.ROS1: b"#ROSBAG V", BagKind.SQLITE: b"SQLite format 3\x00", BagKind.MCAP: b"\x89MCAP0\r\n"}


def bag_kind(path: Path) -> BagKind | None:
    """Return the kind of bag in a file, plain or gzip-compressed; None when it is none."""
    head = read_head(path, _MAGIC_BYTES)
    return next((kind for kind in BagKind if kind.begins(head)), None)


def storage_files(folder: Path) -> tuple[Path, ...]:
    """Return the storage files of a ROS 2 bag folder in the order they were recorded, then those that hold nothing."""
    try:
        entries = sorted(entry for entry in folder.iterdir() if entry.is_file())
    except OSError as error:
        raise LogFileError(f"cannot read folder {folder}: {error.strerror or error}") from error
    kinds: dict[Path, BagKind] = {}
    for entry in entries:
        with suppress(LogFileError, LogFormatError):  # what cannot be read is no bag
            kind = bag_kind(entry)
            if kind in (BagKind.SQLITE, BagKind.MCAP):
                kinds[entry] = kind
    if not kinds:
        if (folder / "metadata.yaml").is_file():
            raise LogFileError(
                f"{folder} is the folder of a ROS 2 bag, by its metadata.yaml, without a storage file that can be "
                "read: it needs its .db3 or .mcap (plain or gzip-compressed; unpack other compression first)"
            )
        raise LogFileError(
            f"a log must be a file or the folder of a ROS 2 bag, and {folder} is a folder without one: "
            "give the path of a log inside it"
        )
    if len({(kind, _split_name(file)[0]) for file, kind in kinds.items()}) > 1:
        names = ", ".join(file.name for file in list(kinds)[:8])
        raise LogFormatError(f"{folder} holds several bags: give one of them ({names})")
    # a recorder that was killed leaves a file empty, or with a part of its first bytes
    stems = {(_split_name(file)[0], file.suffix) for file in kinds}
    parts = [entry for entry in entries if (_split_name(entry)[0], entry.suffix) in stems]
    return tuple(sorted(parts, key=lambda file: (file not in kinds, _split_name(file)[1])))


def recorded_counts(folder: Path) -> dict[str, int]:
    """Return how many messages a ROS 2 bag has by topic, by the metadata.yaml in its folder; empty without one."""
    text = ""
    with suppress(OSError, UnicodeDecodeError):
        text = (folder / "metadata.yaml").read_text("utf-8")
    topics = re.search(r"^ *topics_with_message_count:\n( *)- ", text, re.M)
    counts: dict[str, int] = {}
    for entry in re.split(rf"^{topics[1]}- ", text[topics.start() :], flags=re.M) if topics else ():
        name = re.search(r"^ *name: (\S+)$", entry, re.M)
        count = re.search(r"^ *message_count: (\d{1,12})$", entry, re.M)
        if name and count:
            counts[name[1]] = int(count[1])
    return counts


def _split_name(file: Path) -> tuple[str, int]:
    """Return the name without number and endings, and the number: ("run", 2) for run_2.db3.gz."""
    stem = re.sub(r"(\.(db3|mcap|gz))+$", "", file.name)
    match = re.fullmatch(r"(.*)_(\d{1,9})", stem)
    return (match[1], int(match[2])) if match else (stem, -1)


MIN_CHUNK_LIMIT = 16 << 20
"""Up to this many bytes a single chunk may unpack to: recorders begin a new one after 1 to 4 MiB."""

MAX_CHUNK_RATIO = 20
_PIECE_BYTES = 1 << 20
LZ4_MAGIC = b"\x04\x22\x4d\x18"
_SKIPPABLE = b"\x2a\x4d\x18"
_TOO_MUCH = (
    "its chunks unpack to more than {:,} MiB, too much for their size: if it is sound, write it anew "
    "without compression"
)


class Unpacker:
    """Unpacks the chunks of one file, one after the other, within limits for each and for all together."""

    def __init__(self) -> None:
        self._n_packed = 0
        self._n_unpacked = 0

    def unpack(self, data: bytes, kind: str) -> bytes:
        """Return what a chunk unpacks to. Raises LogFormatError, Exception."""
        self._n_packed += len(data)
        left = MIN_UNPACKED_LIMIT + MAX_UNPACKED_RATIO * self._n_packed - self._n_unpacked
        limit = min(max(MIN_CHUNK_LIMIT, MAX_CHUNK_RATIO * len(data)), max(left, 0))
        if kind == "lz4" and _lz4().get_frame_info(data)["content_size"] > limit:
            raise LogFormatError(_TOO_MUCH.format(limit >> 20))
        pieces: list[bytes] = []
        for piece in _pieces(data, kind):
            pieces.append(piece)
            limit -= len(piece)
            if limit < 0:
                n_bytes = sum(map(len, pieces))
                raise LogFormatError(_TOO_MUCH.format(n_bytes >> 20))
        raw = b"".join(pieces)
        self._n_unpacked += len(raw)
        return raw


def _pieces(data: bytes, kind: str) -> Iterator[bytes]:
    """Yield what data unpack to, a MiB at once."""
    while data:
        decompressor = _DECOMPRESSORS[kind]()
        yield decompressor.decompress(data, max_length=_PIECE_BYTES)
        while not decompressor.eof:
            piece = decompressor.decompress(b"", max_length=_PIECE_BYTES)
            if not piece and decompressor.needs_input:
                raise EOFError("compressed data end early")
            yield piece
        # a second frame may follow; of lz4 it is not looked at
        data = b"" if kind == "lz4" else decompressor.unused_data


def packing_of(data: bytes) -> str | None:
    """Return the compression of an MCAP chunk by its first bytes: ``"zstd"``, ``"lz4"`` or None."""
    if data.startswith(LZ4_MAGIC):
        return "lz4"
    if data.startswith(ZSTD_MAGIC) or data[1:4] == _SKIPPABLE:
        return "zstd"
    return None


def _lz4() -> Any:
    return importlib.import_module("lz4.frame")


def _zstd() -> Any:
    name = "compression.zstd" if sys.version_info >= (3, 14) else "backports.zstd"
    return importlib.import_module(name)


# rosbags depends on these libraries, which are loaded where a bag uses them
_DECOMPRESSORS: dict[str, Callable[[], Any]] = {
    "bz2": bz2.BZ2Decompressor,
    "lz4": lambda: _lz4().LZ4FrameDecompressor(),
    "zstd": lambda: _zstd().ZstdDecompressor(),
}
