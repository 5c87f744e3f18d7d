"""Files made to harm: bombs, loops, lengths that are only claimed.

Each is refused in a sentence, at once and in little memory.
"""

from __future__ import annotations

import gzip
import io
import signal
import sqlite3
import struct
import tracemalloc
import warnings
import zipfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from curvescan.diagnostics.inspect import inspect_log
from curvescan.errors import InvalidArgumentError, LogFormatError
from curvescan.io import read_config, read_log, read_poses, read_relations, read_tum
from curvescan.io.ros.bags.hardening.limits import check_chunks
from curvescan.matchers.curvescan.config import CurvescanConfig
from tests import bags, bombs, carmen_files

MIB = 1 << 20
TOO_MUCH = r"bag.* that cannot be read: its chunks unpack to more than \d+ MiB, too much for their"


@pytest.fixture(autouse=True)
def _at_once() -> Iterator[None]:
    def too_late(*_: object) -> None:
        pytest.fail("does not come to an end")

    before = signal.signal(signal.SIGALRM, too_late)
    signal.alarm(60)  # on a busy machine a second becomes ten; what is meant here would take hours
    yield
    signal.alarm(0)
    signal.signal(signal.SIGALRM, before)


def peak_of(read: Callable[[], object]) -> int:
    """Return how many bytes a call takes at most, whatever becomes of it."""
    tracemalloc.start()
    try:
        read()
    except LogFormatError:
        pass
    finally:
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
    return peak


# ---- what unpacks to too much


@pytest.mark.parametrize("kind", ["bz2", "lz4"])
def test_chunk_of_a_ros1_bag(tmp_path: Path, kind: str) -> None:
    path = bombs.ros1_bag(tmp_path / "a.bag", kind, bombs.bomb(kind, 96))
    with pytest.raises(LogFormatError, match=TOO_MUCH):
        read_log(path)
    assert peak_of(lambda: read_log(path)) < 64 * MIB


@pytest.mark.parametrize("has_summary", [True, False])
@pytest.mark.parametrize("kind", ["zstd", "lz4"])
def test_chunk_of_an_mcap(tmp_path: Path, kind: str, has_summary: bool) -> None:
    path = bombs.mcap_bag(tmp_path / "bag", kind, bombs.bomb(kind, 96))
    if not has_summary:
        bombs.without_summary(path)
    with pytest.raises(LogFormatError, match=TOO_MUCH):
        read_log(path)
    assert peak_of(lambda: read_log(path)) < 64 * MIB


def test_second_frame_of_a_chunk(tmp_path: Path) -> None:
    chunk = bombs.bomb("zstd", 1) + b"\x50\x2a\x4d\x18\x04\x00\x00\x00abcd" + bombs.bomb("zstd", 64)
    for packed in (chunk, chunk[-len(bombs.bomb("zstd", 64)) - 12 :]):
        path = bombs.mcap_bag(tmp_path / f"bag{len(packed)}", "zstd", packed)
        with pytest.raises(LogFormatError, match=TOO_MUCH):
            read_log(path)


@pytest.mark.parametrize("n_bytes", [10 << 30, 1 << 62])
def test_chunk_that_only_claims(tmp_path: Path, n_bytes: int) -> None:
    frame = bombs.claim(n_bytes)
    for path in (bombs.ros1_bag(tmp_path / "a.bag", "lz4", frame), bombs.mcap_bag(tmp_path / "bag", "lz4", frame)):
        with pytest.raises(LogFormatError, match=TOO_MUCH):
            read_log(path)
        assert peak_of(lambda file=path: read_log(file)) < MIB  # type: ignore[misc]


def test_size_that_the_summary_claims(tmp_path: Path) -> None:
    path = bombs.mcap_bag(tmp_path / "bag", "zstd", bombs.bomb("zstd", 1), claimed=10 << 30)
    with pytest.raises(LogFormatError, match=r"chunks of more than 128 MiB lie over the same moment"):
        read_log(path)


def test_chunks_that_are_listed_twice() -> None:
    with pytest.raises(LogFormatError, match="lists a chunk twice"):
        check_chunks([_chunk(8), _chunk(8)], 1000)
    check_chunks([_chunk(8), _chunk(99)], 1000)
    with pytest.raises(LogFormatError, match="over the same moment"):
        check_chunks([_chunk(8), _chunk(99, 100 * MIB), _chunk(999, 100 * MIB)], 1000)
    check_chunks([_chunk(8, 100 * MIB), _chunk(99, 100 * MIB, start=6)], 1000)


def _chunk(offset: int, size: int = 10, start: int = 0) -> Any:
    class Chunk:
        message_start_time, message_end_time = start, start + 5
        chunk_start_offset, uncompressed_size = offset, size

    return Chunk


def test_whole_files_in_gzip(tmp_path: Path) -> None:
    text = carmen_files.flaser().encode() + b"\n"
    npz = io.BytesIO()
    np.savez(npz, stamps=np.arange(2.0), ranges=np.ones((2, 3)), angles=np.arange(3.0))
    bag = bags.storage(bags.write_bag(tmp_path / "bag", "mcap", [bags.scan(1)])).read_bytes()
    for i, head in enumerate((text, npz.getvalue(), bag, b"1 2 0 0 0 0 0 0\n")):
        path = tmp_path / f"{i}.gz"
        path.write_bytes(gzip.compress(head, mtime=0) + gzip.compress(PAD, 1, mtime=0))
        read = read_relations if i == 3 else read_log
        with pytest.raises(LogFormatError, match=r"unpacks to more than 64 MiB, too much for a log"):
            read(path)


PAD = bytes(70 * MIB)


def test_index_longer_than_the_file_can_hold(tmp_path: Path, monkeypatch: Any) -> None:
    path = bags.write_bag(tmp_path / "a.bag", "ros1", [bags.scan(i) for i in range(30)])
    assert len(read_log(path)) == 30
    monkeypatch.setattr("curvescan.io.ros.bags.hardening.limits.BYTES_A_MESSAGE", 1 << 20)
    monkeypatch.setattr("curvescan.io.ros.bags.hardening.limits.MIN_INDEX_LIMIT", 29)
    with pytest.raises(LogFormatError, match="index lists more messages than fit into a file"):
        read_log(path)


def test_index_that_leads_to_one_message(tmp_path: Path) -> None:
    path = bags.write_bag(tmp_path / "a.bag", "ros1", [bags.scan(1) for _ in range(300)])
    content = bytearray(path.read_bytes())
    # an entry of the index is seconds, nanoseconds (both as in the message), offset
    first = content.index(struct.pack("<LL", 0, 1) + content[_index_at(content) + 8 :][:4])
    for i in range(300):
        content[first + 12 * i + 8 : first + 12 * i + 12] = content[first + 8 : first + 12]
    path.write_bytes(content)
    log = read_log(path)
    assert len(log) == 101
    assert "damaged from here on" in log.read_errors[0].rule


def _index_at(content: bytearray) -> int:
    """Return where the entries of the only record of an index begin."""
    return content.index(b"op=\x04") + 4 + 4 + 8 + 4 + 9 + 4 + 10 + 4


def test_file_that_is_read_again_and_again(tmp_path: Path, monkeypatch: Any) -> None:
    path = bags.write_bag(tmp_path / "a.bag", "ros1", [bags.scan(i) for i in range(9)])
    monkeypatch.setattr("curvescan.io.ros.bags.hardening.limits.MIN_READ_LIMIT", 0)
    monkeypatch.setattr("curvescan.io.ros.bags.hardening.limits.MAX_READ_RATIO", 0)
    with pytest.raises(LogFormatError, match="leads to the same bytes again and again"):
        read_log(path)


def test_summary_of_a_small_file_that_unpacks(tmp_path: Path) -> None:
    path = bags.storage(bags.write_bag(tmp_path / "bag", "mcap", [bags.scan(1)]))
    content = path.read_bytes()
    (start,) = struct.unpack("<Q", content[-28:-20])
    # a record of an attachment index, long and empty, before the rest of the summary
    filler = b"\x0a" + struct.pack("<Q", 10 * MIB) + bytes(10 * MIB)
    packed = tmp_path / "a.gz"
    packed.write_bytes(gzip.compress(content[:start] + filler + content[start:], 1))
    # nothing of the summary is unpacked; the messages stand before it
    log = read_log(packed)
    assert len(log) == 1
    assert log.read_errors[0].rule.startswith("bag cut short: its end is missing")


def test_messages_longer_than_the_file_can_hold(tmp_path: Path, monkeypatch: Any) -> None:
    path = bags.write_bag(tmp_path / "a.bag", "ros1", [bags.scan(i) for i in range(30)])
    monkeypatch.setattr("curvescan.io.ros.bags.bag.MIN_UNPACKED_LIMIT", 1000)
    monkeypatch.setattr("curvescan.io.ros.bags.bag.MAX_UNPACKED_RATIO", 0)
    log = read_log(path)
    assert 0 < len(log) < 30
    assert "damaged from here on" in log.read_errors[0].rule


def test_message_too_long(tmp_path: Path) -> None:
    long = bags.scan(2, np.zeros(2_200_000, dtype=np.float32))
    log = read_log(bags.write_bag(tmp_path / "a.bag", "ros1", [bags.scan(1), long]))
    assert [f.rule for f in log.read_errors] == ["sensor_msgs/LaserScan message longer than 8 MiB"]


# ---- what never ends


@pytest.mark.parametrize("expression", ["(" * 9 + "1" + ")" * 9, "1" + "+1" * 600], ids=["brackets", "sum"])
def test_definition_that_keeps_its_parser_busy(tmp_path: Path, expression: str) -> None:
    text = f"module sensor_msgs {{ module msg {{ const long A = {expression}; }}; }};"
    _check_idl(tmp_path, text)


def test_definition_of_sequences_of_sequences(tmp_path: Path) -> None:
    text = "sequence<" * 40 + "long" + ">" * 40
    _check_idl(tmp_path, f"module sensor_msgs {{ module msg {{ struct A {{ {text} a; }}; }}; }};")


def _check_idl(tmp_path: Path, text: str) -> None:
    path = bags.storage(bags.write_bag(tmp_path / "bag", "sqlite3", [bags.scan()]))
    _change(path, "update message_definitions set encoding = 'ros2idl', encoded_message_definition = ?", text)
    log = read_log(path)
    assert len(log) == 1
    assert any("own definition of sensor_msgs/LaserScan cannot be understood" in n for n in log.notes)


BILLION = "- a0: &a0 {x: 1}\n" + "".join(
    f"- a{i}: &a{i} {{<<: [{', '.join([f'*a{i - 1}'] * 9)}]}}\n" for i in range(1, 12)
)


def test_yaml_that_multiplies(tmp_path: Path) -> None:
    path = bags.storage(bags.write_bag(tmp_path / "bag", "sqlite3", [bags.scan()]))
    _change(path, "update topics set offered_qos_profiles = ?", BILLION)
    with pytest.raises(LogFormatError, match="quality of service of a topic is not as recorders"):
        read_log(path)


@pytest.mark.parametrize("is_packed", [False, True])
@pytest.mark.parametrize("has_summary", [True, False])
def test_yaml_that_multiplies_in_mcap(tmp_path: Path, has_summary: bool, is_packed: bool) -> None:
    from rosbags.interfaces import Qos
    from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin, Writer
    from rosbags.rosbag2.storage_mcap import McapWriter

    writer = Writer(tmp_path / "bag", version=9, storage_plugin=StoragePlugin.MCAP)
    mode = CompressionMode.STORAGE if is_packed else CompressionMode.NONE
    writer.set_compression(mode, CompressionFormat.ZSTD)
    add = McapWriter.add_connection
    with writer:
        storage: Any = writer.storage
        storage.add_connection = lambda connection, _: add(storage, connection, BILLION)
        topic, msgtype, _, fields = bags.scan()
        qos: tuple[Qos, ...] = ()
        c = writer.add_connection(topic, msgtype, typestore=bags.ROS2, offered_qos_profiles=qos)
        writer.write(c, 1, bags.ROS2.serialize_cdr(bags.build(bags.ROS2, msgtype, fields), msgtype))
    path = bags.storage(tmp_path / "bag")
    if not has_summary:
        bombs.without_summary(path)
    with pytest.raises(LogFormatError, match="quality of service of a topic is not as recorders"):
        read_log(path)


def test_many_frames(tmp_path: Path) -> None:
    frames = [bags.transform(1, f"odom{i}", f"base_link{i}") for i in range(1500)]
    many = bags.transform(1, "a", "b")
    many[3]["transforms"] = [frame[3]["transforms"][0] for frame in frames]
    log = read_log(bags.write_bag(tmp_path / "a.bag", "ros1", [bags.scan(1), many]))
    assert log.odometry is not None
    assert len(log.notes) == 1


# ---- databases


def _change(path: Path, statement: str, *values: object) -> None:
    connection = sqlite3.connect(path)
    with connection:
        connection.execute(statement, values)
    connection.close()


@pytest.mark.parametrize(
    "statements",
    [
        ("drop table message_definitions", "create view message_definitions as with recursive a(n) as "
         "(select 1 union all select n + 1 from a) select n as id, n as topic_type, 'ros2msg' as encoding, '' as "
         "encoded_message_definition, '' as type_description_hash from a"),
        ("alter table messages rename to other", "create view messages as select * from other"),
        ("alter table messages rename column data to other", "alter table messages add column data blob "
         "generated always as (zeroblob(900000000))"),
        ("drop table message_definitions", "create virtual table message_definitions using fts5(topic_type)"),
    ],
    ids=["endless view", "view", "generated", "virtual"],
)  # fmt: skip
def test_database_that_is_a_program(tmp_path: Path, statements: tuple[str, ...]) -> None:
    path = bags.storage(bags.write_bag(tmp_path / "bag", "sqlite3", [bags.scan()]))
    for statement in statements:
        _change(path, statement)
    with pytest.raises(LogFormatError, match="are no plain table, as a recorder makes one"):
        read_log(path)


def test_database_of_too_many_topics(tmp_path: Path) -> None:
    path = bags.storage(bags.write_bag(tmp_path / "bag", "sqlite3", [bags.scan()]))
    _change(path, "insert into topics with recursive a(n) as (select 5 union all select n + 1 from a limit 5000) "
            "select n, '/t' || n, 'a/msg/B', 'cdr', '', '' from a")  # fmt: skip
    with pytest.raises(LogFormatError, match=r"it has 5,001 topics, and a bag at most 4,096"):
        read_log(path)


def test_page_count_that_is_only_claimed(tmp_path: Path) -> None:
    path = bags.storage(bags.write_bag(tmp_path / "bag", "sqlite3", [bags.scan()]))
    content = bytearray(path.read_bytes())
    content[28:32] = b"\xff" * 4
    path.write_bytes(content)
    log = read_log(path)
    assert len(log) == 1
    assert log.read_errors[0].rule.startswith("bag cut short: its end is missing")


def test_database_that_was_not_closed(tmp_path: Path) -> None:
    path = bags.storage(bags.write_bag(tmp_path / "bag", "sqlite3", [bags.scan()]))
    writer = sqlite3.connect(path)
    writer.execute("pragma journal_mode = wal")
    with writer:
        writer.execute("insert into messages select 9, topic_id, timestamp, data from messages")
    try:
        log = read_log(path)
        assert len(log) == 2
        assert any("was not closed: what stands in its -wal" in note for note in log.notes)
    finally:
        writer.close()
    assert len(read_log(path)) == 2


def test_database_that_another_program_writes(tmp_path: Path) -> None:
    path = bags.storage(bags.write_bag(tmp_path / "bag", "sqlite3", [bags.scan()]))
    writer = sqlite3.connect(path)
    try:
        writer.execute("begin exclusive")
        assert len(read_log(path)) == 1
    finally:
        writer.close()


def test_database_in_a_folder_that_cannot_be_written(tmp_path: Path) -> None:
    path = bags.storage(bags.write_bag(tmp_path / "bag", "sqlite3", [bags.scan()]))
    path.chmod(0o444)
    path.parent.chmod(0o555)
    try:
        before = sorted(path.parent.iterdir())
        assert len(read_log(path)) == 1
        assert sorted(path.parent.iterdir()) == before
    finally:
        path.parent.chmod(0o755)


# ---- what the campaign found


def test_names_that_cannot_be_printed(tmp_path: Path) -> None:
    odd = tmp_path / "a.log"
    odd.write_bytes(carmen_files.odom(1, 1, 1).encode() + b"\n\x00\x1b[2J a\n")
    with pytest.raises(LogFormatError, match=r"holds ODOM, \?\?\[2J$"):
        read_log(odd)
    odd.write_bytes(b"\x00\n" + carmen_files.flaser().encode())
    assert list(read_log(odd).tag_counts) == ["?", "FLASER"]
    odd.write_bytes(b"stamp,angle_min,\x1b" + b"a" * 999)
    with pytest.raises(LogFormatError, match=r"it holds stamp, angle_min, \?aa[a]*\.\.\.$"):
        read_log(odd)


def test_array_whose_header_is_deeply_nested(tmp_path: Path) -> None:
    path = tmp_path / "a.npz"
    header = b"-" * 3000 + b"{}"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("stamps.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header)
    with pytest.raises(LogFormatError, match=r"'stamps' does not begin like one that numpy.savez wrote"):
        read_log(path)


def test_rules_of_a_configuration_name_the_file(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text("[curvescan.segments]\narm = -1.0\n")
    with pytest.raises(InvalidArgumentError, match=r"a\.toml: \[curvescan\.segments\]: .*-1\.0"):
        read_config(path, {"curvescan": CurvescanConfig()})


@dataclass(frozen=True)
class PairConfig:
    """A list of fixed length."""

    pair: tuple[float, float] = (0.1, 0.2)


def test_list_of_another_length_in_a_configuration(tmp_path: Path) -> None:
    path = tmp_path / "a.toml"
    path.write_text("[a]\npair = [0.1]\n")
    with pytest.raises(InvalidArgumentError, match=r"pair must be a list of 2, got 1"):
        read_config(path, {"a": PairConfig()})


def test_angles_and_poses_of_1e308(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    head = "stamp,angle_min,angle_increment,x,y,theta,ranges\n"
    path.write_text(f"{head}1,0,1e308,0,0,0,1,2,3\n1e308,0,0.1,-1e308,0,0,1\n-1e308,0,0.1,1e308,0,0,1\n")
    log = read_log(path)
    (read_error,) = log.read_errors
    assert read_error.rule.startswith("the angles of 3 beams must be finite")
    report = inspect_log(log)
    assert report.odometry is not None
    assert report.odometry.path_length == np.inf


def test_signalling_nan_is_silent(tmp_path: Path) -> None:
    odd = np.array([0x7F800001] * 3, dtype=np.uint32).view(np.float32)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        (found,) = read_log(bags.write_bag(tmp_path / "a.bag", "ros1", [bags.scan(ranges=odd)]))
        assert np.isnan(found.ranges).all()
        np.savez(tmp_path / "a.npz", stamps=np.zeros(1), ranges=odd[None], angles=np.arange(3.0))
        (found,) = read_log(tmp_path / "a.npz")
    assert np.isnan(found.ranges).all()


# ---- arrays, texts


@pytest.mark.parametrize(
    ("n", "m", "kind", "order"), [(3_000_000, 0, "i1", "C"), (1, 3_000_000, "i1", "C"), (50, 1_000_000, "i1", "F")]
)
def test_arrays_that_pack_well(tmp_path: Path, n: int, m: int, kind: str, order: Any) -> None:
    path = tmp_path / "a.npz"
    ranges = np.zeros((n, m), dtype=kind, order=order)
    np.savez_compressed(path, stamps=np.zeros(n, dtype=kind), ranges=ranges, angle_min=0.0, angle_increment=1e-7)
    assert path.stat().st_size < 100_000
    with pytest.raises(LogFormatError, match=r"too many for a file|in Fortran's order and too large|damaged from"):
        read_log(path)
    assert peak_of(lambda: read_log(path)) < 16 * MIB


def test_texts_that_go_deep_or_wide(tmp_path: Path) -> None:
    path = tmp_path / "a"
    path.write_text("a = " + "[" * 9_000)
    with pytest.raises(InvalidArgumentError, match="is not a TOML file: maximum recursion"):
        read_config(path, {})
    path.write_text("a." * 9_000 + "a = 1")
    with pytest.raises(InvalidArgumentError, match=r"unknown key 'a'|not a TOML"):
        read_config(path, {})
    path.write_text("a" * 40_000)
    with pytest.raises(InvalidArgumentError, match="longer than 32,768 characters"):
        read_config(path, {})
    path.write_text(f"[a]\n{'b' * 9_000} = 1\n")
    with pytest.raises(InvalidArgumentError) as caught:
        read_config(path, {"a": CurvescanConfig()})
    assert len(str(caught.value)) < 500
    path.write_text(f"1 0 0 0 0 0 0 {'x' * 90_000}\n")
    with pytest.raises(LogFormatError) as error:
        read_tum(path)
    assert len(str(error.value)) < 500
    path.write_text(f"stamp,x,y,theta\n1,0,0,{'x' * 90_000}\n")
    with pytest.raises(LogFormatError) as error:
        read_poses(path)
    assert len(str(error.value)) < 500
