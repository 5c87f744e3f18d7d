"""Logs to ROS bags: the scans on /scan, frame ``laser``; odometry on /odom, pose of the laser in frame ``odom``.

What a LaserScan message cannot hold: digits beyond float32 of ranges, angles and limits, digits of a stamp beyond the
nanosecond, beams that are not evenly spaced. A scan read from a bag comes back to the bit. Odometry with gaps is
interpolated in them when it is read again, and of scans with the same stamp the first one's pose counts.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

from curvescan.io.files.output import output_file
from curvescan.io.log import Log, scans_with_poses
from curvescan.io.ros.bags.bag_files import BagKind
from curvescan.io.ros.writing.bag_writer import BagWriter, bag_in_folder, mcap_in_file
from curvescan.io.trajectories.layouts import checked
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan


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
