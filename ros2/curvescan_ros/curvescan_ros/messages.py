"""Messages from poses, velocities and maps, and back."""

from __future__ import annotations

import math

import numpy as np
from builtin_interfaces.msg import Time
from geometry_msgs.msg import PoseWithCovarianceStamped, Quaternion, TransformStamped
from nav_msgs.msg import OccupancyGrid, Odometry

from curvescan.io.ros.transforms import FrameTree, frame_name, seven
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.occupancy import OccupancyGrid as Grid
from curvescan.types import UncertainPose

PLANAR = (0, 1, 5)
"""x, y and yaw among the six of a geometry_msgs covariance."""

OUT_OF_PLANE = 1e-6
"""Variance of z, roll and pitch, which a robot on a floor does not have: 0 makes filters fail."""


def later(stamp: Time, seconds: float) -> Time:
    """Return the time so many seconds after a stamp."""
    nanoseconds = stamp.nanosec + round(1e9 * seconds)
    return Time(sec=stamp.sec + nanoseconds // 10**9, nanosec=nanoseconds % 10**9)


def quaternion_of(theta: float) -> Quaternion:
    """Return a rotation about z."""
    return Quaternion(x=0.0, y=0.0, z=math.sin(0.5 * theta), w=math.cos(0.5 * theta))


def yaw_of(rotation: Quaternion) -> float:
    """Return the rotation about z of a quaternion, radians."""
    return 2.0 * math.atan2(rotation.z, rotation.w)


def six_by_six(covariance: np.ndarray) -> np.ndarray:
    """Return the 36 numbers of a (3, 3) covariance of x, y, theta."""
    full = np.diag([OUT_OF_PLANE] * 6)
    full[np.ix_(PLANAR, PLANAR)] = covariance
    return full.ravel()


def odometry_message(stamp: Time, state: object, odom_frame: str, base_frame: str) -> Odometry:
    """Return nav_msgs/Odometry of a :class:`curvescan.live.base_motion.BaseState`."""
    message = Odometry()
    message.header.stamp, message.header.frame_id = stamp, odom_frame
    message.child_frame_id = base_frame
    x, y, theta = state.odom_base.pose.tolist()
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    message.pose.pose.orientation = quaternion_of(theta)
    message.pose.covariance = six_by_six(state.odom_base.covariance)
    vx, vy, omega = state.twist.tolist()
    message.twist.twist.linear.x, message.twist.twist.linear.y = vx, vy
    message.twist.twist.angular.z = omega
    message.twist.covariance = six_by_six(state.twist_covariance)
    return message


def transform_message(stamp: Time, pose: np.ndarray, parent: str, child: str) -> TransformStamped:
    """Return geometry_msgs/TransformStamped of a (3,) pose."""
    message = TransformStamped()
    message.header.stamp, message.header.frame_id = stamp, parent
    message.child_frame_id = child
    x, y, theta = pose.tolist()
    message.transform.translation.x, message.transform.translation.y = x, y
    message.transform.rotation = quaternion_of(theta)
    return message


def transform_pose(transform: object) -> np.ndarray:
    """Return the (3,) pose of geometry_msgs/Transform, seen from above."""
    return np.array([transform.translation.x, transform.translation.y, yaw_of(transform.rotation)])


def map_message(stamp: Time, grid: object, map_frame: str) -> OccupancyGrid:
    """Return nav_msgs/OccupancyGrid of :class:`curvescan.mapping.occupancy.OccupancyGrid`: -1 unknown, else 0 to 100."""
    message = OccupancyGrid()
    message.header.stamp, message.header.frame_id = stamp, map_frame
    message.info.map_load_time = stamp
    message.info.resolution = float(grid.resolution)
    message.info.height, message.info.width = grid.log_odds.shape
    message.info.origin.position.x, message.info.origin.position.y = grid.origin.tolist()
    message.info.origin.orientation.w = 1.0
    percent = np.rint(100.0 * grid.probability).astype(np.int8)
    percent[grid.log_odds == 0.0] = -1
    message.data.frombytes(percent.tobytes())
    return message


def pose_message(stamp: Time, here: UncertainPose, map_frame: str) -> PoseWithCovarianceStamped:
    """Return a pose in the map."""
    message = PoseWithCovarianceStamped()
    message.header.stamp, message.header.frame_id = stamp, map_frame
    x, y, theta = here.pose.tolist()
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    message.pose.pose.orientation = quaternion_of(theta)
    message.pose.covariance = six_by_six(here.covariance)
    return message


def initial_pose_of(message: PoseWithCovarianceStamped) -> UncertainPose:
    """Return an initial pose, seen from above; its covariance NaN where the message has none."""
    cov = np.reshape(message.pose.covariance, (6, 6))[np.ix_(PLANAR, PLANAR)]
    return UncertainPose(pose_of(message), cov if np.any(cov) else np.full((3, 3), np.nan))


def grid_of(message: OccupancyGrid, occupied: int = 65, free: int = 19) -> Grid:
    """Return a map that somebody else published; percentages from `occupied` on are walls, up to `free` are free."""
    info = message.info
    percent = np.array(message.data, dtype=np.int64).reshape(info.height, info.width)
    config = OccupancyConfig(resolution=float(info.resolution))
    surest = np.log([config.highest / (1.0 - config.highest), config.lowest / (1.0 - config.lowest)])
    log_odds = np.where(percent >= occupied, surest[0], np.where((percent >= 0) & (percent <= free), surest[1], 0.0))
    origin = np.array([info.origin.position.x, info.origin.position.y])
    return Grid(log_odds=log_odds.astype(np.float32), origin=origin, config=config)


def pose_of(message: Odometry | PoseWithCovarianceStamped) -> np.ndarray:
    """Return the (3,) pose of a message, seen from above."""
    position, rotation = message.pose.pose.position, message.pose.pose.orientation
    return np.array([position.x, position.y, yaw_of(rotation)])


def add_transforms(tree: FrameTree, message: object) -> None:
    """Take in a tf2_msgs/TFMessage."""
    for item in message.transforms:
        edge = (frame_name(item.header.frame_id), frame_name(item.child_frame_id))
        tree.add(edge, seven(item.transform.translation, item.transform.rotation))


def mount_of(tree: FrameTree, base_frame: str, laser_frame: str) -> tuple[np.ndarray, bool] | None:
    """Return the pose of the laser in the base frame and whether it hangs upside down; None where tf has no way between them."""
    base, laser = frame_name(base_frame), frame_name(laser_frame)
    path = tree.path(base, laser, avoid="")
    if path is None:
        return None
    pose = tree.along(base, path)
    theta = math.atan2(pose[1, 0], pose[0, 0])
    return np.array([pose[0, 3], pose[1, 3], theta]), bool(pose[2, 2] < 0.0)
