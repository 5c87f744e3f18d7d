"""McapRecorder: scans and poses of a live run to an MCAP file, which Foxglove, ROS 2 and `curvescan` read again."""

from __future__ import annotations

import os
from contextlib import ExitStack
from pathlib import Path

from curvescan.errors import OutputError
from curvescan.io.files.output import output_file
from curvescan.io.ros.bag_files import BagKind
from curvescan.io.ros.bag_writer import BagWriter, mcap_in_file
from curvescan.live.sinks import WorkerSink
from curvescan.live.tracker import TrackedScan


class McapRecorder(WorkerSink):
    """Writes each scan to /scan, and its pose by odometry to /odom and /tf, in a thread of its own.

    The file appears, whole, when the recorder is closed. Ranges are written as float32, what a LaserScan message has;
    beams that are not evenly spaced are not written, and that is reported at the end.

    Parameters
    ----------
    path : path-like
        The file; replaced if it is there.
    is_lossless : bool
        Whether the tracker waits for this sink.

    Raises
    ------
    OutputError
        When it cannot be written there.
    """

    def __init__(self, path: str | os.PathLike[str], *, is_lossless: bool = False) -> None:
        self.path = Path(path)
        self._files = ExitStack()
        try:
            temporary = self._files.enter_context(output_file(self.path))
            folder = self._files.enter_context(mcap_in_file(temporary))
            self._bag = self._files.enter_context(BagWriter(folder, BagKind.MCAP))
        except OSError as error:
            self._files.close()
            raise OutputError(f"cannot write {self.path}: {error}") from error
        self.n_scans = 0
        super().__init__("recorder", is_lossless=is_lossless)

    def _take(self, tracked: TrackedScan) -> None:
        self._bag.add_scan(tracked.scan)
        self._bag.add_odometry(tracked.scan.stamp, tracked.pose_odom, tracked.covariance)
        self._bag.add_transform(tracked.scan.stamp, tracked.pose_odom)
        self.n_scans += 1

    def _finish(self) -> None:
        try:
            self._files.close()
        except OSError as error:
            self.error = OutputError(f"cannot write {self.path}: {error}")
