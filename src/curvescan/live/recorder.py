"""McapRecorder: scans, poses and map of a live run in an MCAP file for Foxglove, ROS 2 and `curvescan`."""

import os
import time
from contextlib import ExitStack
from pathlib import Path

from curvescan.errors import CurvescanError, OutputError
from curvescan.io.files.output import output_file
from curvescan.io.ros.bags.bag_files import BagKind
from curvescan.io.ros.writing.bags import BagWriter, mcap_in_file
from curvescan.live.ros_messages import TOPICS, LiveMessages
from curvescan.live.sinks import MapSink, SavedMap
from curvescan.live.tracker import TrackedScan
from curvescan.mapping.config import OccupancyConfig

MAP_PERIOD = 10.0  # the map is written at most every so many seconds, and at the end


class McapRecorder(MapSink):
    """Writes each scan to /scan, its pose by odometry to /odom and /tf, and the map to /map, in a thread of its own.

    The file appears, whole, when the recorder is closed. Ranges are written as float32, what a LaserScan message has;
    beams that are not evenly spaced are not written, and that is reported at the end.

    The other arguments are those of :class:`curvescan.live.sinks.MapSink`; /map begins with the saved map.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        *,
        mode: str = "odometry",
        occupancy: OccupancyConfig | None = None,
        is_lossless: bool = False,
        saved_map: SavedMap | None = None,
    ) -> None:
        self.path = Path(path)
        self._files = ExitStack()
        try:
            temporary = self._files.enter_context(output_file(self.path))
            folder = self._files.enter_context(mcap_in_file(temporary))
            self._bag = self._files.enter_context(BagWriter(folder, BagKind.MCAP))
        except OSError as error:
            self._files.close()
            raise OutputError(f"cannot write {self.path}: {error}") from error
        self._messages = LiveMessages(self._bag.builder, is_mapped=mode != "odometry")
        self._next_map, self._written_map = time.monotonic() + MAP_PERIOD, 0
        self._stamp = 0.0
        self.n_scans = 0
        super().__init__(
            "recorder", mode=mode, occupancy=occupancy, saved_map=saved_map, is_lossless=is_lossless, capacity=1000
        )

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
