"""BagWriter: laser scans, odometry and transforms to a ROS bag; the counterpart of bag.py.

A LaserScan message holds float32: what a scan keeps of a float64 is its nearest float32. Times are whole nanoseconds.
"""

from __future__ import annotations

import math
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from decimal import Decimal
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Protocol, Self

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer

from curvescan.errors import OutputError
from curvescan.io.ros.bag_files import BagKind
from curvescan.io.ros.messages import LASER_SCAN, ODOMETRY, TRANSFORMS, bundled_types
from curvescan.scan import LaserScan
from curvescan.types import Cov, Pose

ODOM_FRAME, LASER_FRAME = "odom", "laser"
SCAN_TOPIC, ODOM_TOPIC, TF_TOPIC = "/scan", "/odom", "/tf"

_SECOND = 10**9
_METADATA_VERSION: Literal[8, 9] = 8
"""Of metadata.yaml: the last whose quality of service is a text, as all releases since Foxy read it; 9 gives a list, over which
Humble and Iron stumble."""

_PLANAR = [0, 1, 5]
"""x, y and yaw among the six of a geometry_msgs covariance: its elements 0, 1, 5, 6, 7, 11, 30, 31, 35."""
_UNKNOWN = 1e6
"""Variance of a speed that is not known, (m/s)^2 and (rad/s)^2."""
_PLUGINS = {BagKind.SQLITE: StoragePlugin.SQLITE3, BagKind.MCAP: StoragePlugin.MCAP}


class _Writer(Protocol):
    """What the writers of rosbags have in common."""

    def __enter__(self) -> object: ...

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> object: ...

    def add_connection(self, topic: str, msgtype: str, *, typestore: Any) -> Connection: ...

    def write(self, connection: Connection, timestamp: int, data: bytes | memoryview) -> None: ...


@contextmanager
def bag_in_folder(path: Path) -> Iterator[Path]:
    """Yield where to write a ROS 2 bag whose files are to lie in an existing folder."""
    bag = path / "scans"  # the library makes a folder of its own, and names the storage by it
    yield bag
    for file in bag.iterdir():
        file.replace(path / file.name)
    bag.rmdir()


@contextmanager
def mcap_in_file(path: Path) -> Iterator[Path]:
    """Yield where to write an MCAP bag of which the one file is to lie at `path`, which needs no metadata.yaml."""
    folder = Path(tempfile.mkdtemp(prefix=".curvescan-", dir=path.parent))
    try:
        yield folder / "scans"
        (folder / "scans" / "scans.mcap").replace(path)
    finally:
        shutil.rmtree(folder, ignore_errors=True)


class BagWriter:
    """Writes a bag message by message; to be used in a ``with``.

    The recorder's time of reception is the message's stamp, but never before that of the message before: readers order by it, and the
    order of the calls must stay though stamps may repeat or go back.

    Parameters
    ----------
    path : Path
        A file for ROS 1, else a folder; it must not exist.
    kind : BagKind
        How to store.

    Raises
    ------
    OutputError
        When it cannot be written there.
    """

    def __init__(self, path: object, kind: BagKind) -> None:
        self._path, self._kind = str(path), kind
        self._is_ros1 = kind is BagKind.ROS1
        self._store = bundled_types(self._is_ros1)
        self._connections: dict[str, Connection] = {}
        self._received = 0
        if kind is BagKind.SQLITE and any(ch in self._path for ch in "?#%"):
            # the library puts the path into a URI
            raise OutputError(
                f"cannot write {self._path}: a path of an SQLite file cannot hold ?, # or %"
            )
        self._writer: _Writer = (
            Ros1Writer(self._path)
            if self._is_ros1
            else Ros2Writer(self._path, version=_METADATA_VERSION, storage_plugin=_PLUGINS[kind])
        )

    def __enter__(self) -> Self:
        self._writer.__enter__()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._writer.__exit__(kind, error, traceback)

    def add_scan(self, scan: LaserScan) -> bool:
        """Write a scan to /scan, and return whether all its numbers are kept as they are.

        Raises
        ------
        OutputError
            When its beams are not evenly spaced, or nothing is left of an angle or a limit in float32.
        """
        if not scan.has_uniform_angles:
            raise OutputError(
                f"cannot write the scan at {scan.stamp} s to a ROS bag: a LaserScan message has evenly spaced beams, these "
                "are not; CSV and NPZ keep them"
            )
        last = scan.angle_min + max(len(scan) - 1, 0) * scan.angle_increment
        fields = {
            "angle_min": scan.angle_min,
            "angle_max": last,
            "angle_increment": scan.angle_increment,
            "time_increment": scan.time_increment,
            "scan_time": scan.scan_time,
            "range_min": scan.range_min,
            "range_max": scan.range_max,
        }
        with np.errstate(over="ignore", under="ignore"):
            short = {name: float(np.float32(value)) for name, value in fields.items()}
            ranges = scan.ranges.astype(np.float32)
            strengths = () if scan.intensities is None else scan.intensities
            intensities = np.asarray(strengths, dtype=np.float64).astype(np.float32)
        if not (short["angle_increment"] != 0.0 and short["range_min"] < short["range_max"]):
            raise OutputError(
                f"cannot write the scan at {scan.stamp} s to a ROS bag: float32 makes angle_increment 0, or range_min and "
                "range_max equal"
            )
        when = self._nanoseconds(scan.stamp)
        message = self._new(
            LASER_SCAN,
            header=self._header(when, LASER_FRAME),
            ranges=ranges,
            intensities=intensities,
            **short,
        )
        self._write(SCAN_TOPIC, LASER_SCAN, message, when)
        # inf, a missing limit, and all that came from a message stay the same; angle_max is not ours
        is_same = np.array_equal(ranges.astype(np.float64), scan.ranges, equal_nan=True)
        return is_same and all(short[k] == v for k, v in fields.items() if k != "angle_max")

    def add_odometry(self, stamp: float, pose: Pose, covariance: Cov | None = None) -> None:
        """Write a pose of the laser in the odometry's frame to /odom, nav_msgs/Odometry; its speed is said to be unknown."""
        when = self._nanoseconds(stamp)
        position, orientation = self._point_and_quaternion(pose)
        covariances = np.zeros((6, 6))
        if covariance is not None:
            covariances[np.ix_(_PLANAR, _PLANAR)] = covariance
        zero = self._new("geometry_msgs/msg/Vector3", x=0.0, y=0.0, z=0.0)
        message = self._new(
            ODOMETRY,
            header=self._header(when, ODOM_FRAME),
            child_frame_id=LASER_FRAME,
            pose=self._new(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=self._new(
                    "geometry_msgs/msg/Pose", position=position, orientation=orientation
                ),
                covariance=covariances.ravel(),
            ),
            twist=self._new(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=self._new("geometry_msgs/msg/Twist", linear=zero, angular=zero),
                covariance=np.diag(np.full(6, _UNKNOWN)).ravel(),
            ),
        )
        self._write(ODOM_TOPIC, ODOMETRY, message, when)

    def add_transform(self, stamp: float, pose: Pose) -> None:
        """Write a pose of the laser in the odometry's frame to /tf."""
        when = self._nanoseconds(stamp)
        point, rotation = self._point_and_quaternion(pose)
        item = self._new(
            "geometry_msgs/msg/TransformStamped",
            header=self._header(when, ODOM_FRAME),
            child_frame_id=LASER_FRAME,
            transform=self._new(
                "geometry_msgs/msg/Transform",
                translation=self._new("geometry_msgs/msg/Vector3", x=point.x, y=point.y, z=0.0),
                rotation=rotation,
            ),
        )
        self._write(TF_TOPIC, TRANSFORMS[0], self._new(TRANSFORMS[0], transforms=[item]), when)

    def _point_and_quaternion(self, pose: Pose) -> tuple[Any, Any]:
        x, y, theta = pose.tolist()
        return (
            self._new("geometry_msgs/msg/Point", x=x, y=y, z=0.0),
            self._new(
                "geometry_msgs/msg/Quaternion",
                x=0.0,
                y=0.0,
                z=math.sin(0.5 * theta),
                w=math.cos(0.5 * theta),
            ),
        )

    def _header(self, when: int, frame: str) -> Any:
        stamp = self._new(
            "builtin_interfaces/msg/Time", sec=when // _SECOND, nanosec=when % _SECOND
        )
        seq = {"seq": 0} if self._is_ros1 else {}
        return self._new("std_msgs/msg/Header", stamp=stamp, frame_id=frame, **seq)

    def _nanoseconds(self, stamp: float) -> int:
        """Return a stamp in whole nanoseconds, having made sure that a message can hold it."""
        low, high = (0, 2**32) if self._is_ros1 else (-(2**31), 2**31)
        if not low <= stamp < high:
            raise OutputError(
                f"cannot write the stamp {stamp} s to a {self._kind.value}: its seconds must lie in {low} to {high - 1}"
            )
        # by the decimal digits of the stamp: those of 1700000000.123456 are meant, not the float64's further ones
        return round(Decimal(repr(stamp)) * _SECOND)

    def _new(self, msgtype: str, **fields: Any) -> Any:
        return self._store.types[msgtype](**fields)

    def _write(self, topic: str, msgtype: str, message: Any, when: int) -> None:
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(
                topic, msgtype, typestore=self._store
            )
        serialize = self._store.serialize_ros1 if self._is_ros1 else self._store.serialize_cdr
        self._received = max(self._received + 1, when)
        self._writer.write(self._connections[topic], self._received, serialize(message, msgtype))
