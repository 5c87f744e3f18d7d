"""ROS bags of a few messages, written for the tests of the reader."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer
from rosbags.typesys import Stores, get_types_from_msg, get_typestore

KINDS = ("ros1", "sqlite3", "mcap")

ROS1 = get_typestore(Stores.ROS1_NOETIC)
for name in ("tf2_msgs/msg/TFMessage", "tf/msg/tfMessage"):
    ROS1.register(get_types_from_msg("geometry_msgs/TransformStamped[] transforms", name))
ROS2 = get_typestore(Stores.ROS2_HUMBLE)

Entry = tuple[str, str, int, dict[str, Any]]
"""Topic, type, time of reception in nanoseconds, fields."""

SECOND = 10**9
RANGES = (1.0, 2.5, 4.25)


def header(stamp: int, frame: str) -> dict[str, Any]:
    return {"stamp": {"sec": stamp // SECOND, "nanosec": stamp % SECOND}, "frame_id": frame}


def scan(
    stamp: int = SECOND,
    ranges: Sequence[float] = RANGES,
    *,
    topic: str = "/scan",
    frame: str = "laser",
    received: int | None = None,
    intensities: Sequence[float] = (),
    **fields: float,
) -> Entry:
    usual = {
        "angle_min": -1.0,
        "angle_increment": min(0.5, 6.0 / max(len(ranges), 1)),
        "range_min": 0.125,
        "range_max": 8.0,
        "angle_max": 0.0,
        "time_increment": 0.0,
        "scan_time": 0.1,
    }
    content = {
        "header": header(stamp, frame),
        **usual,
        **fields,
        "ranges": np.array(ranges, dtype=np.float32),
        "intensities": np.array(intensities, dtype=np.float32),
    }
    received = stamp if received is None else received
    return topic, "sensor_msgs/msg/LaserScan", received, content


def quaternion(yaw: float) -> dict[str, float]:
    return {"x": 0.0, "y": 0.0, "z": math.sin(yaw / 2), "w": math.cos(yaw / 2)}


def odometry(stamp: int, pose: Sequence[float], *, topic: str = "/odom", base: str = "base_link") -> Entry:
    x, y, yaw = pose
    zero = {"x": 0.0, "y": 0.0, "z": 0.0}
    content = {
        "header": header(stamp, "odom"),
        "child_frame_id": base,
        "pose": {
            "pose": {"position": {"x": x, "y": y, "z": 0.0}, "orientation": quaternion(yaw)},
            "covariance": np.zeros(36),
        },
        "twist": {"twist": {"linear": zero, "angular": zero}, "covariance": np.zeros(36)},
    }
    return topic, "nav_msgs/msg/Odometry", stamp, content


def transform(
    stamp: int,
    parent: str,
    child: str,
    pose: Sequence[float] = (0.0, 0.0, 0.0),
    *,
    rotation: dict[str, float] | None = None,
    topic: str = "/tf",
) -> Entry:
    x, y, yaw = pose
    item = {
        "header": header(stamp, parent),
        "child_frame_id": child,
        "transform": {"translation": {"x": x, "y": y, "z": 0.3}, "rotation": rotation or quaternion(yaw)},
    }
    return topic, "tf2_msgs/msg/TFMessage", stamp, {"transforms": [item]}


def imu(stamp: int, rate: float, *, topic: str = "/imu") -> Entry:
    zero = {"x": 0.0, "y": 0.0, "z": 0.0}
    content = {
        "header": header(stamp, "imu"),
        "orientation": quaternion(0.0),
        "angular_velocity": zero | {"z": rate},
        "linear_acceleration": zero,
        "orientation_covariance": np.zeros(9),
        "angular_velocity_covariance": np.zeros(9),
        "linear_acceleration_covariance": np.zeros(9),
    }
    return topic, "sensor_msgs/msg/Imu", stamp, content


def chatter(stamp: int = SECOND, topic: str = "/chatter") -> Entry:
    return topic, "std_msgs/msg/String", stamp, {"data": "hello"}


def write_bag(path: Path, kind: str, entries: Iterable[Entry], *, typestore: Any = None) -> Path:
    """Write a bag and return its path: a file for ROS 1, else a folder."""
    store = typestore or (ROS1 if kind == "ros1" else ROS2)
    connections: dict[tuple[str, str], Any] = {}
    if kind == "ros1":
        writer: Any = Ros1Writer(path)
        serialize = store.serialize_ros1
    else:
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Ros2Writer(path, version=9, storage_plugin=plugin)
        serialize = store.serialize_cdr
    with writer:
        for topic, msgtype, received, fields in entries:
            key = topic, msgtype
            if key not in connections:
                connections[key] = writer.add_connection(topic, msgtype, typestore=store)
            data = serialize(build(store, msgtype, fields), msgtype)
            writer.write(connections[key], received, data)
    return path


def storage(path: Path) -> Path:
    """Return the file that holds the messages of a bag."""
    if path.is_file():
        return path
    return next(file for file in path.iterdir() if file.suffix in (".db3", ".mcap"))


def build(store: Any, msgtype: str, fields: dict[str, Any]) -> Any:
    """Return a message from nested dicts; ROS 1 headers get their seq."""
    content = {}
    for name, (node, desc) in store.get_msgdef(msgtype).fields:
        value = fields.get(name, 0)
        if node.name == "NAME":
            value = build(store, desc, value)
        elif node.name in ("SEQUENCE", "ARRAY") and desc[0][0].name == "NAME":
            value = [build(store, desc[0][1], item) for item in value]
        elif node.name == "SEQUENCE":
            value = np.asarray(value, dtype=desc[0][1][0])
        content[name] = value
    return store.types[msgtype](**content)
