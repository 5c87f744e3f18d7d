"""The result of an odometry as an MCAP file, which Foxglove and ROS 2 open: scans, pose with covariance, transforms."""

from __future__ import annotations

import os
from collections.abc import Iterable

import numpy as np

from curvescan.io.files.output import output_file
from curvescan.io.ros.bags.bag_files import BagKind
from curvescan.io.ros.writing.bag_writer import BagWriter, mcap_in_file
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan


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
    covariances = trajectory.covariances
    with output_file(path) as new, mcap_in_file(new) as folder, BagWriter(folder, BagKind.MCAP) as bag:
        for i, (pose, scan) in enumerate(zip(trajectory.poses, scans, strict=False)):
            if np.isfinite(pose).all():
                bag.add_transform(scan.stamp, pose)
                covariance = None if covariances is None else covariances[i]
                bag.add_odometry(scan.stamp, pose, covariance)
            if scan.has_uniform_angles:
                bag.add_scan(scan)
