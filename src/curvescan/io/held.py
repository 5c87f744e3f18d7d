"""A log that is read once and held in memory where it is small enough: a run goes over its scans six times."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from copy import copy

from curvescan.io.files.read_errors import ReadError
from curvescan.io.log import GyroLog, Log, MountedLog, ScanAccess
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan
from curvescan.types import Floats

MAX_HELD_BYTES = 128 << 20
"""Most memory that the scans of a held log take; 45,000 scans of 361 beams. A larger log is read anew each time."""

_SCAN_BYTES = 1200
"""What a scan takes besides its arrays."""


class HeldLog(ScanAccess):
    """A log whose first complete iteration keeps its scans, so that further ones read nothing.

    The scans are the same, and what an iteration computes of them is not kept: memory is that of the readings.

    Parameters
    ----------
    log : Log
        The log.
    max_bytes : int
        Most memory for the scans. Once a log exceeds it nothing is held, and it is read anew by each iteration, one
        scan in memory at a time.
    """

    def __init__(self, log: Log, max_bytes: int = MAX_HELD_BYTES) -> None:
        self._log = log
        self._max_bytes = max_bytes
        self._scans: list[LaserScan] | None = None
        self._is_too_large = False

    @property
    def is_held(self) -> bool:
        """Whether the scans are in memory."""
        return self._scans is not None

    @property
    def name(self) -> str:
        """Name of the log."""
        return self._log.name

    @property
    def format(self) -> str:
        """Format of the log."""
        return self._log.format

    @property
    def odometry(self) -> Trajectory | None:
        """Wheel odometry of the log."""
        return self._log.odometry

    def robot_odometry(self) -> Trajectory | None:
        """Return the wheel odometry of the robot, where the log knows the laser's mount."""
        log = self._log
        return log.robot_odometry() if isinstance(log, MountedLog) else None

    def hangs_upside_down(self) -> bool:
        """Return what the log says."""
        return isinstance(self._log, MountedLog) and self._log.hangs_upside_down()

    def turned_by_gyro(self) -> Floats | None:
        """Return the angle that the log's gyroscope has turned by at each scan; None without one."""
        return self._log.turned_by_gyro() if isinstance(self._log, GyroLog) else None

    @property
    def read_errors(self) -> tuple[ReadError, ...]:
        """Faults of the log."""
        return self._log.read_errors

    @property
    def tag_counts(self) -> Mapping[str, int]:
        """Messages of the log."""
        return self._log.tag_counts

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks on the log."""
        return self._log.notes

    def __len__(self) -> int:
        return len(self._log)

    def __iter__(self) -> Iterator[LaserScan]:
        if self._scans is not None:
            return map(copy, self._scans)
        return iter(self._log) if self._is_too_large else self._read()

    def _read(self) -> Iterator[LaserScan]:
        scans: list[LaserScan] = []
        left, angles = self._max_bytes, None
        for scan in self._log:
            if left >= 0:
                # scans of one layout share their directions
                left -= _n_bytes(scan, has_own_angles=scan.angles is not angles)
                angles = scan.angles
                scans.append(copy(scan))
                if left < 0:
                    scans.clear()
            yield scan
        if left >= 0:
            self._scans = scans
        self._is_too_large = left < 0

    def _scan_at(self, i: int) -> LaserScan:
        return self._log[i] if self._scans is None else copy(self._scans[i])


def _n_bytes(scan: LaserScan, *, has_own_angles: bool) -> int:
    n_rows = 1 + (scan.intensities is not None) + 3 * has_own_angles  # angles and unit vectors
    return _SCAN_BYTES + n_rows * scan.ranges.nbytes
