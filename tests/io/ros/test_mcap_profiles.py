"""MCAP files that were not written for ROS 2 by name, and hold its messages all the same."""

import json

import numpy as np
import pytest

from curvescan import LogFormatError, read_log, simulate, write_log
from curvescan.io.ros.reader import CUT_BAG

mcap_writer = pytest.importorskip("mcap.writer", reason="the mcap package is not installed")
mcap_reader = pytest.importorskip("mcap.reader")


@pytest.fixture(scope="module")
def messages(tmp_path_factory):
    """The channels and messages of an MCAP file of ours."""
    log = simulate("room", sensor="spinning-360", n_scans=5)
    path = tmp_path_factory.mktemp("mcap") / "ours.mcap"
    write_log(path, log)
    with path.open("rb") as file:
        found = [(s, c, m) for s, c, m in mcap_reader.make_reader(file).iter_messages()]
    return log, found


def written(path, messages, *, profile, others=(), encoding="ros2msg", **options):
    """An MCAP file of the same messages by the mcap package, with channels of other kinds."""
    with path.open("wb") as file:
        writer = mcap_writer.Writer(file, **options)
        writer.start(profile=profile, library="a test")
        channels = {}
        for name, schema_encoding, schema_data, message_encoding, data in others:
            schema = writer.register_schema(name, schema_encoding, schema_data)
            channel = writer.register_channel("/" + name, message_encoding, schema)
            writer.add_message(channel, log_time=1, data=data, publish_time=1)
        for schema, channel, message in messages:
            if channel.id not in channels:
                new = writer.register_schema(schema.name, encoding, schema.data)
                channels[channel.id] = writer.register_channel(channel.topic, "cdr", new)
            writer.add_message(channels[channel.id], message.log_time, message.data, message.publish_time)
        writer.finish()


OTHERS = (
    ("foxglove.Log", "jsonschema", b"{}", "json", json.dumps({"a": 1}).encode()),
    ("foxglove.Pose", "protobuf", bytes(range(128, 256)) * 4, "protobuf", b"\xff\xfe"),
)


@pytest.mark.parametrize("profile", ["", "ros2", "foxglove", "x" * 300])
@pytest.mark.parametrize("others", [(), OTHERS])
def test_the_channels_are_asked_and_not_the_profile(messages, tmp_path, profile, others):
    log, found = messages
    path = tmp_path / "other.mcap"
    written(path, found, profile=profile, others=others)
    read = read_log(path)
    assert len(read) == len(log)
    for a, b in zip(read, log, strict=True):
        assert np.array_equal(a.ranges, b.ranges.astype(np.float32), equal_nan=True)


@pytest.mark.parametrize("compression", list(mcap_writer.CompressionType))
def test_a_file_that_is_cut_is_read_beside_channels_of_other_kinds(messages, tmp_path, compression):
    scans, found = messages
    path = tmp_path / "cut.mcap"
    written(path, found, profile="foxglove", others=OTHERS, chunk_size=5000, compression=compression)
    path.write_bytes(path.read_bytes()[:-300])
    log = read_log(path)
    assert len(log) == len(scans)
    assert [error.rule for error in log.read_errors] == [CUT_BAG]


@pytest.mark.parametrize("others", [(), OTHERS])
@pytest.mark.parametrize("left_out", [{"schemas"}, {"channels"}, {"schemas", "channels"}])
@pytest.mark.parametrize("use_statistics", [True, False])
def test_a_summary_need_not_repeat_schemas_and_channels(messages, tmp_path, others, left_out, use_statistics):
    scans, found = messages
    path = tmp_path / "brief.mcap"
    options = {f"repeat_{what}": False for what in left_out}
    written(path, found, profile="ros2", others=others, use_statistics=use_statistics, **options)
    log = read_log(path)
    assert len(log) == len(scans)
    assert log.read_errors == ()


def test_a_chunk_in_a_chunk_is_not_unpacked(tmp_path):
    path = tmp_path / "nested.mcap"
    record = b""
    for _ in range(3):
        head = bytes(16) + len(record).to_bytes(8, "little") + bytes(4) + bytes(4) + len(record).to_bytes(8, "little")
        record = b"\x06" + (len(head) + len(record)).to_bytes(8, "little") + head + record
    header = b"\x01" + (8).to_bytes(8, "little") + bytes(8)
    magic = b"\x89MCAP0\r\n"
    path.write_bytes(magic + header + record + b"\x02" + (20).to_bytes(8, "little") + bytes(20) + magic)
    with pytest.raises(LogFormatError, match=r"without a laser scan: .* holds no topic"):
        read_log(path)


def test_without_a_channel_of_ros_2_the_encodings_are_named(tmp_path):
    path = tmp_path / "foreign.mcap"
    written(path, [], profile="foxglove", others=OTHERS)
    with pytest.raises(LogFormatError, match="they hold json, protobuf"):
        read_log(path)
