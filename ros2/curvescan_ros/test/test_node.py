"""The node over a real middleware: a publisher process plays scans, and what comes back equals offline to the bit."""

import os
import subprocess
import sys
import threading
import time
from pathlib import Path

import numpy as np
import pytest

rclpy = pytest.importorskip(
    "rclpy", reason="ROS 2 is not installed: `make test-ros` installs it into a venv of its own"
)

HERE = Path(__file__).parent
DOMAIN = str(40 + os.getpid() % 60)
os.environ |= {
    "ROS_DOMAIN_ID": DOMAIN,
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    "PYTHONPATH": os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")]),
}
sys.path.insert(0, str(HERE.parent))

from curvescan_ros.messages import odometry_message  # noqa: E402
from curvescan_ros.node import LATCHED, CurvescanNode  # noqa: E402
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from nav_msgs.msg import OccupancyGrid, Odometry  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.qos import QoSProfile  # noqa: E402
from sensor_msgs.msg import LaserScan  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

import curvescan  # noqa: E402
from curvescan.live.base_motion import BaseMotion  # noqa: E402


def real_log():
    """The TurtleBot's log where it is to be had, else a simulated one."""
    data = Path(os.environ.get("CURVESCAN_DATA", HERE.parents[3] / "shared" / "data"))
    path = data / "turtlebot4-rplidar" / "macfirst_floor_take_2"
    if path.exists():
        return curvescan.read_log(path)
    return curvescan.simulate("office", sensor="spinning-360", n_scans=120, seed=2)


@pytest.fixture(scope="session", autouse=True)
def middleware():
    rclpy.init()
    yield
    rclpy.shutdown()


@pytest.fixture(scope="session")
def scans():
    return list(real_log())


@pytest.fixture(scope="session")
def scans_file(scans, tmp_path_factory):
    first = scans[0]
    path = tmp_path_factory.mktemp("scans") / "scans.npz"
    np.savez(
        path,
        ranges=np.array([scan.ranges for scan in scans], dtype=np.float32),
        nanoseconds=[round(scan.stamp * 1e9) for scan in scans],
        **{
            name: getattr(first, name)
            for name in (
                "angle_min",
                "angle_increment",
                "range_min",
                "range_max",
                "time_increment",
                "scan_time",
            )
        },
    )
    return path


class Bench:
    """A node, spun in a thread, and a listener that keeps what it says."""

    def __init__(self, **parameters):
        given = {"mode": "odometry", "map_period": 0.5} | parameters
        overrides = [Parameter(name, value=value) for name, value in given.items()]
        self.node = CurvescanNode(parameter_overrides=overrides)
        self.listener = rclpy.create_node("listener")
        self.odom, self.arrivals, self.maps, self.reports, self.tf = [], [], [], [], []
        # reliable and deep: a message that this test misses is no message that the node dropped
        self.listener.create_subscription(Odometry, "odom", self._on_odom, QoSProfile(depth=1000))
        self.listener.create_subscription(OccupancyGrid, "map", self.maps.append, LATCHED)
        self.listener.create_subscription(DiagnosticArray, "diagnostics", self.reports.append, 10)
        self._executors = []
        for node in (self.node, self.listener):
            executor = SingleThreadedExecutor()
            executor.add_node(node)
            thread = threading.Thread(target=executor.spin, daemon=True)
            thread.start()
            self._executors.append((executor, thread))

    def _on_odom(self, message):
        self.odom.append(message)
        self.arrivals.append(time.time())

    def play(self, path, rate):
        """Play scans, and wait until the node has answered what it holds: a busy machine must not fail the test."""
        player = [sys.executable, HERE / "player.py", path, str(rate)]
        subprocess.run(player, check=True, timeout=300)
        n = -1
        while n != len(self.odom):
            n = len(self.odom)
            time.sleep(3.0)

    def call(self, service):
        client = self.listener.create_client(Trigger, service)
        assert client.wait_for_service(10.0)
        future = client.call_async(Trigger.Request())
        deadline = time.monotonic() + 10.0
        while not future.done() and time.monotonic() < deadline:
            time.sleep(0.02)
        return future.result()

    def close(self):
        for executor, thread in self._executors:
            executor.shutdown()
            thread.join()
        self.node.close()
        self.node.destroy_node()
        self.listener.destroy_node()


@pytest.fixture
def bench():
    made = []

    def make(**parameters):
        made.append(Bench(**parameters))
        return made[-1]

    yield make
    for one in made:
        one.close()


def offline(messages_like, scans):
    """What the node must say of each scan."""
    odometry, motion = curvescan.Odometry(), BaseMotion(np.zeros(3))
    for message, scan in zip(messages_like, scans, strict=True):
        state = motion.add(odometry.add(scan), scan.stamp)
        yield odometry_message(message.header.stamp, state, "odom", "laser")


def as_message_has_it(scan, first):
    """A scan after float32 and whole nanoseconds, with the times of the first as the player has them."""
    return curvescan.LaserScan(
        scan.ranges.astype(np.float32),
        angle_min=float(np.float32(scan.angle_min)),
        angle_increment=float(np.float32(scan.angle_increment)),
        range_min=float(np.float32(scan.range_min)),
        range_max=float(np.float32(scan.range_max)),
        time_increment=float(np.float32(first.time_increment)),
        scan_time=float(np.float32(first.scan_time)),
        stamp=stamp_of_nanoseconds(round(scan.stamp * 1e9)),
    )


def stamp_of_nanoseconds(nanoseconds):
    from builtin_interfaces.msg import Time
    from std_msgs.msg import Header

    from curvescan.io.ros.messages import stamp_of

    return stamp_of(Header(stamp=Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)))


def test_every_scan_is_answered_and_equals_offline_to_the_bit(bench, scans, scans_file):
    made = bench()
    made.play(scans_file, 40.0)
    assert len(made.odom) == len(scans)
    expected = offline(made.odom, [as_message_has_it(scan, scans[0]) for scan in scans])
    for message, other in zip(made.odom, expected, strict=True):
        assert message.pose.pose == other.pose.pose
        assert np.array_equal(message.pose.covariance, other.pose.covariance)
        assert np.array_equal(message.twist.covariance, other.twist.covariance)
        assert message.twist.twist == other.twist.twist
    # no leap: a step is what the twist says
    xy = np.array([(m.pose.pose.position.x, m.pose.pose.position.y) for m in made.odom])
    assert np.hypot(*np.diff(xy, axis=0).T).max() < 0.5
    grid = made.maps[-1]
    assert len(grid.data) == grid.info.width * grid.info.height > 0
    assert {-1, *range(101)} >= set(grid.data)
    status = made.reports[-1].status[0]
    values = {item.key: item.value for item in status.values}
    assert int(values["scans"]) == len(scans)
    assert int(values["lost by the middleware"]) == 0


def test_what_is_missing_is_said(bench):
    made = bench()
    time.sleep(2.5)
    status = made.reports[-1].status[0]
    assert status.level == status.ERROR
    assert "nobody publishes /scan" in status.message
    made.listener.create_publisher(LaserScan, "front/scan", 1)
    time.sleep(2.5)
    assert "laser scans are on /front/scan: remap scan" in made.reports[-1].status[0].message


def test_services(bench, scans_file, tmp_path):
    made = bench(map_file=str(tmp_path / "floor.csmap"))
    made.play(scans_file, 100.0)
    answer = made.call("/curvescan/save_map")
    assert answer.success, answer.message
    assert (tmp_path / "floor.pgm").read_bytes().startswith(b"P5")
    assert made.call("/curvescan/reset").success
    n = len(made.odom)
    made.play(scans_file, 100.0)
    first = made.odom[n].pose.pose
    assert (first.position.x, first.position.y, first.orientation.z) == (0.0, 0.0, 0.0)


def test_transforms(bench, scans_file):
    tf2 = pytest.importorskip("tf2_msgs.msg", reason="tf2_msgs is not built")
    from geometry_msgs.msg import TransformStamped
    from rclpy.qos import DurabilityPolicy

    made = bench(mode="slam")
    static = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
    publisher = made.listener.create_publisher(tf2.TFMessage, "/tf_static", static)
    mount = TransformStamped()
    mount.header.frame_id, mount.child_frame_id = "base_link", "laser"
    mount.transform.translation.x = 0.3
    mount.transform.rotation.z = mount.transform.rotation.w = np.sqrt(0.5)
    publisher.publish(tf2.TFMessage(transforms=[mount]))
    made.listener.create_subscription(tf2.TFMessage, "/tf", made.tf.append, QoSProfile(depth=1000))
    made.play(scans_file, 40.0)
    names = [[(t.header.frame_id, t.child_frame_id) for t in m.transforms] for m in made.tf]
    assert names
    assert all(n == [("odom", "base_link"), ("map", "odom")] for n in names)
    assert made.odom[0].child_frame_id == "base_link"


def test_base_and_laser_agree():
    """A base that turns on the spot, a laser ahead of it: the laser moves sideways, the base does not."""
    mount = np.array([0.5, 0.0, np.pi / 2])
    motion, covariance = BaseMotion(mount), np.eye(3) * 1e-4
    before = np.zeros(3)
    for k in range(11):
        base = np.array([0.0, 0.0, 0.1 * k])
        laser_in_world = curvescan.se2.compose(base, mount)
        pose = curvescan.se2.between(mount, laser_in_world)  # frame of the first scan
        moved = curvescan.se2.between(before, pose)
        state = motion.add(step_of(pose, covariance, moved), 0.1 * k)
        before = pose
    assert state.odom_base.pose == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert state.twist == pytest.approx([0.0, 0.0, 1.0], abs=1e-9)
    assert state.map_odom == pytest.approx([0.0, 0.0, 0.0], abs=1e-9)


def test_a_leap_of_the_odometry_is_none_of_odom():
    """Ten steps of 0.1 m, at the last of which the odometry finds that it has drifted by half a metre."""
    motion, covariance = BaseMotion(np.zeros(3)), np.eye(3) * 1e-4
    for k in range(11):
        pose = np.array([0.1 * k - 0.5 * (k == 10), 0.0, 0.0])
        moved = np.array([0.1 * (k > 0), 0.0, 0.0])
        state = motion.add(step_of(pose, covariance, moved), 0.1 * k)
    assert state.odom_base.pose == pytest.approx([1.0, 0.0, 0.0])
    assert state.odom_base.cov[0, 0] == pytest.approx(0.25 + 1e-4)
    assert state.twist == pytest.approx([1.0, 0.0, 0.0])
    assert state.map_odom == pytest.approx([-0.5, 0.0, 0.0])


def test_map_odom_waits_until_the_laser_has_been_found():
    motion, covariance = BaseMotion(np.zeros(3)), np.eye(3) * 1e-4
    unknown = step_of(np.full(3, np.nan), np.full((3, 3), np.nan), np.zeros(3))
    unknown.pose_odom, unknown.covariance_odom = np.zeros(3), covariance
    state = motion.add(unknown, 0.0)
    assert state.map_odom is None
    assert np.isfinite(state.odom_base.cov).all()
    found = motion.add(step_of(np.array([2.0, 1.0, 0.0]), covariance, np.zeros(3)), 0.1)
    assert found.map_odom == pytest.approx([2.0, 1.0, 0.0])
    assert motion.add(unknown, 0.2).map_odom == pytest.approx([2.0, 1.0, 0.0])


def step_of(pose, covariance, moved):
    from types import SimpleNamespace

    return SimpleNamespace(
        pose=pose, covariance=covariance, motion=moved, motion_covariance=covariance
    )
