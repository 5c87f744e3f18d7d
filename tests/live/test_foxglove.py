"""Foxglove's websocket, read by an independent client, message for message; and the recording beside it."""

import json
import struct
import sys
import time
from contextlib import closing

import numpy as np
import pytest

from curvescan import MissingPackageError, Odometry, OutputError, Slam, simulate
from curvescan.live import FoxgloveSink, LogSource, McapRecorder, Tracker, run_live
from curvescan.live.messages import TOPICS

pytest.importorskip("foxglove", reason="foxglove-sdk is not installed (extra foxglove)")
websocket = pytest.importorskip("websocket", reason="websocket-client is not installed")
from rosbags.typesys import Stores, get_types_from_msg, get_typestore  # noqa: E402


class Client:
    """A client of the protocol foxglove.websocket.v1, written from its specification."""

    def __init__(self, url):
        self.socket = websocket.create_connection(url, timeout=10.0, subprotocols=["foxglove.sdk.v1"])
        self.info = json.loads(self.socket.recv())
        self.channels = {}
        while len(self.channels) < len(TOPICS):
            advertised = json.loads(self.socket.recv())
            if advertised["op"] == "advertise":
                self.channels |= {c["topic"]: c for c in advertised["channels"]}
        self._topic_of = {}

    def subscribe(self, *topics):
        wanted = [{"id": k, "channelId": self.channels[t]["id"]} for k, t in enumerate(topics)]
        self._topic_of = dict(enumerate(topics))
        self.socket.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))

    def messages(self, quiet=2.0):
        """Topic, time and bytes of each message, until none comes for a while."""
        self.socket.settimeout(quiet)
        while True:
            try:
                data = self.socket.recv()
            except websocket.WebSocketTimeoutException:
                return
            if isinstance(data, bytes) and data[0] == 1:
                number, when = struct.unpack("<IQ", data[1:13])
                yield self._topic_of[number], when, data[13:]

    def decoded(self, topic, data):
        """A message, by the definition that the server gave."""
        channel = self.channels[topic]
        store = get_typestore(Stores.EMPTY)
        store.register(get_types_from_msg(channel["schema"], channel["schemaName"]))
        return store.deserialize_cdr(data, channel["schemaName"])

    def close(self):
        self.socket.close()


@pytest.fixture(scope="module")
def log():
    return simulate("office", sensor="spinning-360", n_scans=40, seed=1)


def played(log, mode, engine, tmp_path):
    """What a client got of a run, and what was recorded of it."""
    sink = FoxgloveSink(log.name, port=0, mode=mode, is_lossless=True)
    recorder = McapRecorder(tmp_path / "run.mcap", mode=mode, is_lossless=True)
    with closing(Client(sink.url)) as client:
        client.subscribe(*TOPICS)
        time.sleep(0.5)
        run_live(LogSource(log, speed=0), Tracker(engine), [sink, recorder])
        recorder.close()
        sink.close()
        got = list(client.messages())
    sink.stop()
    return client, got


@pytest.mark.slow
@pytest.mark.parametrize(("mode", "engine"), [("odometry", Odometry), ("SLAM", Slam)])
def test_a_client_gets_what_is_recorded(log, mode, engine, tmp_path):
    mcap_reader = pytest.importorskip("mcap.reader")
    client, got = played(log, mode, engine(), tmp_path)
    assert client.info["name"] == f"curvescan: {log.name}"
    for topic, msgtype in TOPICS.items():
        channel = client.channels[topic]
        assert (channel["encoding"], channel["schemaEncoding"]) == ("cdr", "ros2msg")
        assert channel["schemaName"] == msgtype
    with (tmp_path / "run.mcap").open("rb") as file:
        recorded = [
            (channel.topic, message.data) for _, channel, message in mcap_reader.make_reader(file).iter_messages()
        ]
    for topic in ("/scan", "/odom", "/tf"):
        sent = [bytes(data) for name, _, data in got if name == topic]
        assert len(sent) == len(log)
        assert sent == [data for name, data in recorded if name == topic]
    maps = [data for name, _, data in got if name == "/map"]
    assert maps[-1] == [data for name, data in recorded if name == "/map"][-1]
    grid = client.decoded("/map", maps[-1])
    assert grid.header.frame_id == ("odom" if mode == "odometry" else "map")
    assert np.count_nonzero(grid.data == 100) + np.count_nonzero(grid.data > 50) > 100
    tf = client.decoded("/tf", next(data for name, _, data in got if name == "/tf"))
    edges = [(t.header.frame_id, t.child_frame_id) for t in tf.transforms]
    assert edges == [("odom", "laser"), ("map", "odom")][: 1 + (mode == "SLAM")]


@pytest.mark.slow
def test_the_numbers_are_those_of_the_odometry(log, tmp_path):
    client, got = played(log, "odometry", Odometry(), tmp_path)
    messages = [client.decoded(name, data) for name, _, data in got if name == "/odom"]
    odometry = Odometry()
    steps = [odometry.add(scan) for scan in log]
    x = [(m.pose.pose.position.x, m.pose.pose.position.y) for m in messages]
    assert np.allclose(x, [step.pose[:2] for step in steps], atol=1e-12)
    period = log[1].stamp - log[0].stamp
    speeds = [np.hypot(m.twist.twist.linear.x, m.twist.twist.linear.y) for m in messages[1:]]
    moved = [np.hypot(*step.motion[:2]) for step in steps[1:]]
    assert np.allclose(np.array(speeds) * period, moved, rtol=0.02, atol=1e-6)
    scans = [client.decoded(name, data) for name, _, data in got if name == "/scan"]
    for message, scan in zip(scans, log, strict=True):
        assert np.array_equal(message.ranges, scan.ranges.astype(np.float32), equal_nan=True)


def test_a_late_client_gets_the_map(log):
    sink = FoxgloveSink(log.name, port=0, is_lossless=True)
    run_live(LogSource(log, speed=0), Tracker(Odometry()), [sink])
    sink.close()
    with closing(Client(sink.url)) as client:
        client.subscribe("/map")
        assert [name for name, _, _ in client.messages(quiet=1.0)] == ["/map"]
    sink.stop()


def test_an_address_in_use():
    sink = FoxgloveSink("first", port=0)
    port = int(sink.url.rpartition(":")[2])
    with pytest.raises(OutputError, match="cannot serve Foxglove"):
        FoxgloveSink("second", port=port)
    sink.close()
    sink.stop()


def test_without_the_package(monkeypatch):
    monkeypatch.setitem(sys.modules, "foxglove", None)
    with pytest.raises(MissingPackageError, match=r"curvescan\[foxglove\]"):
        FoxgloveSink("none", port=0)
