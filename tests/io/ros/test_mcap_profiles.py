"""MCAP files that were not written for ROS 2 by name, and hold its messages all the same."""

import json

import numpy as np
import pytest

from curvescan import LogFormatError, read_log, simulate, write_log

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


def written(path, messages, *, profile, others=(), encoding="ros2msg"):
    """An MCAP file of the same messages by the mcap package, with channels of other kinds."""
    with path.open("wb") as file:
        writer = mcap_writer.Writer(file)
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


def test_without_a_channel_of_ros_2_the_encodings_are_named(tmp_path):
    path = tmp_path / "foreign.mcap"
    written(path, [], profile="foxglove", others=OTHERS)
    with pytest.raises(LogFormatError, match="they hold json, protobuf"):
        read_log(path)
