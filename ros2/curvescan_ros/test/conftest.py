"""A node, a listener and a player of scans, in a domain of their own on this machine alone."""

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
os.environ |= {
    "ROS_DOMAIN_ID": str(40 + os.getpid() % 60),
    "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
    "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
    "PYTHONPATH": os.pathsep.join([str(HERE.parent), os.environ.get("PYTHONPATH", "")]),
}
sys.path.insert(0, str(HERE.parent))

from curvescan_ros.node import LATCHED, CurvescanNode  # noqa: E402
from diagnostic_msgs.msg import DiagnosticArray  # noqa: E402
from geometry_msgs.msg import PoseWithCovarianceStamped  # noqa: E402
from nav_msgs.msg import OccupancyGrid, Odometry  # noqa: E402
from rclpy.executors import SingleThreadedExecutor  # noqa: E402
from rclpy.parameter import Parameter  # noqa: E402
from rclpy.qos import QoSProfile  # noqa: E402
from std_srvs.srv import Trigger  # noqa: E402

import curvescan  # noqa: E402


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


def save_scans(path, log, wheels=None):
    """Write scans, and the poses of wheels at their times, for player.py."""
    scans = list(log)
    names = ("angle_min", "angle_increment", "range_min", "range_max", "time_increment", "scan_time")
    np.savez(
        path,
        ranges=np.array([scan.ranges for scan in scans], dtype=np.float32),
        nanoseconds=[round(scan.stamp * 1e9) for scan in scans],
        wheels=np.empty((0, 3)) if wheels is None else wheels,
        **{name: getattr(scans[0], name) for name in names},
    )
    return path


@pytest.fixture(scope="session")
def scans_file(scans, tmp_path_factory):
    return save_scans(tmp_path_factory.mktemp("scans") / "scans.npz", scans)


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
        self.poses = []
        self.listener.create_subscription(PoseWithCovarianceStamped, "pose", self.poses.append, QoSProfile(depth=1000))
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

    def play(self, path, rate, player="player.py"):
        """Play scans, and wait until the node has answered what it holds: a busy machine must not fail the test."""
        subprocess.run([sys.executable, HERE / player, path, str(rate)], check=True, timeout=300)
        n = -1
        while n != len(self.odom):
            n = len(self.odom)
            time.sleep(3.0)

    def call(self, service, kind=Trigger, request=None):
        client = self.listener.create_client(kind, service)
        assert client.wait_for_service(10.0)
        future = client.call_async(Trigger.Request() if request is None else request)
        deadline = time.monotonic() + 120.0  # to configure compiles kernels
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
        while made:  # two nodes would answer each other's scans
            made.pop().close()
        made.append(Bench(**parameters))
        return made[-1]

    yield make
    for one in made:
        one.close()
