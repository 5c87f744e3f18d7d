"""LiveMessages: tracked scans as the ROS 2 messages that the node publishes, for files and websockets without ROS."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from curvescan.io.ros.messages import LASER_SCAN, OCCUPANCY_GRID, ODOMETRY, TRANSFORMS
from curvescan.io.ros.writing.bags import ODOM_TOPIC, SCAN_TOPIC, TF_TOPIC
from curvescan.io.ros.writing.message_building import LASER_FRAME, MAP_FRAME, ODOM_FRAME, MessageBuilder
from curvescan.live.base_motion import BaseMotion
from curvescan.live.tracker import TrackedScan
from curvescan.mapping.occupancy import OccupancyGrid

MAP_TOPIC = "/map"
TOPICS = {SCAN_TOPIC: LASER_SCAN, ODOM_TOPIC: ODOMETRY, TF_TOPIC: TRANSFORMS[0], MAP_TOPIC: OCCUPANCY_GRID}
"""Topics and the types of their messages."""


class LiveMessages:
    """Makes the messages of a live run: scan, odom with its velocity, tf (with SLAM map -> odom too), map."""

    def __init__(self, builder: MessageBuilder, *, is_mapped: bool) -> None:
        self._builder, self._is_mapped = builder, is_mapped
        self._motion = BaseMotion(np.zeros(3))

    def of_scan(self, tracked: TrackedScan) -> Iterator[tuple[str, Any]]:
        """Yield the topic and the message of all that is said of a scan."""
        builder = self._builder
        state = self._motion.add(tracked.step, tracked.scan.stamp)
        stamp = tracked.scan.stamp + tracked.half_sweep  # that the pose is of
        edges = [(ODOM_FRAME, LASER_FRAME, state.odom_base.pose)]
        if self._is_mapped and state.map_odom is not None:
            edges.append((MAP_FRAME, ODOM_FRAME, state.map_odom))
        yield SCAN_TOPIC, builder.laser_scan(tracked.scan)[0]
        odometry = builder.odometry(
            stamp, state.odom_base.pose, state.odom_base.cov, twist=state.twist, twist_covariance=state.twist_covariance
        )
        yield ODOM_TOPIC, odometry
        yield TF_TOPIC, builder.transforms(stamp, edges)

    def of_map(self, grid: OccupancyGrid, stamp: float) -> tuple[str, Any]:
        """Return the topic and the message of a map."""
        percent = np.rint(100.0 * grid.probability).astype(np.int8)
        percent[grid.log_odds == 0.0] = -1
        frame = MAP_FRAME if self._is_mapped else ODOM_FRAME
        message = self._builder.occupancy_grid(stamp, percent, grid.origin, grid.resolution, frame)
        return MAP_TOPIC, message
