"""MessageBuilder: scans, poses and maps as ROS messages; the counterpart of messages.py and odometry.py.

A LaserScan message holds float32: what a scan keeps of a float64 is its nearest float32. Times are whole nanoseconds.
"""

import math
from collections.abc import Sequence
from decimal import Decimal
from typing import Any

import numpy as np
from numpy.typing import NDArray

from curvescan.errors import OutputError
from curvescan.io.ros.messages import LASER_SCAN, OCCUPANCY_GRID, ODOMETRY, TRANSFORMS, bundled_types
from curvescan.scan import LaserScan
from curvescan.types import Cov, Floats, Pose

MAP_FRAME, ODOM_FRAME, LASER_FRAME = "map", "odom", "laser"
_SECOND = 10**9
_PLANAR = [0, 1, 5]
"""x, y and yaw among the six of a geometry_msgs covariance: its elements 0, 1, 5, 6, 7, 11, 30, 31, 35."""
_UNKNOWN = 1e6  # variance of a speed that is not known, (m/s)^2 and (rad/s)^2


class MessageBuilder:
    """Builds messages of the bundled types, and their bytes."""

    def __init__(self, *, is_ros1: bool = False, where: str = "ROS 2 bag") -> None:
        self._is_ros1, self._where = is_ros1, where
        self.store = bundled_types(is_ros1)

    def nanoseconds(self, stamp: float) -> int:
        """Return a stamp in whole nanoseconds, having made sure that a message can hold it. Raises OutputError."""
        low, high = (0, 2**32) if self._is_ros1 else (-(2**31), 2**31)
        if not low <= stamp < high:
            raise OutputError(
                f"cannot write the stamp {stamp} s to a {self._where}: its seconds must lie in {low} to {high - 1}"
            )
        # by the decimal digits of the stamp: those of 1700000000.123456 are meant, not the float64's further ones
        return round(Decimal(repr(stamp)) * _SECOND)

    def encoded(self, message: Any, msgtype: str) -> bytes | memoryview:
        """Return a message's bytes."""
        serialize = self.store.serialize_ros1 if self._is_ros1 else self.store.serialize_cdr
        return serialize(message, msgtype)

    def definition(self, msgtype: str) -> str:
        """Return the text that defines a type, those inside it included."""
        text, _ = self.store.generate_msgdef(msgtype, ros_version=1 if self._is_ros1 else 2)
        return text

    def laser_scan(self, scan: LaserScan) -> tuple[Any, bool]:
        """Return a scan as sensor_msgs/LaserScan, and whether all its numbers are kept as they are."""
        if not scan.has_uniform_angles:
            raise OutputError(
                f"cannot write the scan at {scan.stamp} s to a ROS bag: a LaserScan message has evenly spaced beams, "
                "these are not; CSV and NPZ keep them"
            )
        last = scan.angle_min + max(len(scan) - 1, 0) * scan.angle_increment
        names = ("angle_min", "angle_increment", "time_increment", "scan_time", "range_min", "range_max")
        fields = {"angle_max": last} | {name: float(getattr(scan, name)) for name in names}
        with np.errstate(over="ignore", under="ignore"):
            short = {name: float(np.float32(value)) for name, value in fields.items()}
            ranges = scan.ranges.astype(np.float32)
            strengths = () if scan.intensities is None else scan.intensities
            intensities = np.asarray(strengths, dtype=np.float64).astype(np.float32)
        if not (short["angle_increment"] != 0.0 and short["range_min"] < short["range_max"]):
            raise OutputError(
                f"cannot write the scan at {scan.stamp} s to a ROS bag: float32 makes angle_increment 0, or range_min "
                "and range_max equal"
            )
        header = self._header(scan.stamp, LASER_FRAME)
        message = self._message(LASER_SCAN, short | {"header": header, "ranges": ranges, "intensities": intensities})
        # inf, a missing limit, and all that came from a message stay the same; angle_max is not ours
        is_same = np.array_equal(ranges.astype(np.float64), scan.ranges, equal_nan=True)
        return message, is_same and all(short[k] == v for k, v in fields.items() if k != "angle_max")

    def odometry(
        self,
        stamp: float,
        pose: Pose,
        covariance: Cov | None = None,
        twist: Floats | None = None,
        twist_covariance: Cov | None = None,
    ) -> Any:
        """Return a pose (3,) of the laser as nav_msgs/Odometry, covariance None: zero, twist None: unknown speed."""
        vx, vy, omega = (0.0, 0.0, 0.0) if twist is None else twist.tolist()
        pose_covariance, speed_covariance = np.zeros((6, 6)), np.diag(np.full(6, _UNKNOWN))
        if covariance is not None:
            pose_covariance[np.ix_(_PLANAR, _PLANAR)] = covariance
        if twist_covariance is not None:
            speed_covariance[np.ix_(_PLANAR, _PLANAR)] = twist_covariance
        twist_fields = {"linear": _vector(vx, vy), "angular": _vector(0.0, 0.0, omega)}
        return self._message(
            ODOMETRY,
            {
                "header": self._header(stamp, ODOM_FRAME),
                "child_frame_id": LASER_FRAME,
                "pose": {"pose": _pose(pose, "position", "orientation"), "covariance": pose_covariance.ravel()},
                "twist": {"twist": twist_fields, "covariance": speed_covariance.ravel()},
            },
        )

    def transforms(self, stamp: float, edges: Sequence[tuple[str, str, Pose]]) -> Any:
        """Return poses of frames in their parents as tf2_msgs/TFMessage."""
        items = [
            self._message(
                "geometry_msgs/msg/TransformStamped",
                {
                    "header": self._header(stamp, parent),
                    "child_frame_id": child,
                    "transform": _pose(pose, "translation", "rotation"),
                },
            )
            for parent, child, pose in edges
        ]
        return self._message(TRANSFORMS[0], {"transforms": items})

    def occupancy_grid(
        self, stamp: float, percent: NDArray[np.int8], origin: Floats, resolution: float, frame: str
    ) -> Any:
        """Return a map as nav_msgs/OccupancyGrid.

        percent (n_rows, n_columns): Probability of occupancy, 0 to 100; -1 where nothing is known. The first row has
        the smallest y; origin (2,).
        """
        header = self._header(stamp, frame)
        info = {
            "map_load_time": header["stamp"],
            "resolution": float(np.float32(resolution)),
            "width": percent.shape[1],
            "height": percent.shape[0],
            "origin": _pose(np.array([*origin, 0.0]), "position", "orientation"),
        }
        return self._message(OCCUPANCY_GRID, {"header": header, "info": info, "data": percent.ravel()})

    def _header(self, stamp: float, frame: str) -> dict[str, Any]:
        seconds, rest = divmod(self.nanoseconds(stamp), _SECOND)
        header = {"stamp": {"sec": seconds, "nanosec": rest}, "frame_id": frame}
        return header | {"seq": 0} if self._is_ros1 else header

    def _message(self, msgtype: str, fields: dict[str, Any]) -> Any:
        """Return a message of its fields; the fields of a message in it are a dictionary again."""
        kinds = dict(self.store.fielddefs[msgtype][1])
        values = {
            name: self._message(str(kinds[name][1]), value) if isinstance(value, dict) else value
            for name, value in fields.items()
        }
        return self.store.types[msgtype](**values)


def _vector(x: float, y: float, z: float = 0.0) -> dict[str, float]:
    return {"x": x, "y": y, "z": z}


def _pose(pose: Pose, place: str, direction: str) -> dict[str, dict[str, float]]:
    x, y, theta = pose.tolist()
    return {place: _vector(x, y), direction: {**_vector(0.0, 0.0, math.sin(0.5 * theta)), "w": math.cos(0.5 * theta)}}
