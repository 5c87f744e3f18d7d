"""What every source of scans offers, whether a file or a simulated world; a small log can be held in memory."""

import math
from collections.abc import Iterator, Mapping, Sequence
from copy import copy
from itertools import islice
from typing import Protocol, TypeAlias, cast, overload, runtime_checkable

from curvescan.configs import counted
from curvescan.errors import InvalidArgumentError
from curvescan.io.files.lines import ReadError
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan
from curvescan.types import Floats, Pose

PoseRow: TypeAlias = tuple[float, float, float]  # [x, y, theta]: metres, metres, radians; NaN where unknown

NO_POSE: PoseRow = (math.nan, math.nan, math.nan)


@runtime_checkable
class Log(Protocol):
    """A finite sequence of scans in the order they were recorded, which can be read again and again."""

    @property
    def name(self) -> str:
        """Name for titles and messages: the file's name or the world's."""

    @property
    def format(self) -> str:
        """Format in words: ``"CARMEN log"``."""

    @property
    def odometry(self) -> Trajectory | None:
        """Wheel odometry: pose of the *sensor* at each scan in the odometry's own frame; None without."""

    @property
    def read_errors(self) -> tuple[ReadError, ...]:
        """Faults of the whole log, most frequent first; empty for a sound one."""

    @property
    def tag_counts(self) -> Mapping[str, int]:
        """How many messages of each kind the source holds, read or not; empty where all are scans."""

    @property
    def notes(self) -> tuple[str, ...]:
        """Remarks of the reader, a sentence each: what it left out or assumed; empty where nothing."""

    def __len__(self) -> int:
        """Return the number of scans."""

    def __iter__(self) -> Iterator[LaserScan]:
        """Yield the scans in file order, one in memory at a time."""

    @overload
    def __getitem__(self, i: int) -> LaserScan: ...
    @overload
    def __getitem__(self, i: slice) -> "Log": ...
    def __getitem__(self, i: int | slice) -> "LaserScan | Log":
        """Return scan i, or a view of a slice; negative numbers count from the end. See :class:`ScanAccess`."""


class ScanAccess:
    """What makes ``log[i]``, ``log[a:b]`` and the ``repr`` of every log, and what it may know of the robot besides.

    A log inherits it, defines `_scan_at`, and what it knows.
    """

    @overload
    def __getitem__(self, i: int) -> LaserScan: ...
    @overload
    def __getitem__(self, i: slice) -> Log: ...
    def __getitem__(self, i: int | slice) -> LaserScan | Log:
        """Return scan i, or a view of a slice of the log; negative numbers count from the end. Raises IndexError."""
        log = cast(Log, self)
        if isinstance(i, slice):
            return LogSlice(log, range(len(log))[i])
        try:
            number = range(len(log))[i]
        except IndexError:
            raise IndexError(_no_scan(log, i)) from None
        return self._scan_at(number)

    def robot_odometry(self) -> Trajectory | None:
        """Return the wheel odometry of the *robot* at each scan; None where it, or the laser's mount, is not known."""
        return None

    def hangs_upside_down(self) -> bool:
        """Return whether the laser is mounted upside down; its scans are as it gave them all the same."""
        return False

    def turned_by_gyro(self) -> Floats | None:
        """Return (n_scans,) angles about z by the gyroscope at each scan, radians by REP-103, NaN where not covered."""
        return None

    def why_estimated(self) -> str:
        """Return what says that the poses come from SLAM, localization or laser odometry; empty where nothing does."""
        return ""

    def n_recorded(self) -> int:
        """Return the scans of the recording by its own count, also where not all can be read."""
        return len(cast(Log, self))

    def __repr__(self) -> str:
        log = cast(Log, self)
        return f"Log({log.name!r}: {log.format}, {counted(len(log), 'scan')})"

    def _scan_at(self, i: int) -> LaserScan:
        """Return scan i, 0 <= i < len(self); a log that has an index of its file reads this scan alone."""
        return next(islice(iter(cast(Log, self)), i, None))


class LogView(ScanAccess):
    """A log seen through another: a subclass changes some of what the log below says."""

    def __init__(self, log: Log) -> None:
        self._log = log

    # what the log below says
    below = property(lambda self: cast(Log, self._log))
    name = property(lambda self: str(self._log.name))
    format = property(lambda self: str(self._log.format))
    odometry = property(lambda self: cast(Trajectory | None, self._log.odometry))
    read_errors = property(lambda self: cast(tuple[ReadError, ...], self._log.read_errors))
    tag_counts = property(lambda self: cast(Mapping[str, int], self._log.tag_counts))
    notes = property(lambda self: cast(tuple[str, ...], self._log.notes))

    def robot_odometry(self) -> Trajectory | None:
        """Return what the log below says."""
        return self._log.robot_odometry() if isinstance(self._log, ScanAccess) else None

    def hangs_upside_down(self) -> bool:
        """Return what the log below says."""
        return isinstance(self._log, ScanAccess) and self._log.hangs_upside_down()

    def turned_by_gyro(self) -> Floats | None:
        """Return what the log below says."""
        return self._log.turned_by_gyro() if isinstance(self._log, ScanAccess) else None

    def why_estimated(self) -> str:
        """Return what the log below says."""
        return self._log.why_estimated() if isinstance(self._log, ScanAccess) else ""

    def n_recorded(self) -> int:
        """Return what the log below says."""
        return self._log.n_recorded() if isinstance(self._log, ScanAccess) else len(self._log)

    def __len__(self) -> int:
        return len(self._log)


class LogSlice(LogView):
    """Some scans of a log, by their numbers, as a log: a view that holds none of them."""

    def __init__(self, log: Log, numbers: range) -> None:
        super().__init__(log)
        self._numbers = numbers

    @property
    def name(self) -> str:
        """Name of the whole log, and which scans."""
        r = self._numbers
        step = "" if r.step == 1 else f":{r.step}"
        return f"{super().name}[{r.start}:{r.stop}{step}]"

    @property
    def odometry(self) -> Trajectory | None:
        """Wheel odometry at these scans."""
        return self._rows(super().odometry)

    def robot_odometry(self) -> Trajectory | None:
        """Return what the log below says of these scans."""
        return self._rows(super().robot_odometry())

    def turned_by_gyro(self) -> Floats | None:
        """Return what the log below says of these scans."""
        turned = super().turned_by_gyro()
        return None if turned is None else turned[list(self._numbers)]

    def n_recorded(self) -> int:
        """Return how many scans the slice has."""
        return len(self._numbers)

    def __len__(self) -> int:
        return len(self._numbers)

    def __iter__(self) -> Iterator[LaserScan]:
        r = self._numbers
        is_far = len(r) * _SCANS_A_LOOKUP < (r.stop if r.step > 0 else 0)
        if r.step < 0 or is_far:
            return (self._log[i] for i in r)
        return islice(iter(self._log), r.start, r.stop, r.step)

    def _scan_at(self, i: int) -> LaserScan:
        return self._log[self._numbers[i]]

    def _rows(self, trajectory: Trajectory | None) -> Trajectory | None:
        if trajectory is None:
            return None
        return Trajectory(stamps=trajectory.stamps[list(self._numbers)], poses=trajectory.poses[list(self._numbers)])


_SCANS_A_LOOKUP = 10  # to look a scan up takes about as long as to read so many in their order


def pick_scans(log: Log, numbers: Sequence[int]) -> list[LaserScan]:
    """Return the scans of these numbers, in the order given. Raises InvalidArgumentError."""
    for number in numbers:
        if not 0 <= number < len(log):
            raise InvalidArgumentError(_no_scan(log, number))
    return [log[number] for number in numbers]


def _no_scan(log: Log, i: int) -> str:
    return f"there is no scan {i}: {log.name} has {len(log):,} scans, numbered 0 to {len(log) - 1}"


def scans_with_poses(log: Log) -> Iterator[tuple[LaserScan, Pose | None]]:
    """Yield each scan with its row of the odometry; None where there is none."""
    odometry = log.odometry
    for i, scan in enumerate(log):
        pose = None if odometry is None or i >= len(odometry) else odometry.poses[i]
        yield scan, None if pose is None or not all(abs(v) < float("inf") for v in pose) else pose


MAX_HELD_BYTES = 128 << 20
"""Most memory that the scans of a held log take; 45,000 scans of 361 beams. A larger log is read anew each time."""

_SCAN_BYTES = 1200  # what a scan takes besides its arrays


class HeldLog(LogView):
    """A log whose first complete iteration keeps its readings: further ones read nothing, and one below lets go."""

    def __init__(self, log: Log, max_bytes: int = MAX_HELD_BYTES) -> None:
        super().__init__(log)
        self._max_bytes = max_bytes
        self._scans: list[LaserScan] | None = None
        self._is_read_anew = False

    def __iter__(self) -> Iterator[LaserScan]:
        if self._scans is not None:
            return map(copy, self._scans)
        return iter(self._log) if self._is_read_anew else self._read()

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
        self._is_read_anew = left < 0
        if left >= 0:
            self._scans, below = scans, self._log
            while isinstance(below, LogView):
                if isinstance(below, HeldLog):
                    below._scans, below._is_read_anew = None, True
                below = below._log

    def _scan_at(self, i: int) -> LaserScan:
        return self._log[i] if self._scans is None else copy(self._scans[i])


def _n_bytes(scan: LaserScan, *, has_own_angles: bool) -> int:
    n_rows = 1 + (scan.intensities is not None) + 3 * has_own_angles  # angles and unit vectors
    return _SCAN_BYTES + n_rows * scan.ranges.nbytes
