"""A process of its own that plays scans: `python player.py SCANS.npz RATE_HZ`; waits for a subscriber, then publishes."""

import sys
import time

import numpy as np
import rclpy
from builtin_interfaces.msg import Time
from rclpy.qos import QoSProfile, ReliabilityPolicy
from sensor_msgs.msg import LaserScan


def main() -> None:
    path, rate = sys.argv[1], float(sys.argv[2])
    data = np.load(path)
    rclpy.init()
    node = rclpy.create_node("player")
    publisher = node.create_publisher(
        LaserScan, "scan", QoSProfile(depth=200, reliability=ReliabilityPolicy.BEST_EFFORT)
    )
    deadline = time.monotonic() + 60.0
    while publisher.get_subscription_count() == 0 and time.monotonic() < deadline:
        rclpy.spin_once(node, timeout_sec=0.1)
    time.sleep(0.5)
    due = time.monotonic()
    for k, ranges in enumerate(data["ranges"]):
        message = LaserScan(
            **{
                name: float(data[name])
                for name in ("angle_min", "angle_increment", "range_min", "range_max")
            }
        )
        message.time_increment, message.scan_time = (
            float(data["time_increment"]),
            float(data["scan_time"]),
        )
        nanoseconds = int(data["nanoseconds"][k])
        message.header.stamp = Time(sec=nanoseconds // 10**9, nanosec=nanoseconds % 10**9)
        message.header.frame_id = "laser"
        message.ranges = ranges.tolist()
        publisher.publish(message)
        due += 1.0 / rate
        rclpy.spin_once(node, timeout_sec=max(due - time.monotonic(), 0.0))
        time.sleep(max(due - time.monotonic(), 0.0))
    time.sleep(1.0)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main()
