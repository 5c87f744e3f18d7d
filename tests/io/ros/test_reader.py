"""RosbagLog: the three kinds of bags, their scans bit for bit, and one sentence for each that is broken."""

from __future__ import annotations

import gc
import gzip
import hashlib
import json
import math
import re
import shutil
import sqlite3
import tempfile
import tracemalloc
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.rosbag2.storage_sqlite3 import Sqlite3Reader
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

from curvescan.cli.main import run
from curvescan.diagnostics.inspect import inspect_log
from curvescan.errors import CurvescanError, InvalidArgumentError, LogFileError, LogFormatError
from curvescan.io import Log, read_log
from curvescan.io.files import lines as unpacking
from curvescan.io.ros.reader import BROKEN_BAG, CUT_BAG
from curvescan.io.ros.transforms import laser_mounts
from curvescan.runs.run import run as run_log
from tests.bags import (
    KINDS,
    RANGES,
    ROS1,
    ROS2,
    SECOND,
    Entry,
    build,
    chatter,
    odometry,
    quaternion,
    scan,
    storage,
    transform,
    write_bag,
)
from tests.scenes import room_scan

STAMP = 1_463_093_841_123_456_789
# a quiet NaN with a payload, the infinities, both zeros, a subnormal, a driver's code, and float32's 0.1
ODD = np.array(
    [0x7FC00ABC, 0xFFC00001, 0x7F800000, 0xFF800000, 0, 0x80000000, 1, 0x42A3D1EC, 0x3DCCCCCD], dtype=np.uint32
).view(np.float32)


@pytest.fixture(params=KINDS)
def kind(request: pytest.FixtureRequest) -> str:
    return str(request.param)


# ---- what is in a scan


def test_scan_has_what_its_message_says(tmp_path: Path, kind: str) -> None:
    log = read_log(write_bag(tmp_path / "bag", kind, [scan(STAMP, intensities=(7.0, 8.0, 9.0))]))
    (found,) = log
    assert isinstance(log, Log)
    assert (log.name, len(log), log.read_errors, log.odometry) == ("bag", 1, (), None)
    assert found.ranges.tolist() == list(RANGES)
    assert (found.angle_min, found.angle_increment) == (-1.0, 0.5)
    assert (found.range_min, found.range_max) == (0.125, 8.0)
    assert found.stamp == STAMP / 10**9  # correctly rounded: to the nearest float64
    assert found.intensities is not None
    assert found.intensities.tolist() == [7.0, 8.0, 9.0]


def test_readings_come_through_bit_for_bit(tmp_path: Path, kind: str) -> None:
    entry = scan(ranges=ODD, intensities=ODD)
    (found,) = read_log(write_bag(tmp_path / "bag", kind, [entry]))
    assert found.ranges.astype(np.float32).tobytes() == ODD.tobytes()
    assert found.intensities is not None
    assert found.intensities.astype(np.float32).tobytes() == ODD.tobytes()


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=10)
@given(bits=st.lists(st.integers(0, 2**32 - 1), max_size=40))
def test_any_bits_come_through(tmp_path: Path, kind: str, bits: list[int]) -> None:
    path = tmp_path / "bag"
    shutil.rmtree(path, ignore_errors=True)
    path.unlink(missing_ok=True)
    ranges = np.array(bits, dtype=np.uint32).view(np.float32)
    (found,) = read_log(write_bag(path, kind, [scan(ranges=ranges)]))
    back = found.ranges.astype(np.float32)
    is_nan = np.isnan(ranges)  # a signalling NaN becomes a quiet one when it is converted
    assert np.array_equal(np.isnan(back), is_nan)
    assert back[~is_nan].tobytes() == ranges[~is_nan].tobytes()


@pytest.mark.parametrize("intensities", [(), (1.0, 2.0)])
def test_intensities_of_another_number_are_left_out(tmp_path: Path, kind: str, intensities: tuple[float, ...]) -> None:
    (found,) = read_log(write_bag(tmp_path / "bag", kind, [scan(intensities=intensities)]))
    assert found.intensities is None


def test_scans_keep_their_order_and_their_stamps(tmp_path: Path, kind: str) -> None:
    stamps = [5 * SECOND, 3 * SECOND, 3 * SECOND, 4 * SECOND]
    entries = [scan(stamp, received=i) for i, stamp in enumerate(stamps)]
    log = read_log(write_bag(tmp_path / "bag", kind, entries))
    assert [s.stamp for s in log] == [s.stamp for s in log] == [5.0, 3.0, 3.0, 4.0]


def test_range_max_of_the_caller_holds(tmp_path: Path, kind: str) -> None:
    path = write_bag(tmp_path / "bag", kind, [scan(range_max=0.0)])
    with pytest.raises(LogFormatError, match="range limits must satisfy 0 <= range_min < range_max"):
        read_log(path)
    assert [s.range_max for s in read_log(path, range_max=3.0)] == [3.0]


def test_beam_counts_may_change_and_be_zero(tmp_path: Path, kind: str) -> None:
    entries = [scan(1, ranges=[1.0] * n) for n in (3, 0, 5)]
    assert [len(s) for s in read_log(write_bag(tmp_path / "bag", kind, entries))] == [3, 0, 5]


@pytest.mark.parametrize(
    ("fields", "rule"),
    [
        ({"angle_increment": 0.0}, "angle_increment must not be 0"),
        ({"angle_increment": math.nan}, "angle_increment must be finite, got nan"),
        ({"angle_min": math.inf}, "angle_min must be finite, got inf"),
        ({"angle_min": -90.0, "angle_increment": 0.5}, "angles must be radians: 3 beams from angle_min=-90 in steps"),
        ({"range_min": 9.0}, "range limits must satisfy 0 <= range_min < range_max, got range_min=9"),
        ({"range_min": -1.0}, "range limits must satisfy 0 <= range_min < range_max, got range_min=-1"),
        (
            {"range_max": math.nan},
            "range limits must satisfy 0 <= range_min < range_max, got range_min=0.125, range_max=nan",
        ),
    ],
)
def test_nonsense_header_is_a_fault_and_not_fatal(tmp_path: Path, fields: dict[str, float], rule: str) -> None:
    entries = [scan(1), scan(2, **fields), scan(3), scan(4, **fields)]
    log = read_log(write_bag(tmp_path / "bag", "mcap", entries))
    (read_error,) = log.read_errors
    assert read_error.rule.startswith(f"LaserScan message: {rule}")
    assert (read_error.count, read_error.first) == (2, "message 2")
    assert len(log) == len(list(log)) == 2


def test_message_that_cannot_be_decoded_is_a_fault(tmp_path: Path) -> None:
    path = tmp_path / "a.bag"
    with Ros1Writer(path) as writer:
        connection = writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=ROS1)
        entry = scan()
        data = bytes(ROS1.serialize_ros1(build(ROS1, entry[1], entry[3]), entry[1]))
        # whole, cut short, a count of ranges beyond the end, something behind it
        n = len(data) - 4 * len(RANGES) - 8
        beyond = data[:n] + b"\xff\xff\xff\x7f" + data[n + 4 :]
        for i, content in enumerate((data, data[:30], b"", beyond, data + b"more")):
            writer.write(connection, i, content)
    log = read_log(path)
    (read_error,) = log.read_errors
    assert read_error.rule == "sensor_msgs/LaserScan message that cannot be decoded"
    assert (read_error.count, read_error.first, len(log)) == (4, "message 2", 1)


@pytest.mark.parametrize("magic", [b"\x28\xb5\x2f\xfd", b"\x00\x00\x00\x00"])
def test_no_message_that_can_be_decoded(tmp_path: Path, magic: bytes) -> None:
    path = storage(write_bag(tmp_path / "bag", "sqlite3", [scan(1), scan(2)]))
    with sqlite3.connect(path) as connection:
        connection.execute("update messages set data = ?", (magic + b"junk",))
    connection.close()
    sentence = "without a scan that can be read on topic /scan: .*cannot be decoded"
    sentence += ".*zstd.*convert" if magic[0] else r" \(2 times"
    with pytest.raises(LogFormatError, match=sentence):
        read_log(path)


def test_scans_without_stamps_get_the_time_of_reception(tmp_path: Path, kind: str) -> None:
    entries = [scan(0, received=7 * SECOND), scan(0, received=8 * SECOND)]
    log = read_log(write_bag(tmp_path / "bag", kind, entries))
    assert [s.stamp for s in log] == [7.0, 8.0]
    assert any("not stamped" in note for note in log.notes)


def test_a_clock_that_starts_at_zero_is_believed(tmp_path: Path, kind: str) -> None:
    entries = [scan(0, received=7 * SECOND), scan(SECOND, received=8 * SECOND)]
    log = read_log(write_bag(tmp_path / "bag", kind, entries))
    assert [s.stamp for s in log] == [0.0, 1.0]
    assert log.notes == ()


# ---- topics


def two_lasers(path: Path, kind: str) -> Path:
    front = [scan(i, topic="/front/scan") for i in range(1, 4)]
    rear = [scan(i, [9.0], topic="/rear/scan") for i in range(1, 3)]
    return write_bag(path, kind, [*front, *rear, chatter()])


def test_several_topics_are_listed_with_counts(tmp_path: Path, kind: str) -> None:
    path = two_lasers(tmp_path / "bag", kind)
    sentence = r"2 topics: /front/scan \(3 scans\), /rear/scan \(2 scans\); choose one with topic='/front/scan'"
    with pytest.raises(InvalidArgumentError, match=sentence):
        read_log(path)


@pytest.mark.parametrize("topic", ["/rear/scan", "rear/scan"])
def test_topic_chooses(tmp_path: Path, kind: str, topic: str) -> None:
    log = read_log(two_lasers(tmp_path / "bag", kind), topic=topic)
    assert [s.ranges.tolist() for s in log] == [[9.0]] * 2
    assert log.notes == ("laser scans on /front/scan are not read: the topic is another",)
    assert dict(log.tag_counts) == {
        "/front/scan (sensor_msgs/LaserScan)": 3,
        "/rear/scan (sensor_msgs/LaserScan)": 2,
        "/chatter (std_msgs/String)": 1,
    }


def test_unknown_topic_names_the_nearest(tmp_path: Path, kind: str) -> None:
    path = two_lasers(tmp_path / "bag", kind)
    with pytest.raises(InvalidArgumentError, match=r"no topic '/raer/scan'.*nearest is /rear/scan"):
        read_log(path, topic="/raer/scan")
    with pytest.raises(InvalidArgumentError, match=r"topic /chatter of .* holds std_msgs/String"):
        read_log(path, topic="/chatter")


def test_bag_without_a_laser_says_what_it_has(tmp_path: Path, kind: str) -> None:
    path = write_bag(tmp_path / "bag", kind, [chatter(), chatter()])
    sentence = r"without a laser scan: .*holds /chatter \(2 std_msgs/String\)"
    with pytest.raises(LogFormatError, match=sentence):
        read_log(path)


def test_empty_bag(tmp_path: Path, kind: str) -> None:
    with pytest.raises(LogFormatError, match=r"without a laser scan: .*holds no topic"):
        read_log(write_bag(tmp_path / "bag", kind, []))


def test_names_that_would_spoil_the_terminal_are_shown_without(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", "ros1", [scan(), chatter(topic="/[bold]\x1b[2J")])
    assert list(read_log(path).tag_counts)[1] == "/?bold???2J (std_msgs/String)"


@pytest.mark.parametrize("command", ["info", "odometry", "match"])
def test_commands_take_a_topic(tmp_path: Path, kind: str, command: str, capsys: pytest.CaptureFixture[str]) -> None:
    path = str(two_lasers(tmp_path / "bag", kind))
    more = {"info": [], "odometry": ["--out"], "match": ["0", "1", "--out"]}[command]
    arguments = [command, path, *more, *([str(tmp_path / "out")] if more else [])]
    assert run(arguments) == 1
    assert "choose one with --topic /front/scan" in capsys.readouterr().err
    if command == "info":
        assert run([*arguments, "--topic", "/front/scan"]) == 0
        assert "3 /front/scan (sensor_msgs/LaserScan)" in capsys.readouterr().out
    else:
        assert run([*arguments, "--topic", "/nowhere"]) == 1
        assert "the nearest is" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("storage_kind", ["sqlite3", "mcap"])
def test_odometry_of_a_folder_whose_odometry_has_gaps(tmp_path: Path, storage_kind: str) -> None:
    rng = np.random.default_rng(5)
    scans = [scan(int(t * SECOND), rng.uniform(1.0, 5.0, 40)) for t in (0.5, 1.5, 2.5, 3.5)]
    other = scan(SECOND, topic="/other")
    path = write_bag(tmp_path / "bag", storage_kind, [*scans, *drive("topic"), other])
    out = tmp_path / "out"
    # scans of nothing in common: written, and not to be trusted
    assert run(["odometry", str(path), "--topic", "/scan", "--out", str(out)]) == 3
    record = json.loads((out / "run.json").read_text())["input"]
    file = storage(path)
    digest = hashlib.sha256(file.read_bytes()).hexdigest()
    assert record["files"] == {file.name: {"bytes": file.stat().st_size, "sha256": digest}}
    assert record["scans"] == 4
    # three readings match nothing
    assert run(["match", str(path), "0", "1", "--topic", "/scan", "--out", str(tmp_path / "m")]) == 3


# ---- message definitions


def test_definitions_that_the_bag_lacks_are_bundled(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", "sqlite3", [scan()])
    with sqlite3.connect(storage(path)) as connection:
        connection.execute("delete from message_definitions")
    connection.close()
    assert len(read_log(path)) == 1


def bag_with_definition(path: Path, definition: str) -> Path:
    with Ros1Writer(path) as writer:
        connection = writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", msgdef=definition, md5sum="0" * 32)
        entry = scan()
        data = ROS1.serialize_ros1(build(ROS1, entry[1], entry[3]), entry[1])
        writer.write(connection, 1, data)
    return path


@pytest.mark.parametrize("definition", ["*", "this is no definition\n", "float32 x\n" * 9999])
def test_definition_that_cannot_be_understood_is_replaced(tmp_path: Path, definition: str) -> None:
    log = read_log(bag_with_definition(tmp_path / "a.bag", definition))
    assert len(log) == 1
    assert any("own definition of sensor_msgs/LaserScan" in note for note in log.notes)


def test_empty_definition_is_none(tmp_path: Path) -> None:
    log = read_log(bag_with_definition(tmp_path / "a.bag", ""))
    assert (len(log), log.notes) == (1, ())


def test_definition_of_the_bag_is_used_where_it_differs(tmp_path: Path) -> None:
    store = get_typestore(Stores.EMPTY)
    bundled = {
        name: definition for name, definition in ROS2.fielddefs.items() if name.startswith(("std_msgs", "builtin"))
    }
    store.register(bundled)
    text = """std_msgs/Header header
        float64 range_max
        float64 range_min
        float64 angle_increment
        float64 angle_min
        float64[] intensities
        float64[] ranges"""
    store.register(get_types_from_msg(text, "sensor_msgs/msg/LaserScan"))
    path = write_bag(tmp_path / "bag", "mcap", [scan()], typestore=store)
    (found,) = read_log(path)
    assert found.ranges.tolist() == list(RANGES)
    assert (found.angle_min, found.range_max) == (-1.0, 8.0)


IDL = """module sensor_msgs { module msg { struct LaserScan {
    float angle_min; float angle_increment; float range_min; float range_max;
    sequence<float> ranges; sequence<float> intensities;
}; }; };
"""


@pytest.mark.parametrize("start", ["", "=" * 80 + "\nIDL: sensor_msgs/msg/LaserScan\n"])
def test_definition_in_idl(tmp_path: Path, start: str) -> None:
    path = write_bag(tmp_path / "bag", "sqlite3", [scan()])
    with sqlite3.connect(storage(path)) as connection:
        connection.execute(
            "update message_definitions set encoding = 'ros2idl', encoded_message_definition = ?", (start + IDL,)
        )
    connection.close()
    # the definition is understood, and has no header: the messages do not follow it
    with pytest.raises(LogFormatError, match=r"cannot be decoded|without the usual fields"):
        read_log(path)


def test_definition_without_the_usual_fields(tmp_path: Path) -> None:
    store = get_typestore(Stores.EMPTY)
    store.register(get_types_from_msg("float64 x", "sensor_msgs/msg/LaserScan"))
    entry: Entry = ("/scan", "sensor_msgs/msg/LaserScan", 1, {"x": 1.0})
    path = write_bag(tmp_path / "bag", "mcap", [entry, entry], typestore=store)
    with pytest.raises(LogFormatError, match=r"without the usual fields \(2 times"):
        read_log(path)


# ---- files and folders


def test_the_file_in_a_folder_is_read_by_itself(tmp_path: Path, kind: str) -> None:
    path = storage(write_bag(tmp_path / "bag", kind, [scan(), scan()]))
    assert len(read_log(path)) == 2
    other = path.rename(tmp_path / "any #%3f?name")  # the name never decides, nor does it break a URI
    assert len(read_log(other)) == 2


@pytest.mark.parametrize("has_metadata", [True, False])
@pytest.mark.parametrize("storage_kind", ["sqlite3", "mcap"])
def test_folder_of_a_compressed_storage(tmp_path: Path, storage_kind: str, has_metadata: bool) -> None:
    path = write_bag(tmp_path / "bag", storage_kind, [scan(), scan()])
    file = storage(path)
    (path / f"{file.name}.gz").write_bytes(gzip.compress(file.read_bytes()))
    file.unlink()
    if not has_metadata:
        (path / "metadata.yaml").unlink()
    assert len(read_log(path)) == 2


@pytest.mark.parametrize("storage_kind", ["sqlite3", "mcap"])
def test_files_of_a_split_bag_follow_each_other(tmp_path: Path, storage_kind: str) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    for number in (0, 1, 2, 10):
        part = write_bag(tmp_path / f"part{number}", storage_kind, [scan(SECOND * number + 1)] * 2)
        file = storage(part)
        shutil.copy(file, folder / f"bag_{number}{file.suffix}")
    log = read_log(folder)
    assert [round(s.stamp) for s in log] == [0, 0, 1, 1, 2, 2, 10, 10]
    assert dict(log.tag_counts) == {"/scan (sensor_msgs/LaserScan)": 8}


@pytest.mark.parametrize("broken", [0, 1, 2])
@pytest.mark.parametrize("n_bytes", [0, 8, 100, 600])
@pytest.mark.parametrize("storage_kind", ["sqlite3", "mcap"])
def test_a_part_of_a_split_bag_without_a_whole_message_is_left_out(
    tmp_path: Path, storage_kind: str, n_bytes: int, broken: int
) -> None:
    folder = tmp_path / "bag"
    folder.mkdir()
    for number in range(3):
        file = storage(write_bag(tmp_path / f"part{number}", storage_kind, [scan(SECOND * number + 1)] * 2))
        part = folder / f"bag_{number}{file.suffix}"
        part.write_bytes(file.read_bytes()[: n_bytes if number == broken else None])
    log = read_log(folder)
    assert [round(s.stamp) for s in log] == [k for k in (0, 0, 1, 1, 2, 2) if k != broken]
    assert [(e.rule, e.is_end) for e in log.read_errors] == [(CUT_BAG, True)]
    assert f"no message of bag_{broken}{part.suffix} can be read: this file is left out" in log.notes
    for file in folder.iterdir():
        file.write_bytes(file.read_bytes()[:100])
    with pytest.raises(LogFormatError, match=r"bag.* that cannot be read: "):
        read_log(folder)


def test_folder_of_several_bags(tmp_path: Path) -> None:
    for name in ("one", "two"):
        shutil.copy(storage(write_bag(tmp_path / name, "mcap", [scan()])), tmp_path / f"{name}.mcap")
    sentence = r"several bags: give one of them \(one.mcap, two.mcap\)"
    with pytest.raises(LogFormatError, match=sentence):
        read_log(tmp_path)


def test_folder_whose_storage_is_gone(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", "mcap", [scan()])
    storage(path).unlink()
    with pytest.raises(LogFileError, match=r"by its metadata.yaml, without a storage file"):
        read_log(path)


def test_compressed_bag_leaves_nothing_behind(tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    packed = tmp_path / "bag.gz"
    packed.write_bytes(gzip.compress(storage(write_bag(tmp_path / "bag", kind, [scan()])).read_bytes()))
    temporary = tmp_path / "temporary"
    temporary.mkdir()
    monkeypatch.setattr(tempfile, "tempdir", str(temporary))
    log = read_log(packed)
    assert len(list(log)) == len(list(log)) == 1
    assert len(list(temporary.iterdir())) == 1
    del log
    gc.collect()
    assert list(temporary.iterdir()) == []


def test_gzip_bomb_is_refused(tmp_path: Path, kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    packed = tmp_path / "bag.gz"
    content = storage(write_bag(tmp_path / "bag", kind, [scan()])).read_bytes()
    packed.write_bytes(gzip.compress(content + bytes(20_000_000)))
    monkeypatch.setattr(unpacking, "MIN_UNPACKED_LIMIT", 1 << 20)
    with pytest.raises(LogFormatError, match=r"unpacks to more than .* MiB, too much for a log"):
        read_log(packed)


def test_compressed_bag_without_its_check_sum_is_read(tmp_path: Path, kind: str) -> None:
    packed = tmp_path / "bag.gz"
    content = storage(write_bag(tmp_path / "bag", kind, [scan()])).read_bytes()
    packed.write_bytes(gzip.compress(content)[:-8])
    log = read_log(packed)
    assert len(log) == 1
    assert "compressed data break off" in log.notes[0]


def write_three(writer: Any, store: Any, serialize: Any) -> None:
    """Write the same scan three times."""
    entry = scan()
    data = serialize(build(store, entry[1], entry[3]), entry[1])
    with writer:
        connection = writer.add_connection(entry[0], entry[1], typestore=store)
        for i in range(3):
            writer.write(connection, i, data)


@pytest.mark.parametrize("compression", Ros1Writer.CompressionFormat)
def test_ros1_bag_with_compressed_chunks(tmp_path: Path, compression: Ros1Writer.CompressionFormat) -> None:
    path = tmp_path / "a.bag"
    writer = Ros1Writer(path)
    writer.set_compression(compression)
    write_three(writer, ROS1, ROS1.serialize_ros1)
    assert [s.ranges.tolist() for s in read_log(path)] == [list(RANGES)] * 3


@pytest.mark.parametrize("mode", [CompressionMode.STORAGE, CompressionMode.NONE])
def test_mcap_with_and_without_compressed_chunks(tmp_path: Path, mode: CompressionMode) -> None:
    writer = Ros2Writer(tmp_path / "bag", version=8, storage_plugin=StoragePlugin.MCAP)
    writer.set_compression(mode, CompressionFormat.ZSTD)
    write_three(writer, ROS2, ROS2.serialize_cdr)
    assert [s.ranges.tolist() for s in read_log(tmp_path / "bag")] == [list(RANGES)] * 3


# ---- broken bags


def test_bag_cut_anywhere_is_a_log_or_a_sentence(tmp_path: Path, kind: str) -> None:
    content = storage(write_bag(tmp_path / "bag", kind, [scan(i) for i in range(1, 20)])).read_bytes()
    path = tmp_path / "cut"
    for n_bytes in [*range(16, 200, 7), *range(200, len(content), len(content) // 60)]:
        path.write_bytes(content[:n_bytes])
        assert_log_or_sentence(path)


def assert_log_or_sentence(path: Path) -> None:
    try:
        log = read_log(path)
        n_scans = len(list(log))
        assert n_scans == len(log) > 0
        assert log.odometry is None or len(log.odometry) == n_scans
        assert isinstance(log.notes, tuple)
    except CurvescanError as error:
        sentence = str(error)
    else:
        sentence = str(path)
    assert "\n" not in sentence
    assert str(path) in sentence


@pytest.mark.parametrize("kind_name", ["ros1", "sqlite3", "mcap"])
@pytest.mark.parametrize("share", [0.3, 0.6, 0.9])
def test_a_bag_cut_short_is_read_up_to_the_break(tmp_path: Path, kind_name: str, share: float) -> None:
    messages = [scan(i, ranges=[1.0 + 0.001 * i] * 361) for i in range(1, 200)]
    whole = write_bag(tmp_path / "whole", kind_name, messages)
    scans = list(read_log(whole))
    path = storage(whole)
    content = path.read_bytes()
    path.write_bytes(content[: int(share * len(content))])
    log = read_log(whole)
    left = list(log)
    assert (share - 0.1) * len(scans) < len(left) <= len(scans)
    for k, one in enumerate(left):
        np.testing.assert_array_equal(one.ranges, scans[k].ranges)
        assert one.stamp == scans[k].stamp
    assert [(e.rule, e.count) for e in log.read_errors] == [(CUT_BAG, 1)]
    np.testing.assert_array_equal(log[len(left) - 1].ranges, left[-1].ranges)
    # metadata.yaml knows to the scan; without it a bag of ROS 1 and a database say how long they were
    if kind_name != "ros1":
        assert log.n_recorded() == len(scans)
    whole = storage(whole).rename(tmp_path / "alone")
    expected = len(left) if kind_name == "mcap" else pytest.approx(len(scans), rel=0.2)
    assert read_log(whole).n_recorded() == expected


@pytest.mark.parametrize("n_bytes", range(150_000, 158_192, 630))
def test_a_database_cut_within_a_page_gives_no_scan_that_was_not_in_it(tmp_path: Path, n_bytes: int) -> None:
    messages = [scan(i, ranges=[1.0 + 0.001 * i] * 361) for i in range(1, 200)]
    path = storage(write_bag(tmp_path / "bag", "sqlite3", messages))
    scans = list(read_log(tmp_path / "bag"))
    path.write_bytes(path.read_bytes()[:n_bytes])
    left = list(read_log(tmp_path / "bag"))
    assert left
    for k, one in enumerate(left):
        np.testing.assert_array_equal(one.ranges, scans[k].ranges)


@pytest.mark.parametrize(("kind_name", "n_bytes"), [("ros1", 4500), ("mcap", 60)])
def test_a_bag_cut_before_its_first_message(tmp_path: Path, kind_name: str, n_bytes: int) -> None:
    path = storage(write_bag(tmp_path / "bag", kind_name, [scan(i) for i in range(1, 50)]))
    path.write_bytes(path.read_bytes()[:n_bytes])
    with pytest.raises(LogFormatError, match=r"bag.* that cannot be read: "):
        read_log(path)


def test_ros1_bag_whose_recorder_was_killed_has_no_index(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag.active", "ros1", [scan(i) for i in range(1, 20)])
    content = bytearray(path.read_bytes())
    at = content.index(b"index_pos=") + len(b"index_pos=")
    content[at : at + 8] = bytes(8)
    path.write_bytes(content)
    assert len(list(read_log(path))) == 19


def test_a_database_that_was_not_closed_is_read_with_its_wal(tmp_path: Path) -> None:
    messages = [scan(i) for i in range(1, 40)]
    bag = write_bag(tmp_path / "bag", "sqlite3", messages)
    scans, path = list(read_log(bag)), storage(bag)
    database = sqlite3.connect(path)
    rows = database.execute("select * from messages order by id").fetchall()
    database.execute("pragma journal_mode=wal")
    database.execute("pragma wal_autocheckpoint=0")
    database.execute("delete from messages where id > 20")
    database.commit()
    database.execute("pragma wal_checkpoint(truncate)")
    database.executemany("insert into messages values (?, ?, ?, ?)", rows[20:])
    database.commit()
    wal = path.with_name(path.name + "-wal")
    left = {file: file.read_bytes() for file in (path, wal)}
    database.close()  # which would take it in
    for file, content in left.items():
        file.write_bytes(content)
    log = read_log(bag)
    assert len(list(log)) == len(scans)
    assert any("-wal or -journal file is read as well" in note for note in log.notes)
    assert {file: file.read_bytes() for file in left} == left
    wal.write_bytes(b"\xff" * 200)  # of which nothing is of use
    assert len(list(read_log(bag))) == 20


def test_damaged_schema_is_one_line(tmp_path: Path) -> None:
    path = storage(write_bag(tmp_path / "bag", "sqlite3", [scan()]))
    path.write_bytes(path.read_bytes().replace(b"CREATE TABLE messages", b"CREATE T\x1b[2J messages"))
    with pytest.raises(LogFormatError, match="malformed database schema") as caught:
        read_log(path)
    assert str(caught.value).isprintable()


@pytest.mark.parametrize("value", ["null", "7", "'text'"])
@pytest.mark.parametrize("column", ["messages.timestamp", "messages.data", "topics.name", "topics.type"])
def test_database_with_values_of_other_types(tmp_path: Path, column: str, value: str) -> None:
    path = storage(write_bag(tmp_path / "bag", "sqlite3", [scan(1), scan(2), chatter()]))
    table, _, name = column.partition(".")
    with sqlite3.connect(path) as connection:
        (declaration,) = connection.execute("select sql from sqlite_master where name = ?", (table,)).fetchone()
        free = declaration.replace("NOT NULL", "")
        connection.execute("pragma writable_schema = on")
        connection.execute("update sqlite_master set sql = ? where name = ?", (free, table))
    connection.close()
    with sqlite3.connect(path) as connection:
        connection.execute(f"update {table} set {name} = {value} where id = 2")
    connection.close()
    assert_log_or_sentence(path)
    assert len(list(read_log(path).tag_counts)) >= 1


def test_messages_of_a_topic_that_was_not_asked_for_are_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A damaged table gives two topics one number, and rosbags takes the messages for those of the other one."""
    path = storage(write_bag(tmp_path / "bag", "sqlite3", [scan(1), scan(2)]))
    genuine = Sqlite3Reader.messages

    def mistaken(reader, *args, **kwargs):
        for connection, received, data in genuine(reader, *args, **kwargs):
            yield connection._replace(topic=None, msgtype=None), received, data

    monkeypatch.setattr(Sqlite3Reader, "messages", mistaken)
    with pytest.raises(LogFormatError, match="without a scan that can be read on topic /scan"):
        read_log(path)


def test_ros1_bag_of_another_version(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "a.bag", "ros1", [scan()])
    path.write_bytes(path.read_bytes().replace(b"#ROSBAG V2.0", b"#ROSBAG V1.2"))
    with pytest.raises(LogFormatError, match="version 102 is not supported"):
        read_log(path)


def test_mcap_of_another_profile(tmp_path: Path) -> None:
    # its channels say how they are encoded; more in test_mcap_profiles.py
    path = storage(write_bag(tmp_path / "bag", "mcap", [scan()]))
    path.write_bytes(path.read_bytes().replace(b"ros2", b"ros9", 1))
    assert len(read_log(path)) == 1


def test_damage_in_the_middle_keeps_what_stands_before(tmp_path: Path) -> None:
    path = tmp_path / "a.bag"
    write_bag(path, "ros1", [scan(i, [1.0] * 50_000) for i in range(1, 30)])
    content = bytearray(path.read_bytes())
    third = [i for i in range(len(content) - 5) if content[i : i + 5] == b"conn="][15]
    content[third - 4 : third + 5] = b"\xff" * 9
    path.write_bytes(content)
    log = read_log(path)
    assert 0 < len(list(log)) == len(log) < 29
    assert [read_error.rule for read_error in log.read_errors] == [BROKEN_BAG]


@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=40)
@given(data=st.data())
def test_flipped_bytes_give_a_log_or_a_sentence(tmp_path: Path, kind: str, data: st.DataObject) -> None:
    source = tmp_path / "bag"
    if not source.exists():
        entries = [scan(1), transform(1, "odom", "base_link"), odometry(1, (0, 0, 0)), scan(2)]
        write_bag(source, kind, entries)
    content = bytearray(storage(source).read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        content[data.draw(st.integers(16, len(content) - 1))] = data.draw(st.integers(0, 255))
    path = tmp_path / "flipped"
    path.write_bytes(content)
    assert_log_or_sentence(path)


@pytest.mark.parametrize("length", [1 << 28, 1 << 62])
@pytest.mark.parametrize("kind_name", ["ros1", "mcap"])
def test_length_that_is_only_claimed_takes_no_memory(tmp_path: Path, kind_name: str, length: int) -> None:
    path = storage(write_bag(tmp_path / "bag", kind_name, [scan(i) for i in range(1, 5)]))
    sound = path.read_bytes()
    list(read_log(path))  # imports and caches
    n_bytes = 4 if length < 1 << 32 else 8
    for at in range(16, len(sound) - 8, 41):
        content = bytearray(sound)
        content[at : at + n_bytes] = length.to_bytes(n_bytes, "little")
        path.write_bytes(content)
        tracemalloc.start()
        assert_log_or_sentence(path)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert peak < 4 << 20


def test_file_that_vanishes(tmp_path: Path, kind: str) -> None:
    path = storage(write_bag(tmp_path / "bag", kind, [scan()]))
    log = read_log(path)
    path.unlink()
    with pytest.raises(CurvescanError, match="bag"):
        list(log)


# ---- memory


def test_memory_does_not_grow_with_the_bag(tmp_path: Path, kind: str) -> None:
    def peak_of(n_scans: int) -> int:
        entries = (scan(i, [1.0 + i % 7] * 2000) for i in range(1, n_scans + 1))
        path = write_bag(tmp_path / f"bag{n_scans}", kind, entries)
        for _ in read_log(path):  # imports and caches
            break
        gc.collect()
        tracemalloc.start()
        log = read_log(path)
        n_read = sum(1 for _ in log)
        peak = tracemalloc.get_traced_memory()[1]
        tracemalloc.stop()
        assert n_read == len(log) == n_scans
        return peak

    small, large = peak_of(400), peak_of(2200)  # 3 MB and 18 MB
    # the index of a ROS 1 bag takes some 150 bytes a message; a scan here has 8,000
    assert large < small + 1800 * 400


# ---- odometry

MOUNT = (0.5, 0.25, math.pi / 2)


def drive(source: str) -> list[Entry]:
    """Return odometry at 1, 2 and 3 s: one metre ahead, then half a turn through pi on the spot."""
    poses = [(0.0, 0.0, 3.0), (1.0, 0.0, 3.0), (1.0, 0.0, 3.0 - 2 * math.pi + 0.5)]
    if source == "topic":
        return [odometry((i + 1) * SECOND, pose) for i, pose in enumerate(poses)]
    return [transform((i + 1) * SECOND, "odom", "base_link", pose) for i, pose in enumerate(poses)]


def laser_at(x: float, y: float, theta: float, mount: tuple[float, float, float]) -> list[float]:
    dx, dy, turn = mount
    angle = math.remainder(theta + turn, 2 * math.pi)
    cos, sin = math.cos(theta), math.sin(theta)
    return [x + cos * dx - sin * dy, y + sin * dx + cos * dy, angle]


@pytest.mark.parametrize("source", ["topic", "transforms"])
@pytest.mark.parametrize("mount_topic", ["/tf", "/tf_static"])
def test_odometry_is_interpolated_and_carried_to_the_laser(
    tmp_path: Path, kind: str, source: str, mount_topic: str
) -> None:
    scans = [scan(int(t * SECOND)) for t in (0.5, 1.0, 1.5, 2.5, 3.5)]
    mount = transform(SECOND, "base_link", "laser", MOUNT, topic=mount_topic)
    log = read_log(write_bag(tmp_path / "bag", kind, [*scans, *drive(source), mount]))
    odometry_of_log = log.odometry
    assert odometry_of_log is not None
    poses = odometry_of_log.poses
    assert odometry_of_log.stamps.tolist() == [0.5, 1.0, 1.5, 2.5, 3.5]
    assert np.isnan(poses[[0, 4]]).all()
    expected = [(0.0, 0.0, 3.0), (0.5, 0.0, 3.0), (1.0, 0.0, 3.25)]
    # quaternions of float64: what is lost is rounding
    assert poses[1:4] == pytest.approx(np.array([laser_at(*pose, MOUNT) for pose in expected]), abs=1e-12)
    (note,) = log.notes
    assert "from transforms base_link to laser: x 0.500 m, y 0.250 m, yaw 90.0 deg" in note


def test_mount_is_a_chain_of_frames_either_way(tmp_path: Path, kind: str) -> None:
    # base_link -> plate -> laser, the first edge given the other way round; names with and without slash
    entries = [
        transform(1, "plate", "/base_link", (0.0, 1.0, 0.0), topic="/tf_static"),
        transform(1, "/plate", "laser", (2.0, 0.0, math.pi / 2), topic="/tf_static"),
        transform(1, "map", "odom", (9.0, 9.0, 1.0)),
    ]
    bag = write_bag(tmp_path / "bag", kind, [scan(SECOND, frame="/laser"), *drive("topic"), *entries])
    found = read_log(bag).odometry
    assert found is not None
    expected = laser_at(0.0, 0.0, 3.0, (2.0, -1.0, math.pi / 2))
    assert found.poses[0] == pytest.approx(np.array(expected), abs=1e-12)


def test_without_a_mount_the_laser_sits_at_the_origin(tmp_path: Path) -> None:
    log = read_log(write_bag(tmp_path / "bag", "mcap", [scan(SECOND), *drive("topic")]))
    assert log.odometry is not None
    assert log.odometry.poses[0] == pytest.approx(np.array([0.0, 0.0, 3.0]), abs=1e-12)
    assert any("no transforms lead from base_link to laser" in note for note in log.notes)


def test_laser_that_hangs_upside_down_is_told(tmp_path: Path) -> None:
    roll = {"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0}
    mount = transform(1, "base_link", "laser", (0.5, 0.0, 0.0), rotation=roll)
    log = read_log(write_bag(tmp_path / "bag", "mcap", [scan(SECOND), *drive("topic"), mount]))
    assert any("upside down" in note for note in log.notes)
    assert any("mirrored" in note for note in log.notes)


def test_a_mount_that_is_sent_late_is_found(tmp_path: Path) -> None:
    wheels = [transform(i, "odom", "base_link", (0.001 * i, 0.0, 0.0)) for i in range(1, 1100)]
    roll = {"x": 1.0, "y": 0.0, "z": 0.0, "w": 0.0}
    mount = transform(1100, "base_link", "laser", (0.5, 0.0, 0.0), rotation=roll)
    bag = write_bag(tmp_path / "bag", "mcap", [scan(SECOND), *wheels, mount])
    assert any("mirrored" in note for note in read_log(bag).notes)
    assert laser_mounts(bag)["/scan"] == pytest.approx(np.array([0.5, 0.0, 0.0]))


def test_times_of_beams_and_sweeps_come_through(tmp_path: Path, kind: str) -> None:
    times = [(1e-4, 0.1), (math.nan, 0.1), (-1e-4, math.inf), (0.0, 0.0)]
    scans = [scan((i + 1) * SECOND, time_increment=beam, scan_time=sweep) for i, (beam, sweep) in enumerate(times)]
    log = read_log(write_bag(tmp_path / "bag", kind, scans))
    found = [(one.time_increment, one.scan_time) for one in log]
    expected = [(1e-4, 0.1), (0.0, 0.1), (0.0, 0.0), (0.0, 0.0)]
    assert found == pytest.approx(np.array(expected), rel=1e-6)
    assert log.read_errors == ()
    assert any("2 scans have a time_increment or scan_time" in note for note in log.notes)
    assert inspect_log(log).n_timed_scans == 1


def test_transforms_of_early_ros1(tmp_path: Path) -> None:
    tf = [(t, "tf/msg/tfMessage", n, c) for t, _, n, c in drive("transforms")]
    log = read_log(write_bag(tmp_path / "a.bag", "ros1", [scan(SECOND), *tf]))
    assert log.odometry is not None
    assert log.odometry.poses[0] == pytest.approx(np.array([0.0, 0.0, 3.0]), abs=1e-12)


def test_mount_that_moves_is_told(tmp_path: Path) -> None:
    mounts = [transform(i, "base_link", "laser", (0.5, 0.0, i)) for i in (1, 2)]
    log = read_log(write_bag(tmp_path / "bag", "mcap", [scan(SECOND), *drive("topic"), *mounts]))
    assert any("mount changes during the log" in note for note in log.notes)


def test_odometry_that_cannot_be_decoded_is_told(tmp_path: Path) -> None:
    path = write_bag(tmp_path / "bag", "sqlite3", [scan(SECOND), *drive("topic")])
    with sqlite3.connect(storage(path)) as connection:
        connection.execute("update messages set data = x'0001' where timestamp > ?", (SECOND,))
    connection.close()
    log = read_log(path)
    assert log.odometry is not None
    assert log.notes[0].startswith("2 odometry or transform messages cannot be decoded")


def test_base_that_does_not_carry_the_laser_is_the_last_resort(tmp_path: Path) -> None:
    wheel = transform(SECOND, "odom", "wheel", (7.0, 0.0, 0.0))
    log = read_log(write_bag(tmp_path / "bag", "mcap", [scan(SECOND), wheel, *drive("transforms")]))
    assert log.odometry is not None
    assert log.odometry.poses[0, 0] == 0.0  # base_link, not the wheel
    assert "no transforms lead from base_link to laser" in log.notes[0]


def test_several_odometry_topics(tmp_path: Path) -> None:
    others = [odometry(SECOND, (5, 5, 0), topic=name) for name in ("/a", "/b")]
    log = read_log(write_bag(tmp_path / "one", "mcap", [scan(SECOND), *others]))
    assert log.odometry is None
    assert any("several odometry topics (/a, /b)" in note for note in log.notes)
    log = read_log(write_bag(tmp_path / "two", "mcap", [scan(SECOND), *others, *drive("topic")]))
    assert log.odometry is not None
    assert log.odometry.poses[0, 0] == 0.0


def test_odometry_of_another_clock_is_left_out(tmp_path: Path) -> None:
    log = read_log(write_bag(tmp_path / "bag", "mcap", [scan(900 * SECOND), *drive("topic")]))
    assert log.odometry is None
    assert any("does not cover the time of any scan" in note for note in log.notes)


def test_odometry_that_is_not_finite_is_left_out(tmp_path: Path) -> None:
    bad = [
        odometry(int(1.5 * SECOND), (math.nan, 0, 0)),
        odometry(int(1.6 * SECOND), (0, math.inf, 0)),
        odometry(int(1.7 * SECOND), (1e308, -1e308, 0)),
        transform(SECOND, "base_link", "laser", (1e308, 0.0, 0.0)),
    ]
    log = read_log(write_bag(tmp_path / "bag", "mcap", [scan(int(1.5 * SECOND)), *drive("topic"), *bad]))
    assert log.odometry is not None
    assert log.odometry.poses[0] == pytest.approx(np.array([0.5, 0.0, 3.0]), abs=1e-12)


def test_odometry_out_of_order_and_doubled(tmp_path: Path) -> None:
    entries = [scan(int(1.5 * SECOND)), *drive("topic")[::-1], *drive("topic")]
    found = read_log(write_bag(tmp_path / "bag", "mcap", entries)).odometry
    assert found is not None
    assert found.poses[0] == pytest.approx(np.array([0.5, 0.0, 3.0]), abs=1e-12)


def test_quaternion_of_zeros_is_no_rotation(tmp_path: Path) -> None:
    zeros = dict.fromkeys(quaternion(0.0), 0.0)
    mount = transform(1, "base_link", "laser", (1.0, 0.0, 0.0), rotation=zeros)
    log = read_log(write_bag(tmp_path / "bag", "mcap", [scan(SECOND), *drive("topic"), mount]))
    assert log.odometry is not None
    expected = laser_at(0.0, 0.0, 3.0, (1.0, 0.0, 0.0))
    assert log.odometry.poses[0] == pytest.approx(np.array(expected), abs=1e-12)


# ---- the real ones

PEOPLE, MUMBLE = "leg-tracker-people", "mumble-rplidar-a1"
TURTLE = "turtlebot4-rplidar/macfirst_floor_take_2"


@pytest.mark.parametrize(
    ("name", "n_scans", "n_beams"),
    [
        (f"{PEOPLE}/general_tracking_moving_1.bag.gz", 873, 768),
        (f"{PEOPLE}/demo_stationary_simple_environment.bag.gz", 1265, 512),
        (f"{PEOPLE}/positive_1.bag.gz", 400, 768),
        ("ccny-handheld-hokuyo/demo.bag", 360, 681),
        (f"{MUMBLE}/kitchen_1", 675, 360),
        (f"{MUMBLE}/slow_half_hallway", 789, 360),
        (f"{MUMBLE}/kitchen_1/my_data_bag_0.db3.gz", 675, 360),
        (TURTLE, 357, 720),
        (f"{TURTLE}/macfirst_floor_take_2_0.db3.gz", 357, 720),
    ],
)
def test_real_bag(real_data: Path, name: str, n_scans: int, n_beams: int) -> None:
    log = read_log(real_data / name)
    assert {len(s) for s in log} == {n_beams}
    assert (len(log), log.read_errors) == (n_scans, ())


def test_real_topic_without_slash(real_data: Path) -> None:
    path = real_data / PEOPLE / "positive_1.bag.gz"
    assert len(read_log(path, topic="/right_scan")) == 400


@pytest.mark.parametrize(
    ("name", "mount", "path_length"),
    [
        # metres the laser moved: summed over the samples of /odom next to each scan, without interpolation
        (f"{PEOPLE}/general_tracking_moving_1.bag.gz", "x 0.850 m, y 0.235 m, yaw 42.1 deg", 112.2),
        (TURTLE, "x 0.004 m, y 0.000 m, yaw 90.0 deg", 8.3),
    ],
)
def test_real_odometry(real_data: Path, name: str, mount: str, path_length: float) -> None:
    log = read_log(real_data / name)
    assert mount in log.notes[0]
    assert log.odometry is not None
    poses = log.odometry.poses[~np.isnan(log.odometry.poses[:, 0])]
    assert len(poses) >= 0.99 * len(log)
    driven = np.sum(np.hypot(*np.diff(poses[:, :2], axis=0).T))
    assert driven == pytest.approx(path_length, abs=0.1)


@pytest.mark.slow
def test_a_bag_cut_short_is_not_trusted_as_a_whole_and_says_how_much_is_missing(tmp_path: Path) -> None:
    messages = [scan(i, ranges=room_scan((0.001 * i, 0.0, 0.0), sigma=0.003, seed=i).ranges) for i in range(1, 100)]
    whole = write_bag(tmp_path / "whole", "ros1", messages)
    content = whole.read_bytes()
    whole.write_bytes(content[: int(0.5 * len(content))])
    verdict = run_log(whole).verdict
    assert not verdict.is_trusted
    n_left, n_all = re.search(r"cut short: (\d+) of about (\d+) scans are there", verdict.reasons[0]).groups()
    assert int(n_left) == len(read_log(whole))
    assert int(n_all) == pytest.approx(99, rel=0.2)
