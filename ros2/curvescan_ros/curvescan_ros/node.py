"""The node: scan in; odom, pose, /tf, map and diagnostics out; reset and save_map as services; a lifecycle for Nav2."""

from __future__ import annotations

import contextlib
import sys
import time
from bisect import bisect_left
from collections import deque
from functools import partial
from pathlib import Path

import numpy as np
import rclpy
from builtin_interfaces.msg import Time as TimeMessage
from diagnostic_msgs.msg import DiagnosticArray
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav_msgs.msg import OccupancyGrid, Odometry
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.executors import ExternalShutdownException
from rclpy.lifecycle import LifecycleNode, State, TransitionCallbackReturn
from rclpy.qos import DurabilityPolicy, HistoryPolicy, QoSProfile, ReliabilityPolicy
from rclpy.service import Service
from rclpy.time import Time
from rclpy.timer import Timer
from sensor_msgs.msg import LaserScan as ScanMessage
from std_srvs.srv import Trigger

import curvescan
from curvescan import se2
from curvescan.deskew import middle_of_sweep
from curvescan.diagnostics.preparation import StreamMender
from curvescan.engines.rig import RigJoiner
from curvescan.io.config import read_config
from curvescan.io.files.lines import BrokenRecordError
from curvescan.io.ros.messages import scan_of
from curvescan.io.ros.transforms import FrameTree, frame_name
from curvescan.live import Tracker
from curvescan.live.base_motion import BaseMotion
from curvescan.live.live_map import warm_up
from curvescan.matchers.registry import find_matcher
from curvescan.odometry import OdometryConfig
from curvescan.scan import mirrored
from curvescan.se2 import uncertain
from curvescan.types import UncertainPose
from curvescan_ros.diagnosis import Diagnosis
from curvescan_ros.map_publisher import MapPublisher
from curvescan_ros.messages import (
    add_transforms,
    grid_of,
    initial_pose_of,
    later,
    map_message,
    mount_of,
    odometry_message,
    pose_message,
    pose_of,
    transform_message,
    transform_pose,
)

PARAMETERS = {
    # as AMCL names them
    "base_frame_id": "base_link",
    "odom_frame_id": "odom",
    "global_frame_id": "map",
    "scan_topic": "scan",
    "scan_topics": [""],
    "map_topic": "map",
    "tf_broadcast": True,
    "transform_tolerance": 1.0,
    "set_initial_pose": False,
    "initial_pose.x": 0.0,
    "initial_pose.y": 0.0,
    "initial_pose.yaw": 0.0,
    # as slam_toolbox and Cartographer do
    "use_lifecycle_manager": False,
    "provide_odom_frame": True,
    "mode": "slam",
    "method": "curvescan",
    "config": "",
    "map_file": "",
    "publish_map": True,
    "map_period": 2.0,
    "use_odom_prior": False,
    "as_is": False,
}
"""Parameters and their defaults."""

SENSOR_DATA = QoSProfile(depth=200, history=HistoryPolicy.KEEP_LAST, reliability=ReliabilityPolicy.BEST_EFFORT)
"""As rclpy's qos_profile_sensor_data, with room for a hiccup: a scan that is dropped is a motion twice as large."""

LATCHED = QoSProfile(depth=1, reliability=ReliabilityPolicy.RELIABLE, durability=DurabilityPolicy.TRANSIENT_LOCAL)

MOUNT_PATIENCE = 2.0
"""Scans wait so long for the laser's mount in /tf_static before they are refused, seconds."""


class CurvescanNode(LifecycleNode):
    """The node; docs/ros2.md lists its topics, parameters, services and states."""

    def __init__(self, **kwargs: object) -> None:
        super().__init__("curvescan", **kwargs)
        for name, value in PARAMETERS.items():
            self.declare_parameter(name, value)
        self._p = self._read_parameters()
        self._tracker: Tracker | None = None
        self._map_sink: MapPublisher | None = None
        self._fault: curvescan.CurvescanError | None = None
        self._tree, self._motion, self._is_mirrored = FrameTree(), None, False
        self._tf_type, self._tf = self._open_tf(), None
        self._initial: UncertainPose | None = None  # of the base, to be taken up with the next scan
        self._map_odom: np.ndarray | None = None  # with somebody else's odom
        self._joiner: RigJoiner | None = None  # of several lasers
        self._frames: dict[str, str] = {}  # of each, by its topic
        self._menders: dict[str, StreamMender] = {}  # of each, by its topic
        self._mounts: dict[str, tuple[np.ndarray, bool]] = {}  # on the base, and whether mirrored
        self._heard: list[object] = []  # subscriptions, services and timers of the active state
        if not self._p["use_lifecycle_manager"]:
            self.trigger_configure()
            if self._fault is not None:
                raise self._fault
            self.trigger_activate()

    def on_configure(self, state: State) -> TransitionCallbackReturn:
        """Load the map and compile the kernels."""
        started = time.monotonic()
        self._p = self._read_parameters()  # as AMCL: what was set since takes effect
        try:
            self._tracker = self._new_tracker()
            warm_up(lambda: curvescan.Odometry(self._p["method"]), self._p["method"])
        except curvescan.CurvescanError as error:
            self._fault = error
            self.get_logger().error(str(error))
            return TransitionCallbackReturn.FAILURE
        self.get_logger().info(f"kernels are ready after {time.monotonic() - started:.1f} s")
        self._wheels: deque[tuple[float, np.ndarray]] = deque(maxlen=400)
        self._diagnosis = Diagnosis()
        self._odom = self.create_publisher(Odometry, "odom", 10)
        self._map = self.create_publisher(OccupancyGrid, "map", LATCHED)
        self._pose = self.create_publisher(PoseWithCovarianceStamped, "pose", LATCHED)
        self._report = self.create_publisher(DiagnosticArray, "diagnostics", 10)
        if self._tf_type is not None and self._p["tf_broadcast"]:
            self._tf = self.create_publisher(self._tf_type, "/tf", 100)
        return TransitionCallbackReturn.SUCCESS

    def on_activate(self, state: State) -> TransitionCallbackReturn:
        """Listen to the laser."""
        p = self._p
        self._started_at = time.monotonic()
        self._map_sink = self._new_map_sink()
        self._heard = [
            self.create_service(Trigger, "~/reset", self._on_reset),
            self.create_service(Trigger, "~/save_map", self._on_save_map),
            self.create_timer(1.0, self._on_timer),
            self.create_subscription(PoseWithCovarianceStamped, "/initialpose", self._on_initial_pose, 10),
        ]
        if p["use_odom_prior"] and p["provide_odom_frame"]:
            self._heard.append(self.create_subscription(Odometry, "wheel_odom", self._on_wheels, SENSOR_DATA))
        if self._is_localizing and not p["map_file"]:
            self._heard.append(self.create_subscription(OccupancyGrid, p["map_topic"], self._on_map, LATCHED))
        self._joiner = self._new_joiner()
        tell = self.get_logger().warning
        self._menders = {} if p["as_is"] else {topic: StreamMender(tell) for topic in self._topics}
        # last of all: nothing is dropped while kernels compile
        lost = SubscriptionEventCallbacks(message_lost=self._on_lost)
        self._scans = [
            self.create_subscription(
                ScanMessage, topic, partial(self._on_scan, topic), SENSOR_DATA, event_callbacks=lost
            )
            for topic in self._topics
        ]
        return super().on_activate(state)

    def on_deactivate(self, state: State) -> TransitionCallbackReturn:
        """Listen no more; where the sensor was last is still known."""
        self._silence()
        return super().on_deactivate(state)

    def on_cleanup(self, state: State) -> TransitionCallbackReturn:
        """Forget the map."""
        self._tracker = self._motion = self._map_odom = None
        for publisher in filter(None, (self._odom, self._map, self._pose, self._report, self._tf)):
            self.destroy_publisher(publisher)
        self._tf = None
        return TransitionCallbackReturn.SUCCESS

    def on_shutdown(self, state: State) -> TransitionCallbackReturn:
        """Stop the map's thread."""
        self._silence()
        return TransitionCallbackReturn.SUCCESS

    def close(self) -> None:
        """Stop the map's thread."""
        self._silence()

    def _silence(self) -> None:
        if self._map_sink is None:
            return
        self._map_sink.close()
        self._map_sink = None
        destroy = {Service: self.destroy_service, Timer: self.destroy_timer}
        for heard in (*self._heard, *self._scans):
            next((end for kind, end in destroy.items() if isinstance(heard, kind)), self.destroy_subscription)(heard)
        self._heard = []

    def _read_parameters(self) -> dict[str, object]:
        return {name: self.get_parameter(name).value for name in PARAMETERS}

    @property
    def _topics(self) -> list[str]:
        """Topics of the lasers: those of several, which are joined at the base, or one."""
        return list(filter(None, self._p["scan_topics"])) or [self._p["scan_topic"]]

    def _new_joiner(self) -> RigJoiner | None:
        return RigJoiner(len(self._topics)) if len(self._topics) > 1 else None

    @property
    def _is_localizing(self) -> bool:
        return self._p["mode"] == "localization"

    def _new_tracker(self) -> Tracker | None:
        """Return what estimates the poses; None where the map is still to come."""
        p = self._p
        mode, method = p["mode"], p["method"]
        if self._is_localizing:
            return self._in_map(p["map_file"]) if p["map_file"] else None
        if mode == "slam":
            return Tracker(curvescan.Slam(method))
        if mode != "odometry":
            raise curvescan.InvalidArgumentError(f"mode must be odometry, slam or localization, got {mode!r}")
        if not p["config"]:
            return Tracker(curvescan.Odometry(method))
        defaults = {method: find_matcher(method).config, "odometry": OdometryConfig()}
        read = read_config(p["config"], defaults)
        return Tracker(curvescan.Odometry(method, matcher=read[method], config=read["odometry"]))

    def _in_map(self, saved_map: object) -> Tracker:
        localizer = curvescan.Localizer(saved_map, method=self._p["method"])
        if self._p["set_initial_pose"]:
            self._initial = UncertainPose(
                np.array([self._p[f"initial_pose.{name}"] for name in ("x", "y", "yaw")]), np.full((3, 3), np.nan)
            )
        return Tracker(localizer)

    def _on_map(self, message: OccupancyGrid) -> None:
        """Localize in a map of map_server: the first one, as AMCL with first_map_only."""
        if self._tracker is not None:
            return
        try:
            self._tracker = self._in_map(grid_of(message))
        except curvescan.CurvescanError as error:
            self.get_logger().error(f"{self._p['map_topic']}: {error}")

    def _on_initial_pose(self, message: PoseWithCovarianceStamped) -> None:
        """Take up about where the base is, by RViz or another node; the next scans decide."""
        frame, wanted = message.header.frame_id.lstrip("/"), self._p["global_frame_id"]
        if not self._is_localizing or frame not in ("", wanted):
            why = f"its frame is {frame}, not {wanted}" if self._is_localizing else "it needs mode: localization"
            self.get_logger().warning(f"/initialpose is left out: {why}")
            return
        self._initial = initial_pose_of(message)

    def _take_initial_pose(self) -> None:
        """Tell the localizer about where the laser is, once it is known where it is on the base."""
        base, self._initial = self._initial, None
        assert base is not None
        try:
            if np.isnan(base.covariance).any():
                laser = se2.compose(base.pose, self._motion.mount), None
            else:
                laser = uncertain.compose(base, UncertainPose(self._motion.mount, np.zeros((3, 3))))
            self._tracker.engine.reset(*laser, keeps_odometry=True)
        except curvescan.CurvescanError as error:
            self.get_logger().warning(f"the initial pose is left out: {error}")

    def _new_map_sink(self) -> MapPublisher:
        def publish(grid: object) -> None:
            # a map of map_server is published by it
            is_ours = not self._is_localizing or self._p["map_file"]
            if self._p["publish_map"] and is_ours and rclpy.ok():
                stamp = self.get_clock().now().to_msg()
                self._map.publish(map_message(stamp, grid, self._map_parent()))

        return MapPublisher(
            publish,
            period=self._p["map_period"],
            is_revisable=self._p["mode"] == "slam",
            saved_map=self._tracker.engine.map if self._is_localizing and self._tracker is not None else None,
        )

    def _map_parent(self) -> str:
        return self._p["odom_frame_id" if self._p["mode"] == "odometry" else "global_frame_id"]

    def _open_tf(self) -> type | None:
        """Listen to what is where on the robot, and return the type of its messages; None where there is none."""
        try:
            from tf2_msgs.msg import TFMessage
        except ImportError:
            self.get_logger().error("tf2_msgs is not installed: no transform is read or published")
            return None
        static = QoSProfile(depth=100, durability=DurabilityPolicy.TRANSIENT_LOCAL)
        self.create_subscription(TFMessage, "/tf_static", lambda m: add_transforms(self._tree, m), static)
        if not self._p["provide_odom_frame"]:
            self.create_subscription(TFMessage, "/tf", self._on_tf, 100)
        return TFMessage

    def _on_scan(self, topic: str, message: ScanMessage) -> None:
        received = time.monotonic()
        if self._tracker is None or (self._joiner is None and not self._find_mount(message.header.frame_id)):
            return
        try:
            scan = scan_of(message)
        except BrokenRecordError as error:
            self._diagnosis.refuse(str(error))
            return
        if topic in self._menders:
            scan = self._menders[topic].add(scan)
        if self._joiner is None:
            scan = mirrored(scan) if self._is_mirrored else scan
            self._follow(scan, message.header.stamp, received)
            return
        self._frames[topic] = message.header.frame_id
        group = self._joiner.collect(topic, scan)
        if group is not None and (placed := self._placed(group)):
            joined = self._joiner.join(placed)
            self._follow(joined, later(TimeMessage(), joined.stamp), received)

    def _follow(self, scan: curvescan.LaserScan, scan_stamp: TimeMessage, received: float) -> None:
        """Take up a scan of the laser, or of all lasers as one at the base, and publish where it was."""
        if self._initial is not None:
            self._take_initial_pose()
        wheels = self._wheel_pose(scan)
        tracked = self._tracker.add(
            scan, received=received, odometry_pose=None if wheels is None else se2.compose(wheels, self._motion.mount)
        )
        state = self._motion.add(tracked.step, scan.stamp)
        stamp = later(scan_stamp, tracked.half_sweep)
        if self._joiner is not None:
            self._joiner.moved(scan, tracked.step.motion)
        self._odom.publish(odometry_message(stamp, state, self._p["odom_frame_id"], self._child_frame))
        in_map = None
        if self._p["mode"] != "odometry" and tracked.step.ok:
            in_map = self._motion.on_base(UncertainPose(tracked.step.pose, tracked.step.covariance))
            self._pose.publish(pose_message(stamp, in_map, self._p["global_frame_id"]))
        if self._tf is not None:
            self._publish_tf(stamp, state, in_map, wheels)
        self._map_sink.put(tracked)
        self._diagnosis.add(tracked, time.monotonic())

    def _publish_tf(
        self, stamp: object, state: object, in_map: UncertainPose | None, wheels: np.ndarray | None
    ) -> None:
        p, items = self._p, []
        map_odom = state.map_odom
        if p["provide_odom_frame"]:
            items.append(transform_message(stamp, state.odom_base.pose, p["odom_frame_id"], self._child_frame))
        else:  # somebody else's odom, where the base was at this scan
            if in_map is not None and wheels is not None:
                self._map_odom = se2.compose(in_map.pose, se2.inverse(wheels))
            map_odom = self._map_odom
        if p["mode"] != "odometry" and map_odom is not None:
            # it holds until the next one comes
            until = later(stamp, p["transform_tolerance"])
            items.append(transform_message(until, map_odom, p["global_frame_id"], p["odom_frame_id"]))
        if items:
            self._tf.publish(self._tf_type(transforms=items))

    def _on_tf(self, message: object) -> None:
        """Take note of where the base is in somebody else's odom."""
        for item in message.transforms:
            if frame_name(item.header.frame_id) != frame_name(self._p["odom_frame_id"]):
                continue
            below = mount_of(self._tree, item.child_frame_id, self._p["base_frame_id"])
            if below is not None or item.child_frame_id == self._p["base_frame_id"]:
                base = np.zeros(3) if below is None else below[0]
                stamp = Time.from_msg(item.header.stamp).nanoseconds * 1e-9
                self._wheels.append((stamp, se2.compose(transform_pose(item.transform), base)))

    def _placed(self, group: dict[str, curvescan.LaserScan]) -> dict[str, curvescan.LaserScan]:
        """Return the sweeps of lasers whose mounts are known; none while those of others may still come."""
        base = self._p["base_frame_id"]
        for topic in group.keys() - self._mounts.keys():
            if (found := mount_of(self._tree, base, self._frames[topic])) is not None:
                self._mounts[topic], self._joiner.rig = found, None
            elif time.monotonic() - self._started_at < MOUNT_PATIENCE:
                return {}
            else:
                frame = self._frames[topic]
                self._diagnosis.refuse(f"{topic} is left out: /tf_static has no way from {base} to {frame}")
        self._child_frame, self._motion = base, self._motion or BaseMotion(np.zeros(3))
        if self._joiner.rig is None and self._mounts:
            self._joiner.rig = curvescan.Rig({name: mount for name, (mount, _) in self._mounts.items()})
        known = {topic: (scan, self._mounts[topic][1]) for topic, scan in group.items() if topic in self._mounts}
        return {topic: mirrored(scan) if hangs else scan for topic, (scan, hangs) in known.items()}

    def _find_mount(self, laser_frame: str) -> bool:
        """Return whether the laser's place on the base is known; it is taken to be the base when tf stays silent."""
        if self._motion is not None:
            return True
        found = mount_of(self._tree, self._p["base_frame_id"], laser_frame)
        if found is None and laser_frame != self._p["base_frame_id"]:
            if time.monotonic() - self._started_at < MOUNT_PATIENCE and self._has_tf():
                return False
            self.get_logger().warning(
                f"/tf_static has no way from {self._p['base_frame_id']} to {laser_frame}: poses are those of the laser"
            )
        mount, self._is_mirrored = (np.zeros(3), False) if found is None else found
        self._child_frame = laser_frame if found is None else self._p["base_frame_id"]
        self._motion = BaseMotion(mount)
        return True

    def _has_tf(self) -> bool:
        return self.count_publishers("/tf_static") > 0

    def _on_wheels(self, message: Odometry) -> None:
        self._wheels.append((Time.from_msg(message.header.stamp).nanoseconds * 1e-9, pose_of(message)))

    def _wheel_pose(self, scan: curvescan.LaserScan) -> np.ndarray | None:
        """Return the base's pose by the wheels in the middle of a sweep, interpolated; None where that is not known."""
        if len(self._wheels) < 2:
            return None
        stamp = scan.stamp + middle_of_sweep(scan)
        stamps = [when for when, _ in self._wheels]
        k = min(max(bisect_left(stamps, stamp), 1), len(stamps) - 1)
        (t0, a), (t1, b) = self._wheels[k - 1], self._wheels[k]
        if not (t0 < t1 and t0 - 0.2 <= stamp <= t1 + 0.2):
            return None
        step = se2.exp((stamp - t0) / (t1 - t0) * se2.log(se2.between(a, b)))
        return se2.compose(a, step)

    def _on_lost(self, info: object) -> None:
        self._diagnosis.n_lost += info.total_count_change

    def _on_timer(self) -> None:
        report = DiagnosticArray()
        report.header.stamp = self.get_clock().now().to_msg()
        report.status = [self._diagnosis.status(time.monotonic(), self._missing())]
        self._report.publish(report)

    def _missing(self) -> str:
        """Return what is missing when no scan comes."""
        if self._tracker is None:
            return f"no map yet: nobody published {self._p['map_topic']}, and map_file is empty"
        topic = self._scans[0].topic_name
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
        if self._is_localizing and self._tracker is not None:
            self._tracker.engine.reset(keeps_odometry=True)
            self._map_odom = None
            answer.success, answer.message = True, "the sensor is looked for in the whole map"
            return answer
        self._map_sink.close()
        self._tracker, self._motion = self._new_tracker(), None
        self._joiner = self._new_joiner()
        self._map_sink = self._new_map_sink()
        answer.success, answer.message = True, "odometry and map start anew at the next scan"
        return answer

    def _on_save_map(self, _: object, answer: Trigger.Response) -> Trigger.Response:
        from curvescan.mapping.map_server import write_map

        path = Path(self._p["map_file"] or "map.csmap")
        try:
            saved = None if self._is_localizing else getattr(self._tracker.engine, "map", None)
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
