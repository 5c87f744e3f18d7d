"""What we override in rosbags is called by it: a version that renames a method would drop our limits in silence."""

from __future__ import annotations

import tomllib
from importlib.metadata import version
from pathlib import Path

import pytest
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import CompressionFormat, CompressionMode, StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer

import curvescan as cs
from curvescan.io.ros.bags.bag_files import Unpacker
from curvescan.io.ros.bags.hardening import limits, salvage
from tests.bags import ROS1, ROS2, SECOND, build, scan, storage, write_bag

N_SCANS = 5


@pytest.fixture
def calls(monkeypatch):
    """Names of the hooks, in the order in which they are called."""
    called = []

    def watch(owner, name):
        hook = getattr(owner, name)

        def watched(*args, **kwargs):
            called.append(name)
            return hook(*args, **kwargs)

        monkeypatch.setattr(owner, name, watched)

    for name in ("read_chunk", "read_index_data", "messages"):
        watch(limits.CheckedRos1Reader, name)
    for name in ("open", "_look", "read_index", "meta_scan"):
        watch(limits.CheckedMcapReader, name)
    for owner, name in ((Unpacker, "unpack"), (limits, "check_chunks"), (limits, "_check_qos_in"), (salvage, "_check")):
        watch(owner, name)
    return called


def fill(writer, store, serialize):
    with writer:
        connection = writer.add_connection("/scan", "sensor_msgs/msg/LaserScan", typestore=store)
        for k in range(N_SCANS):
            _, msgtype, received, fields = scan(SECOND * (k + 1))
            writer.write(connection, received, serialize(build(store, msgtype, fields), msgtype))


@pytest.mark.parametrize("compression", [None, *Ros1Writer.CompressionFormat])
def test_the_hooks_of_a_ros1_bag_are_called(tmp_path, calls, compression):
    writer = Ros1Writer(tmp_path / "log.bag")
    if compression:
        writer.set_compression(compression)
    fill(writer, ROS1, ROS1.serialize_ros1)
    assert len(list(cs.read_log(tmp_path / "log.bag"))) == N_SCANS
    assert {"read_chunk", "read_index_data", "messages"} <= set(calls)
    assert ("unpack" in calls) == (compression is not None)


@pytest.mark.parametrize("is_packed", [False, True])
def test_the_hooks_of_an_mcap_file_are_called(tmp_path, calls, is_packed):
    writer = Ros2Writer(tmp_path / "log", version=9, storage_plugin=StoragePlugin.MCAP)
    if is_packed:
        writer.set_compression(CompressionMode.STORAGE, CompressionFormat.ZSTD)
    fill(writer, ROS2, ROS2.serialize_cdr)
    assert len(list(cs.read_log(storage(tmp_path / "log")))) == N_SCANS
    assert {"open", "_look", "read_index", "check_chunks", "_check_qos_in"} <= set(calls)
    assert ("unpack" in calls) == is_packed
    assert "meta_scan" not in calls
    path = storage(tmp_path / "log")
    path.write_bytes(path.read_bytes()[:-8])
    assert len(list(cs.read_log(path))) == N_SCANS
    assert "meta_scan" in calls


def test_the_hook_of_a_database_is_called(tmp_path, calls):
    path = storage(write_bag(tmp_path / "log", "sqlite3", [scan(SECOND), scan(2 * SECOND)]))
    assert len(list(cs.read_log(path))) == 2
    assert "_check" in calls


def test_rosbags_is_pinned_below_the_next_minor_version():
    project = tomllib.loads((Path(__file__).parents[3] / "pyproject.toml").read_text())["project"]
    (needed,) = (r for r in project["dependencies"] if r.startswith("rosbags"))
    major, minor, *_ = version("rosbags").split(".")
    assert needed.endswith(f",<{major}.{int(minor) + 1}")
