"""Bags whose chunks unpack to far more than they are, written for the tests of hostile files."""

from __future__ import annotations

import bz2
import struct
from pathlib import Path
from typing import Any

import lz4.frame
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.rosbag2.storage_mcap import zstd

from tests import bags

PIECE = bytes(1 << 20)


def bomb(kind: str, n_mib: int) -> bytes:
    """Return data that unpack to zeros."""
    makers: dict[str, Any] = {
        "bz2": bz2.BZ2Compressor,
        "zstd": zstd.ZstdCompressor,
        "lz4": lz4.frame.LZ4FrameCompressor,
    }
    packer = makers[kind]()
    pieces = [packer.begin()] if kind == "lz4" else []
    pieces += [packer.compress(PIECE) for _ in range(n_mib)]
    return b"".join([*pieces, packer.flush()])


def claim(n_bytes: int) -> bytes:
    """Return an lz4 frame whose head claims so many bytes."""
    frame = bytearray(lz4.frame.compress(b"a" * 1000, store_size=True))
    frame[6:14] = struct.pack("<Q", n_bytes)
    # the check sum of the head: second byte of its xxh32
    for check_sum in range(256):
        frame[14] = check_sum
        try:
            lz4.frame.get_frame_info(bytes(frame))
        except RuntimeError:
            continue
        return bytes(frame)
    raise AssertionError("no check sum fits")


def ros1_bag(path: Path, kind: str, chunk: bytes) -> Path:
    """Write a ROS 1 bag whose chunk is these data."""
    writer = Ros1Writer(path)
    writer.set_compression(Ros1Writer.CompressionFormat[kind.upper()])
    writer.compressor = lambda _: chunk
    _write(writer, bags.ROS1, bags.ROS1.serialize_ros1)
    return path


def mcap_bag(path: Path, kind: str, chunk: bytes, *, claimed: int | None = None) -> Path:
    """Write an MCAP file whose chunk is these data, and in whose summary it has a size of its own choice."""
    writer = Ros2Writer(path, version=8, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    writer.open()
    storage: Any = writer.storage
    storage.compressor, storage.compression = (lambda _: chunk), kind
    _write(writer, bags.ROS2, bags.ROS2.serialize_cdr, is_degenerate=True)
    file = bags.storage(path)
    if claimed is not None:
        content = file.read_bytes()
        # the last record that ends with name, packed size, size is that of the summary
        name = struct.pack("<I", len(kind)) + kind.encode() + struct.pack("<Q", len(chunk))
        at = content.rindex(name) + len(name)
        file.write_bytes(content[:at] + struct.pack("<Q", claimed) + content[at + 8 :])
    return file


def without_summary(file: Path) -> Path:
    """Make an MCAP file one whose reader goes through all records."""
    content = file.read_bytes()
    file.write_bytes(content[:-28] + bytes(8) + content[-20:])
    return file


def _write(writer: Any, store: Any, serialize: Any, *, is_degenerate: bool = False) -> None:
    topic, msgtype, _, fields = bags.scan()
    if not is_degenerate:
        writer.open()
    connection = writer.add_connection(topic, msgtype, typestore=store)
    for i in (1, 2):
        writer.write(connection, i, serialize(bags.build(store, msgtype, fields), msgtype))
    writer.close()
