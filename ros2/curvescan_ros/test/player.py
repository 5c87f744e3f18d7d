"""A process of its own that plays scans, and wheels: `python player.py SCANS.npz RATE_HZ`; waits for a subscriber, then publishes.

A rate of 0 plays each scan when the one before it has been answered: nothing is dropped, on however slow a machine.
"""

import math
import sys
import time

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from nav_msgs.msg import Odometry
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import LaserScan


def wheel_message(stamp: Time, x: float, y: float, theta: float) -> Odometry:
    """Return a pose by the wheels."""
    message = Odometry()
    message.header.stamp, message.header.frame_id, message.child_frame_id = (stamp, "wheels", "base_link")
    message.pose.pose.position.x, message.pose.pose.position.y = x, y
    message.pose.pose.orientation.z, message.pose.pose.orientation.w = (math.sin(0.5 * theta), math.cos(0.5 * theta))
    return message


def main() -> None:
    path, rate = sys.argv[1], float(sys.argv[2])
    data = np.load(path)
    rclpy.init()
    node = rclpy.create_node("player")
    publisher = node.create_publisher(
        LaserScan, "scan", QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)
    )
    wheels = node.create_publisher(Odometry, "wheel_odom", 200) if len(data["wheels"]) else None
    answers: list[Odometry] = []
    if rate == 0.0:
        node.create_subscription(Odometry, "odom", answers.append, QoSProfile(depth=1000))
    deadline = time.monotonic() + 60.0
    while publisher.get_subscription_count() == 0 and time.monotonic() < deadline:
        rclpy.spin_once(node, timeout_sec=0.1)
    time.sleep(0.5)
    due = time.monotonic()
    for k, ranges in enumerate(data["ranges"]):
        message = LaserScan(
            **{name: float(data[name]) for name in ("angle_min", "angle_increment", "range_min", "range_max")}
        )
        message.time_increment, message.scan_time = (float(data["time_increment"]), float(data["scan_time"]))
        nanoseconds = int(data["nanoseconds"][k])
        message.header.stamp = Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        message.header.frame_id = "laser"
        message.ranges = ranges.tolist()
        if wheels is not None:
            wheels.publish(wheel_message(message.header.stamp, *data["wheels"][k].tolist()))
            time.sleep(0.2 / rate)  # a wheel encoder is there before the sweep is over
        publisher.publish(message)
        if rate == 0.0:
            deadline = time.monotonic() + 60.0
            while len(answers) <= k and time.monotonic() < deadline:
                rclpy.spin_once(node, timeout_sec=0.1)
            continue
        due += 1.0 / rate
        rclpy.spin_once(node, timeout_sec=max(due - time.monotonic(), 0.0))
        time.sleep(max(due - time.monotonic(), 0.0))
    time.sleep(1.0)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
