"""BagWriter: laser scans, odometry and transforms to a ROS bag; the counterpart of bag.py.

The scans go to /scan, frame ``laser``; the pose of the laser in frame ``odom`` to /odom. What a message cannot hold
stands in docs/formats.md.
"""

import os
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any, Literal, Self

import numpy as np
from rosbags.interfaces import Connection
from rosbags.rosbag1 import Writer as Ros1Writer
from rosbags.rosbag2 import StoragePlugin
from rosbags.rosbag2 import Writer as Ros2Writer

from curvescan.errors import OutputError
from curvescan.io.files.output import hidden_folder, output_file
from curvescan.io.log import Log, scans_with_poses
from curvescan.io.ros.bags.bag_files import BagKind
from curvescan.io.ros.messages import LASER_SCAN, ODOMETRY, TRANSFORMS
from curvescan.io.ros.writing.message_building import LASER_FRAME, ODOM_FRAME, MessageBuilder
from curvescan.io.trajectories.layouts import checked
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan
from curvescan.types import Cov, Pose

SCAN_TOPIC, ODOM_TOPIC, TF_TOPIC = "/scan", "/odom", "/tf"

_METADATA_VERSION: Literal[8, 9] = 8
"""Of metadata.yaml: the last whose quality of service is a text, as all releases since Foxy read it; 9 gives a list,
over which Humble and Iron stumble."""

_PLUGINS = {BagKind.SQLITE: StoragePlugin.SQLITE3, BagKind.MCAP: StoragePlugin.MCAP}


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
    with hidden_folder(path.parent) as folder:
        yield folder / "scans"
        (folder / "scans" / "scans.mcap").replace(path)


class BagWriter:
    """Writes a bag message by message; to be used in a ``with``.

    The recorder's time of reception is the message's stamp, but never before that of the message before: readers order
    by it, and the order of the calls must stay though stamps may repeat or go back.
    """

    def __init__(self, path: object, kind: BagKind) -> None:
        self._path = str(path)
        is_ros1 = kind is BagKind.ROS1
        self.builder = MessageBuilder(is_ros1=is_ros1, where=kind.value)
        self._connections: dict[str, Connection] = {}
        self._received = 0
        if kind is BagKind.SQLITE and any(ch in self._path for ch in "?#%"):
            # the library puts the path into a URI
            raise OutputError(f"cannot write {self._path}: a path of an SQLite file cannot hold ?, # or %")
        self._writer = (
            Ros1Writer(self._path)
            if is_ros1
            else Ros2Writer(self._path, version=_METADATA_VERSION, storage_plugin=_PLUGINS[kind])
        )

    def __enter__(self) -> Self:
        self._writer.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        self._writer.__exit__(kind, error, traceback)

    def add_scan(self, scan: LaserScan) -> bool:
        """Write a scan to /scan, and return whether all its numbers are kept as they are. Raises OutputError."""
        message, is_same = self.builder.laser_scan(scan)
        self.write(SCAN_TOPIC, LASER_SCAN, message, scan.stamp)
        return is_same

    def add_odometry(self, stamp: float, pose: Pose, covariance: Cov | None = None) -> None:
        """Write a pose of the laser in the odometry's frame to /odom, nav_msgs/Odometry, its speed unknown."""
        self.write(ODOM_TOPIC, ODOMETRY, self.builder.odometry(stamp, pose, covariance), stamp)

    def add_transform(self, stamp: float, pose: Pose) -> None:
        """Write a pose of the laser in the odometry's frame to /tf."""
        message = self.builder.transforms(stamp, [(ODOM_FRAME, LASER_FRAME, pose)])
        self.write(TF_TOPIC, TRANSFORMS[0], message, stamp)

    def write(self, topic: str, msgtype: str, message: Any, stamp: float) -> None:
        """Write a message that `builder` made."""
        if topic not in self._connections:
            self._connections[topic] = self._writer.add_connection(topic, msgtype, typestore=self.builder.store)
        self._received = max(self._received + 1, self.builder.nanoseconds(stamp))
        data = self.builder.encoded(message, msgtype)
        self._writer.write(self._connections[topic], self._received, data)


def write_ros1(path: Path, log: Log, on_scan: Callable[[], object]) -> tuple[str, ...]:
    """Write a log as a ROS 1 bag; a LogWriter."""
    return _write(path, log, BagKind.ROS1, on_scan)


def write_sqlite3(path: Path, log: Log, on_scan: Callable[[], object]) -> tuple[str, ...]:
    """Write a log as the content of a ROS 2 bag's folder, sqlite3 and metadata.yaml; a LogWriter."""
    with bag_in_folder(path) as bag:
        return _write(bag, log, BagKind.SQLITE, on_scan)


def write_mcap(path: Path, log: Log, on_scan: Callable[[], object]) -> tuple[str, ...]:
    """Write a log as an MCAP file; a LogWriter."""
    with mcap_in_file(path) as folder:
        return _write(folder, log, BagKind.MCAP, on_scan)


def _write(path: Path, log: Log, kind: BagKind, on_scan: Callable[[], object]) -> tuple[str, ...]:
    is_same = True
    with BagWriter(path, kind) as bag:
        for scan, pose in scans_with_poses(log):
            if pose is not None:
                bag.add_odometry(scan.stamp, pose)
            is_same &= bag.add_scan(scan)
            on_scan()
    return () if is_same else ("digits beyond float32: a LaserScan message has no more",)


def write_odometry_mcap(path: str | os.PathLike[str], trajectory: Trajectory, scans: Iterable[LaserScan]) -> None:
    """Write the poses of a sensor and what it saw there.

    Topics: ``/odom`` (nav_msgs/Odometry; covariance of x, y, yaw in frame ``odom``, of z, roll and pitch 0: they do not
    move), ``/tf`` (``odom`` to ``laser``) and ``/scan`` (sensor_msgs/LaserScan, frame ``laser``).

    Parameters
    ----------
    path : str or path-like
        The file, replaced if it exists.
    trajectory : Trajectory
        Poses of the laser; where one is NaN the scan stands alone.
    scans : iterable of LaserScan
        One a pose at least; those beyond the last pose are left out, and those whose beams are not evenly spaced, which
        a LaserScan message cannot say: their poses stay.

    Raises
    ------
    OutputError
        When the file cannot be written, or a message cannot hold a stamp.
    """
    covariances = checked(trajectory).covariances
    with output_file(path) as new, mcap_in_file(new) as folder, BagWriter(folder, BagKind.MCAP) as bag:
        for i, (pose, scan) in enumerate(zip(trajectory.poses, scans, strict=False)):
            if np.isfinite(pose).all():
                bag.add_transform(scan.stamp, pose)
                covariance = None if covariances is None else covariances[i]
                bag.add_odometry(scan.stamp, pose, covariance)
            if scan.has_uniform_angles:
                bag.add_scan(scan)
