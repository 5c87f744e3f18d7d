"""Limits for rosbags' readers of ROS 1 bags and of MCAP, which trust the sizes that a file claims.

Checked are what chunks unpack to, how much index a ROS 1 bag has, how many chunks of an MCAP file are held at once,
and the YAML of ROS 2 bags, in which a few hundred bytes can stand for hours of work.
"""

import io
import os
import struct
from collections import Counter
from collections.abc import Callable, Collection, Generator, Iterator
from pathlib import Path
from typing import Any, BinaryIO, cast

from rosbags.interfaces import Connection
from rosbags.rosbag1 import Reader as Ros1Reader
from rosbags.rosbag1.reader import Chunk, IndexData, decompressors
from rosbags.rosbag2 import storage_mcap as mcap

from curvescan.errors import LogFormatError
from curvescan.io.files.lines import printable
from curvescan.io.ros.bags.bag_files import Unpacker, packing_of

MIN_INDEX_LIMIT = 1 << 20
"""So many messages any ROS 1 bag may have; their index takes 150 bytes each in memory, and 12 in the file."""

BYTES_A_MESSAGE = 24  # beyond, it may have one for so many bytes of the file

MIN_HELD_LIMIT = 128 << 20
"""Up to so many bytes of chunks of an MCAP file may lie over the same moment, for they are held together."""

MAX_HELD_RATIO = 4

MIN_SUMMARY_LIMIT = 8 << 20
"""Up to so many bytes the summary of an MCAP file may take, which is held in memory and grows there thirtyfold."""

_FOOTER_BYTES = 28  # where the summary starts, and what stands behind that
_MAX_REPEATS = 100
_MAX_QOS_BYTES = 1 << 16
_QOS_KEY = b"offered_qos_profiles"
_IDX_HEADER_BYTES = 55
# start, end, size and checksum of a chunk's record, and where its compressed data begin by the length of their name
_CHUNK_HEAD = 28
_NAMES = {b"\x04\x00\x00\x00zstd": "zstd", b"\x03\x00\x00\x00lz4": "lz4"}


_HEADER, _FOOTER, _SCHEMA, _CHANNEL, _MESSAGE, _CHUNK = range(1, 7)
_MESSAGE_HEAD = 22  # channel, number, and the times of reception and of sending
_CDR, _SCHEMALESS = "cdr", "__schemaless__"
_ROS2_SCHEMAS = (b"ros2msg", b"ros2idl", b"omgidl", b"")


class CheckedRos1Reader(Ros1Reader):
    """rosbags' reader of ROS 1 bags, which unpacks chunks and takes in an index only within limits."""

    def __init__(self, file: Path, n_given: int) -> None:
        super().__init__(cast(Any, CheckedPath(file)))
        self._unpacker = Unpacker()
        self._n_left = max(MIN_INDEX_LIMIT, n_given // BYTES_A_MESSAGE)

    def read_chunk(self) -> Chunk:
        """Return the chunk at the current position, to be unpacked within limits."""
        chunk = super().read_chunk()
        kind = next(name for name, one in decompressors.items() if one is chunk.decompressor)
        if kind == "none":
            return chunk
        return chunk._replace(decompressor=lambda data: self._unpacker.unpack(data, kind))

    def read_index_data(self, pos: int, indexes: dict[int, list[IndexData]]) -> None:
        """Take in one record of the index; chunks that are listed twice count twice."""
        assert self.bio is not None
        start = self.bio.tell()
        size = int.from_bytes(self.bio.read(_IDX_HEADER_BYTES)[-4:], "little")
        self.bio.seek(start)
        self._n_left -= size // 12
        if self._n_left < 0:
            raise LogFormatError("its index lists more messages than fit into a file of its size")
        super().read_index_data(pos, indexes)

    def messages(
        self, connections: Collection[Connection] = (), start: int | None = None, stop: int | None = None
    ) -> Generator[tuple[Connection, int, bytes], None, None]:
        """Yield the messages of these connections; an index that leads to the same ones again and again is damaged."""
        # on the way to a message all records of connections before it are read, each time
        position, ends, n_repeats = -1, set[int](), 0
        for item in super().messages(connections, start, stop):
            if self.current_chunk[0] != position:
                position, ends = self.current_chunk[0], set()
            end = self.current_chunk[1].tell()
            n_repeats += end in ends
            if n_repeats > _MAX_REPEATS:
                raise LogFormatError("its index leads to the same messages again and again")
            ends.add(end)
            yield item


class CheckedMcapReader(mcap.McapReader):
    """rosbags' reader of MCAP, whose chunks unpack within limits."""

    def __init__(self, file: Path, n_given: int) -> None:
        super().__init__(cast(Any, CheckedPath(file, self._look, as_ros2)))
        self._file, self._n_given = file, n_given
        self._unpacker = Unpacker()
        self._n_bytes = file.stat().st_size

    def open(self) -> None:
        """Read the summary, or go through the file where it has none."""
        if self._n_bytes >= _FOOTER_BYTES:  # else rosbags says that it is too short
            with self._file.open("rb") as file:
                file.seek(-_FOOTER_BYTES, os.SEEK_END)
                start = int.from_bytes(file.read(8), "little")
            if 0 < start < self._n_bytes - max(MIN_SUMMARY_LIMIT, self._n_given // 2):
                raise LogFormatError("its summary is too long for a file of its size")
        super().open()
        try:
            check_chunks(self.chunks, self._n_bytes)
            # channels whose messages are not in ROS 2's encoding are left out
            encodings = {c.id: self.channels[c.id].message_encoding for c in self.connections}
            self.connections = [c for c in self.connections if encodings[c.id] == _CDR]
            if encodings and not self.connections:
                found = printable(", ".join(sorted(set(encodings.values()))), 100)
                raise LogFormatError(
                    f"none of its channels holds messages in the encoding of ROS 2 (cdr), they hold {found}"
                )
        except LogFormatError:
            self.close()
            raise

    def read_index(self) -> None:
        """Read the summary; channels and schemas that it does not repeat are looked for in the file."""
        super().read_index()
        used = {number for chunk in self.chunks for number in chunk.channel_count}
        used.update(self.statistics.channel_message_counts if self.statistics else ())
        is_whole = all(c.schema != _SCHEMALESS or c.message_encoding != _CDR for c in self.channels.values())
        if not is_whole or used - self.channels.keys():
            self.connections.clear()
            self.meta_scan()

    def meta_scan(self) -> None:
        """Gather from the file what its summary would say, schemas in chunks as rosbags takes them."""
        file, end = self.bio, self.data_end
        assert file is not None
        file.seek(self.data_start)
        summary: dict[tuple[int, bytes], bytes] = {}  # the first of each number: chunks may repeat them
        counts, first, last = Counter[int](), mcap.MAXSIZE, 0
        for kind, record in _records(file, end):
            if kind in (_SCHEMA, _CHANNEL):
                summary.setdefault((kind, record[:2]), struct.pack("<BQ", kind, len(record)) + as_ros2(kind, record))
            elif kind == _MESSAGE:
                channel, received = struct.unpack("<H4xQ", record[:14])
                counts[channel] += 1
                first, last = min(first, received), max(last, received)
        self.bio, self.data_end = io.BytesIO(b"".join(summary.values()) + bytes([_FOOTER])), 0
        try:
            super().read_index()
        finally:
            self.bio, self.data_end = file, end
        self.statistics = mcap.Statistics(
            counts.total(), len(self.schemas), len(self.channels), 0, 0, len(self.chunks), first, last, dict(counts)
        )

    def _look(self, data: bytes) -> None:
        """Unpack what will be unpacked: rosbags would not stop."""
        kind = packing_of(data)
        chunks = [(kind, data)] if kind else []
        # a chunk's record that is read as a whole, where the file has no summary
        head = data[_CHUNK_HEAD : _CHUNK_HEAD + 8]
        chunks += [
            (kind, data[_CHUNK_HEAD + len(name) + 8 :]) for name, kind in _NAMES.items() if head.startswith(name)
        ]
        for kind, packed in chunks:
            try:
                raw = self._unpacker.unpack(packed, kind)
            except LogFormatError:
                raise
            except Exception:  # noqa: BLE001 - rosbags says what is wrong with it, if it uses it
                continue
            _check_qos_in(raw)
        _check_qos_in(data)


def _records(file: BinaryIO, end: int, *, is_chunk: bool = False) -> Iterator[tuple[int, bytes]]:
    """Yield the kind and the bytes of each record up to an offset, those in chunks too; of messages only the head."""
    while file.tell() < end:
        kind, size = mcap.read_exact(file, 1)[0], int.from_bytes(mcap.read_exact(file, 8), "little")
        n_read = size if kind in (_SCHEMA, _CHANNEL, _CHUNK) else min(size, _MESSAGE_HEAD)
        record = mcap.read_exact(file, n_read)
        mcap.skip_exact(file, size - n_read)
        if kind == _CHUNK and not is_chunk:  # one in a chunk is none
            head = io.BytesIO(record)
            n_raw, crc = struct.unpack("<16xQI", head.read(_CHUNK_HEAD))
            packing, n_packed = mcap.read_string(head), int.from_bytes(head.read(8), "little")
            raw = mcap.decompress(mcap.read_exact(head, n_packed), packing, n_raw, crc)
            yield from _records(io.BytesIO(raw), len(raw), is_chunk=True)
        else:
            yield kind, record


def as_ros2(kind: int, record: bytes) -> bytes:
    """Return a record of an MCAP file as rosbags takes it, of the same length.

    rosbags reads the profile "ros2" alone, though exporters write others, or none, around the same messages; and it
    stumbles over schemas that are not ROS 2's, of channels that nobody reads. The channels decide instead.
    """
    if kind == _HEADER:
        return b"\x04\x00\x00\x00ros2".ljust(len(record), b"\x00")
    if kind == _SCHEMA:
        name_end = 6 + int.from_bytes(record[2:6], "little")
        encoding_end = name_end + 4 + int.from_bytes(record[name_end : name_end + 4], "little")
        if record[name_end + 4 : encoding_end] not in _ROS2_SCHEMAS:
            return record[:name_end].ljust(len(record), b"\x00")
    return record


def check_chunks(chunks: Collection[mcap.ChunkInfo], n_bytes: int) -> None:
    """Raise LogFormatError when chunks are listed twice, or too many lie over the same moment."""
    if len({chunk.chunk_start_offset for chunk in chunks}) < len(chunks):
        raise LogFormatError("its summary lists a chunk twice")
    limit = max(MIN_HELD_LIMIT, MAX_HELD_RATIO * n_bytes)
    changes = [(chunk.message_start_time, chunk.uncompressed_size) for chunk in chunks]
    changes += [(chunk.message_end_time + 1, -chunk.uncompressed_size) for chunk in chunks]
    n_held = 0
    for _, change in sorted(changes):
        n_held += change
        if n_held > limit:
            raise LogFormatError(f"chunks of more than {limit >> 20:,} MiB lie over the same moment, by its summary")


def check_qos(text: bytes) -> None:
    """Raise LogFormatError for a quality of service that no recorder writes: a YAML anchor multiplies without end."""
    if len(text) > _MAX_QOS_BYTES or b"&" in text:
        raise LogFormatError("the quality of service of a topic is not as recorders write it")


def _check_qos_in(data: bytes) -> None:
    at = data.find(_QOS_KEY)
    while at >= 0:
        at += len(_QOS_KEY)
        n_text = int.from_bytes(data[at : at + 4], "little")
        # bytes that only look like the key are followed by a length that leads nowhere
        if at + 4 + n_text <= len(data):
            check_qos(data[at + 4 : at + 4 + n_text])
        at = data.find(_QOS_KEY, at)


MIN_READ_LIMIT = 1 << 30
"""So many bytes a file may be read to from its opening to its closing, and MAX_READ_RATIO times its size."""

MAX_READ_RATIO = 100
_SMALL = 1 << 16
_NOTHING_TO_SEE = 8
_RECORD_READ = 2


class CheckedPath:
    """A path, whose file never reads beyond its end."""

    def __init__(
        self,
        path: Path,
        look: Callable[[bytes], None] | None = None,
        rewrite: Callable[[int, bytes], bytes] | None = None,
    ) -> None:
        self._path = path
        self._look = look
        self._rewrite = rewrite

    def __str__(self) -> str:
        return str(self._path)

    def __getattr__(self, name: str) -> Any:
        return getattr(self._path, name)

    def open(self, *_: Any, **__: Any) -> BinaryIO:
        """Open the file for reading bytes, whatever mode is given."""
        return cast(BinaryIO, _CheckedFile(io.FileIO(self._path), self._look, self._rewrite))


class _CheckedFile(io.BufferedReader):
    def __init__(
        self, raw: io.FileIO, look: Callable[[bytes], None] | None, rewrite: Callable[[int, bytes], bytes] | None
    ) -> None:
        super().__init__(raw)
        self._look, self._rewrite = look, rewrite
        self._kind, self._n_since = 0, _RECORD_READ
        self._n_bytes = os.fstat(raw.fileno()).st_size
        self._n_left = MIN_READ_LIMIT + MAX_READ_RATIO * self._n_bytes

    def read(self, size: int | None = -1, /) -> bytes:
        if size is not None and size > _SMALL:
            size = max(0, min(size, self._n_bytes - self.tell()))
        data = super().read(size)
        self._n_left -= len(data)
        if self._n_left < 0:
            raise LogFormatError("its index leads to the same bytes again and again")
        if self._look is not None and len(data) > _NOTHING_TO_SEE:
            self._look(data)
        if self._rewrite is None:
            return data
        # the kind of a record in one byte, its length in eight, the record
        if size == 1 and data:
            self._kind, self._n_since = data[0], 0
        else:
            self._n_since += 1
            if self._n_since == _RECORD_READ:
                data = self._rewrite(self._kind, data)
        return data
