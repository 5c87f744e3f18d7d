"""Chunks of a bag are unpacked no further than recorded data can need, whatever they claim."""

import bz2
import importlib
import sys
from collections.abc import Callable, Iterator
from typing import Any

from curvescan.errors import LogFormatError
from curvescan.io.files.lines import MAX_UNPACKED_RATIO, MIN_UNPACKED_LIMIT, ZSTD_MAGIC

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
