"""The node: scan in; odom, /tf, map and diagnostics out; reset and save_map as services."""

from __future__ import annotations

import contextlib
import sys
import time
from bisect import bisect_left
from collections import deque
from pathlib import Path

import numpy as np
import rclpy
from diagnostic_msgs.msg import DiagnosticArray
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException
from rclpy.node import Node
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.time import Time
from sensor_msgs.msg import LaserScan as ScanMessage
from std_srvs.srv import Trigger

import curvescan
from curvescan import se2
from curvescan.deskew import middle_of_sweep
from curvescan.io.config import read_config
from curvescan.io.ros.laser_scan import scan_of
from curvescan.io.ros.messages import BrokenMessageError
from curvescan.io.ros.transforms import FrameTree
from curvescan.live import Tracker
from curvescan.live.base_motion import BaseMotion
from curvescan.live.warm_up import warm_up
from curvescan.matchers.registry import find_matcher
from curvescan.odometry import OdometryConfig
from curvescan.scan import mirrored
from curvescan_ros.diagnosis import Diagnosis
from curvescan_ros.map_publisher import MapPublisher
from curvescan_ros.messages import (
    add_transforms,
    later,
    map_message,
    mount_of,
    odometry_message,
    pose_of,
    transform_message,
)

PARAMETERS = {
    "base_frame": "base_link",
    "odom_frame": "odom",
    "map_frame": "map",
    "publish_tf": True,
    "publish_map": True,
    "map_period": 2.0,
    "use_odom_prior": False,
    "config": "",
    "mode": "slam",
    "method": "curvescan",
    "map_file": "",
}
"""Parameters and their defaults."""

SENSOR_DATA = QoSProfile(depth=200, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.BEST_EFFORT)
"""As rclpy's qos_profile_sensor_data, with room for a hiccup: a scan that is dropped is a motion twice as large."""

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)

MOUNT_PATIENCE = 2.0
"""Scans wait so long for the laser's mount in /tf_static before they are refused, seconds."""


class CurvescanNode(Node):
    """The node; docs/ros2.md lists its topics, parameters and services."""

    def __init__(self, **kwargs: object) -> None:
        super().__init__("curvescan", **kwargs)
        p = {name: self.declare_parameter(name, value).value for name, value in PARAMETERS.items()}
        self._p = p
        is_localizing = p["mode"] == "localization"
        self._saved_map = curvescan.load_map(p["map_file"]) if is_localizing else None
        started = time.monotonic()
        self._tracker = self._new_tracker()
        warm_up(lambda: self._new_tracker().engine, p["method"])
        self.get_logger().info(f"kernels are ready after {time.monotonic() - started:.1f} s")
        self._tree, self._motion, self._is_mirrored = FrameTree(), None, False
        self._wheels: deque[tuple[float, np.ndarray]] = deque(maxlen=400)
        self._diagnosis = Diagnosis()
        self._started_at = time.monotonic()
        self._odom = self.create_publisher(Odometry, "odom", 10)
        self._map = self.create_publisher(OccupancyGrid, "map", LATCHED)
        self._report = self.create_publisher(DiagnosticArray, "diagnostics", 10)
        self._tf = self._open_tf()
        self._map_sink = self._new_map_sink()
        self.create_service(Trigger, "~/reset", self._on_reset)
        self.create_service(Trigger, "~/save_map", self._on_save_map)
        self.create_timer(1.0, self._on_timer)
        if p["use_odom_prior"]:
            self.create_subscription(Odometry, "wheel_odom", self._on_wheels, SENSOR_DATA)
        # last of all: nothing is dropped while kernels compile
        self._scan = self.create_subscription(
            ScanMessage,
            "scan",
            self._on_scan,
            SENSOR_DATA,
            event_callbacks=SubscriptionEventCallbacks(message_lost=self._on_lost),
        )

    def close(self) -> None:
        """Stop the map's thread."""
        self._map_sink.close()

    def _new_tracker(self) -> Tracker:
        mode, method = self._p["mode"], self._p["method"]
        if self._saved_map is not None:
            return Tracker(curvescan.Localizer(self._saved_map))
        if mode == "slam":
            return Tracker(curvescan.Slam(method))
        if mode != "odometry":
            raise curvescan.InvalidArgumentError(f"mode must be odometry, slam or localization, got {mode!r}")
        if not self._p["config"]:
            return Tracker(curvescan.Odometry(method))
        defaults = {method: find_matcher(method).config, "odometry": OdometryConfig()}
        read = read_config(self._p["config"], defaults)
        return Tracker(curvescan.Odometry(method, matcher=read[method], config=read["odometry"]))

    def _new_map_sink(self) -> MapPublisher:
        def publish(grid: object) -> None:
            if self._p["publish_map"] and rclpy.ok():
                stamp = self.get_clock().now().to_msg()
                self._map.publish(map_message(stamp, grid, self._map_parent()))

        return MapPublisher(
            publish, period=self._p["map_period"], is_revisable=self._p["mode"] == "slam", saved_map=self._saved_map
        )

    def _map_parent(self) -> str:
        return self._p["odom_frame" if self._p["mode"] == "odometry" else "map_frame"]

    def _open_tf(self) -> object | None:
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError:
            self.get_logger().error("tf2_msgs is not installed: no transform is read or published")
            return None
        static = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(TFMessage, "/tf_static", lambda m: add_transforms(self._tree, m), static)
        self._tf_type = TFMessage
        return self.create_publisher(TFMessage, "/tf", 100) if self._p["publish_tf"] else None

    def _on_scan(self, message: ScanMessage) -> None:
        received = time.monotonic()
        if self._motion is None and not self._find_mount(message.header.frame_id):
            return
        try:
            scan = scan_of(message)
        except BrokenMessageError as error:
            self._diagnosis.refuse(str(error))
            return
        if self._is_mirrored:
            scan = mirrored(scan)
        tracked = self._tracker.add(scan, received=received, odometry_pose=self._wheel_pose(scan))
        state = self._motion.add(tracked.step, scan.stamp)
        stamp = later(message.header.stamp, tracked.half_sweep)
        self._odom.publish(odometry_message(stamp, state, self._p["odom_frame"], self._child_frame))
        if self._tf is not None:
            self._publish_tf(stamp, state)
        self._map_sink.put(tracked)
        self._diagnosis.add(tracked, time.monotonic())

    def _publish_tf(self, stamp: object, state: object) -> None:
        p = self._p
        items = [transform_message(stamp, state.odom_base.pose, p["odom_frame"], self._child_frame)]
        if p["mode"] != "odometry" and state.map_odom is not None:
            items.append(transform_message(stamp, state.map_odom, p["map_frame"], p["odom_frame"]))
        self._tf.publish(self._tf_type(transforms=items))

    def _find_mount(self, laser_frame: str) -> bool:
        """Return whether the laser's place on the base is known; it is taken to be the base when tf stays silent."""
        found = mount_of(self._tree, self._p["base_frame"], laser_frame)
        if found is None and laser_frame != self._p["base_frame"]:
            if time.monotonic() - self._started_at < MOUNT_PATIENCE and self._has_tf():
                return False
            self.get_logger().warning(
                f"/tf_static has no way from {self._p['base_frame']} to {laser_frame}: poses are those of the laser"
            )
        mount, self._is_mirrored = (np.zeros(3), False) if found is None else found
        self._child_frame = laser_frame if found is None else self._p["base_frame"]
        self._motion = BaseMotion(mount)
        return True

    def _has_tf(self) -> bool:
        return self.count_publishers("/tf_static") > 0

    def _on_wheels(self, message: Odometry) -> None:
        self._wheels.append((Time.from_msg(message.header.stamp).nanoseconds * 1e-9, pose_of(message)))

    def _wheel_pose(self, scan: curvescan.LaserScan) -> np.ndarray | None:
        """Return the laser's pose by the wheels in the middle of a sweep, interpolated; None where that is not known."""
        if len(self._wheels) < 2:
            return None
        stamp = scan.stamp + middle_of_sweep(scan)
        stamps = [when for when, _ in self._wheels]
        k = min(max(bisect_left(stamps, stamp), 1), len(stamps) - 1)
        (t0, a), (t1, b) = self._wheels[k - 1], self._wheels[k]
        if not (t0 < t1 and t0 - 0.2 <= stamp <= t1 + 0.2):
            return None
        step = se2.exp((stamp - t0) / (t1 - t0) * se2.log(se2.between(a, b)))
        return se2.compose(se2.compose(a, step), self._motion.mount)

    def _on_lost(self, info: object) -> None:
        self._diagnosis.n_lost += info.total_count_change

    def _on_timer(self) -> None:
        report = DiagnosticArray()
        report.header.stamp = self.get_clock().now().to_msg()
        report.status = [self._diagnosis.status(time.monotonic(), self._missing())]
        self._report.publish(report)

    def _missing(self) -> str:
        """Return what is missing when no scan comes."""
        topic = self._scan.topic_name
        infos = self.get_publishers_info_by_topic(topic)
        if not infos:
            types = dict(self.get_topic_names_and_types())
            others = [n for n, t in types.items() if "sensor_msgs/msg/LaserScan" in t and n != topic]
            hint = f"; laser scans are on {', '.join(others)}: remap scan" if others else ""
            return f"nobody publishes {topic}: is the laser's driver running?{hint}"
        wrong = {i.topic_type for i in infos} - {"sensor_msgs/msg/LaserScan"}
        if wrong:
            return f"{topic} carries {', '.join(wrong)}, not sensor_msgs/msg/LaserScan"
        if self._motion is None and self._diagnosis.n_scans == 0:
            return f"{topic} has a publisher, and no scan has come"
        return f"{topic} has a publisher, and it has fallen silent"

    def _on_reset(self, _: object, answer: Trigger.Response) -> Trigger.Response:
        self._map_sink.close()
        self._tracker, self._motion = self._new_tracker(), None
        self._map_sink = self._new_map_sink()
        answer.success, answer.message = True, "odometry and map start anew at the next scan"
        return answer

    def _on_save_map(self, _: object, answer: Trigger.Response) -> Trigger.Response:
        from curvescan.mapping.map_server import write_map

        path = Path(self._p["map_file"] or "map.csmap")
        try:
            saved = getattr(self._tracker.engine, "map", None)
            if saved is not None:
                saved.save(path)
            write_map(path.parent, self._map_sink.grid(), path.stem)
        except (curvescan.CurvescanError, OSError) as error:
            answer.success, answer.message = False, str(error)
        else:
            answer.success, answer.message = True, f"wrote {path.with_suffix('.yaml').absolute()}"
        return answer


def main() -> None:
    """Run the node until Ctrl-C."""
    rclpy.init()
    try:
        node = CurvescanNode()
    except curvescan.CurvescanError as error:
        sys.exit(f"curvescan: {error}")
    with contextlib.suppress(KeyboardInterrupt, ExternalShutdownException):
        rclpy.spin(node)
    node.close()
    node.destroy_node()
    rclpy.try_shutdown()


if __name__ == "__main__":
    main()
