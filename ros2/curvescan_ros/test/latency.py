"""From scan to odom over the middleware, beside a node that only echoes: `python latency.py [SCANS_EACH]`.

A publisher plays a simulated drive at 10, 40 and 100 Hz and takes the time until the odometry of each scan has come back.
"""

import os
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import LaserScan

BEST_EFFORT = QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)
RATES = (10.0, 40.0, 100.0)
SERVERS = {"echo": ["--echo"], "odometry": ["--node", "odometry"], "slam": ["--node", "slam"]}


def echo() -> None:
    """Answer each scan by an empty odometry."""
    rclpy.init()
    node = rclpy.create_node("echo")
    publisher = node.create_publisher(Odometry, "odom", 10)

    def answer(scan: LaserScan) -> None:
        message = Odometry()
        message.header.stamp = scan.header.stamp
        publisher.publish(message)

    node.create_subscription(LaserScan, "scan", answer, BEST_EFFORT)
    rclpy.spin(node)


def serve(mode: str) -> None:
    """Run the node."""
    from curvescan_ros.node import main as run_node

    sys.argv[1:] = ["--ros-args", "-p", f"mode:={mode}", "-p", "base_frame_id:=laser"]
    run_node()


def measure(messages: list[LaserScan], rate: float) -> np.ndarray:
    """Return the seconds that each answer took; NaN where none came."""
    node = rclpy.create_node("stopwatch")
    publisher = node.create_publisher(LaserScan, "scan", BEST_EFFORT)
    sent, came = {}, {}
    node.create_subscription(
        Odometry,
        "odom",
        lambda m: came.setdefault((m.header.stamp.sec, m.header.stamp.nanosec), time.monotonic()),
        QoSProfile(depth=1000),
    )
    while publisher.get_subscription_count() == 0 or node.count_publishers("odom") == 0:
        rclpy.spin_once(node, timeout_sec=0.1)
    end = time.monotonic() + 1.0
    while time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    due = time.monotonic()
    for message in messages:
        stamp = message.header.stamp
        sent[stamp.sec, stamp.nanosec] = time.monotonic()
        publisher.publish(message)
        due += 1.0 / rate
        while (left := due - time.monotonic()) > 0.0:
            rclpy.spin_once(node, timeout_sec=left)
    end = time.monotonic() + 3.0
    while len(came) < len(sent) and time.monotonic() < end:
        rclpy.spin_once(node, timeout_sec=0.1)
    node.destroy_node()
    return np.array([came.get(key, np.nan) - when for key, when in sent.items()])


def messages_of(n_scans: int) -> list[LaserScan]:
    """Return the scans of a simulated drive, 360 beams."""
    from curvescan import simulate

    made = []
    for k, scan in enumerate(simulate("office-floor", sensor="spinning-360", n_scans=n_scans)):
        message = LaserScan(
            angle_min=scan.angle_min,
            angle_increment=scan.angle_increment,
            range_min=scan.range_min,
            range_max=scan.range_max,
            ranges=scan.ranges.astype(np.float32).tolist(),
        )
        message.header.frame_id = "laser"
        message.header.stamp = Time(sec=1000 + k // 10, nanosec=(k % 10) * 10**8)
        made.append(message)
    return made


def main() -> None:
    """Measure all servers at all rates, each in a process of its own."""
    messages = messages_of(int(sys.argv[1]) if len(sys.argv) > 1 else 400)
    rclpy.init()
    for rate in RATES:
        for name, arguments in SERVERS.items():
            with subprocess.Popen([sys.executable, Path(__file__), *arguments]) as server:
                took = 1e3 * measure(messages, rate)
                server.kill()
            median, p95, worst = np.nanpercentile(took, [50.0, 95.0, 100.0])
            load = os.getloadavg()[0]
            print(  # noqa: T201
                f"{rate:5.0f} Hz {name:>9}: median {median:.2f} ms, p95 {p95:.2f} ms, worst {worst:.1f} ms, "
                f"{np.isnan(took).sum()} of {took.size} not answered (load {load:.1f})",
                flush=True,
            )
    rclpy.shutdown()


if __name__ == "__main__":
    if "--echo" in sys.argv:
        echo()
    elif "--node" in sys.argv:
        serve(sys.argv[-1])
    else:
        main()
