"""McapRecorder: scans, poses and map of a live run in an MCAP file for Foxglove, ROS 2 and `curvescan`."""

import os
import time
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import Any, Unpack

import numpy as np

from curvescan.errors import CurvescanError, OutputError
from curvescan.io.files.output import output_file
from curvescan.io.ros.bags.bag_files import BagKind
from curvescan.io.ros.messages import LASER_SCAN, OCCUPANCY_GRID, ODOMETRY, TRANSFORMS
from curvescan.io.ros.writing.bags import ODOM_TOPIC, SCAN_TOPIC, TF_TOPIC, BagWriter, mcap_in_file
from curvescan.io.ros.writing.message_building import LASER_FRAME, MAP_FRAME, ODOM_FRAME, MessageBuilder
from curvescan.live.base_motion import BaseMotion
from curvescan.live.sinks import MapOptions, MapSink
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


MAP_PERIOD = 10.0  # the map is written at most every so many seconds, and at the end


class McapRecorder(MapSink):
    """Writes each scan to /scan, its pose by odometry to /odom and /tf, and the map to /map, in its own thread.

    The file appears whole when the recorder is closed. Ranges are written as float32. Scans whose beams are not evenly
    spaced are left out, and that is reported at the end.
    """

    def __init__(self, path: str | os.PathLike[str], **options: Unpack[MapOptions]) -> None:
        self.path = Path(path)
        self._files = ExitStack()
        try:
            temporary = self._files.enter_context(output_file(self.path))
            folder = self._files.enter_context(mcap_in_file(temporary))
            self._bag = self._files.enter_context(BagWriter(folder, BagKind.MCAP))
        except OSError as error:
            self._files.close()
            raise OutputError(f"cannot write {self.path}: {error}") from error
        self._messages = LiveMessages(self._bag.builder, is_mapped=options.get("mode", "odometry") != "odometry")
        self._next_map, self._written_map = time.monotonic() + MAP_PERIOD, 0
        self._stamp = 0.0
        self.n_scans = 0
        super().__init__("recorder", capacity=1000, **options)

    def _take(self, tracked: TrackedScan) -> None:
        self._stamp = tracked.scan.stamp
        for topic, message in self._messages.of_scan(tracked):
            self._bag.write(topic, TOPICS[topic], message, self._stamp)
        self._map.add(tracked)
        self.n_scans += 1
        if time.monotonic() >= self._next_map:
            self._write_map()

    def _write_map(self) -> None:
        grid = self._map.grid()
        if grid.log_odds.size and self._written_map != self._map.version:
            topic, message = self._messages.of_map(grid, self._stamp)
            self._bag.write(topic, TOPICS[topic], message, self._stamp)
            self._written_map = self._map.version
        self._next_map = time.monotonic() + MAP_PERIOD

    def _finish(self) -> None:
        try:
            if self.n_scans and self.error is None:
                super()._finish()
                self._write_map()
        except CurvescanError as error:
            self.error = error
        try:
            self._files.close()
        except OSError as error:
            self.error = OutputError(f"cannot write {self.path}: {error}")
