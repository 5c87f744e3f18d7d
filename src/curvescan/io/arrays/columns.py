"""What the readers of scans share: the columns of our CSV and NPZ, and StreamLog, a log that is read front to back."""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from curvescan import se2
from curvescan.errors import InvalidArgumentError, LogFileError, LogFormatError
from curvescan.io.files.lines import BrokenRecordError, ReadErrorCounter
from curvescan.io.log import NO_POSE, PoseRow, ScanAccess
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan
from curvescan.types import Floats

OPTIONAL: Mapping[str, float] = {"range_min": 0.0, "range_max": math.inf, "time_increment": 0.0, "scan_time": 0.0}
"""Numbers of a scan that a file may leave out, and what is then taken."""
DEFAULTS: Mapping[str, float] = {"angle_min": math.nan, "angle_increment": math.nan, **OPTIONAL}
COLUMNS = ("stamp", *DEFAULTS)
POSE_COLUMNS = ("x", "y", "theta")  # wheel odometry: pose of the laser at the scan


def make_scan(
    value: Mapping[str, float], ranges: Floats, angles: Floats | None, intensities: Floats | None
) -> LaserScan:
    """Return the scan of the numbers of COLUMNS and its (n,) ranges; angles replace angle_min and angle_increment."""
    even = ("angle_min", "angle_increment") if angles is None else ()
    fields: dict[str, Any] = {name: value[name] for name in ("stamp", *even, *OPTIONAL)}
    try:
        return LaserScan(ranges, intensities=intensities, **fields | {"angles": angles})
    except InvalidArgumentError as error:
        raise BrokenRecordError(str(error)) from None


def make_pose(x: float, y: float, theta: float) -> PoseRow:
    """Return a pose of the wheels, unknown where a number is."""
    return (x, y, theta) if math.isfinite(x) and math.isfinite(y) and math.isfinite(theta) else NO_POSE


def is_on_grid(scan: LaserScan) -> bool:
    """Return whether angle_min and angle_increment give the beams' directions to the bit."""
    grid = scan.angle_min + scan.angle_increment * np.arange(len(scan), dtype=np.float64)
    return scan.has_uniform_angles and np.array_equal(grid, scan.angles)


class Record(NamedTuple):
    """One scan as a file gives it."""

    scan: LaserScan  # the scan
    pose: PoseRow = NO_POSE  # wheel odometry: pose of the laser in the odometry's frame
    # what finds the scan again; as many numbers for each scan of a source, none where it cannot be found alone
    place: tuple[int, ...] = ()


ReadScan: TypeAlias = Callable[[tuple[int, ...]], LaserScan]  # reads one scan of a source by its place
ReadRecords: TypeAlias = Callable[[ReadErrorCounter], Iterator[Record]]
"""Reads a source anew, scan by scan, and counts what it skips."""


class StreamLog(ScanAccess):
    """A Log whose scans each iteration reads anew, one in memory at a time; opening counts them and the read errors."""

    def __init__(
        self,
        path: Path,
        *,
        kind: str,
        topic: str | None,
        read: ReadRecords,
        read_one: ReadScan | None = None,
        unit: str = "line",
        notes: tuple[str, ...] = (),
        mount: PoseRow = (0.0, 0.0, 0.0),
    ) -> None:
        if topic is not None:
            raise InvalidArgumentError(f"{path} is a {kind}, which has no topics, got topic {topic!r}: leave it out")
        self._mount = np.array(mount)
        self.name, self.format, self.notes = path.name, kind, notes
        self.tag_counts: Mapping[str, int] = MappingProxyType({})  # all that the source holds are scans
        self._path = path
        self._read, self._read_one, self._unit = read, read_one, unit
        read_errors = ReadErrorCounter(unit)
        stamps, poses, places = array("d"), array("d"), array("q")
        for record in read(read_errors):
            places.extend(record.place)
            stamps.append(record.scan.stamp)
            poses.extend(record.pose)
        self.read_errors = read_errors.read_errors()
        self._places = np.array(places, dtype=np.int64).reshape(len(stamps), -1 if stamps else 0)
        self._stamps = np.array(stamps)
        self._poses = np.array(poses).reshape(-1, 3)
        if not stamps:
            why = f" that can be read: {self.read_errors[0]}" if self.read_errors else ""
            raise LogFormatError(f"{path} is a {kind} without a scan{why}")

    @property
    def odometry(self) -> Trajectory | None:
        """Wheel odometry of the laser, one row a scan; NaN where a scan has none, None without any."""
        if np.isnan(self._poses).any(axis=1).all():
            return None
        poses = self._poses.copy()
        poses[:, 2] = se2.wrap(poses[:, 2])
        return Trajectory(stamps=self._stamps, poses=poses)

    def robot_odometry(self) -> Trajectory | None:
        """Return the wheel odometry of the robot; that of the laser where the source does not give its mount."""
        laser = self.odometry
        if laser is None:
            return None
        poses = se2.compose(laser.poses, se2.inverse(self._mount))
        return Trajectory(stamps=laser.stamps, poses=poses)

    def __len__(self) -> int:
        return len(self._stamps)

    def __iter__(self) -> Iterator[LaserScan]:
        return (record.scan for record in self._read(ReadErrorCounter(self._unit)))

    def _scan_at(self, i: int) -> LaserScan:
        if self._read_one is None:
            return super()._scan_at(i)
        try:
            return self._read_one(tuple(self._places[i].tolist()))
        except (ValueError, LookupError) as error:  # LogFormatError is a ValueError
            raise LogFileError(f"{self._path} has changed since it was opened: {error}") from error
