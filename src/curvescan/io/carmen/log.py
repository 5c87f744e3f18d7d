"""CarmenLog: the sweeps of a CARMEN log, the text format of the classic 2D SLAM data sets.

Which lines are read. The front laser's, as FLASER, ROBOTLASER1 or RAWLASER1. A logger may write the same sweep
under two of these names; of a log that holds several, only the most complete one is read: ROBOTLASER1 before
FLASER before RAWLASER1. A rear or further laser is counted and not read.

The range limit. ROBOTLASER1 and RAWLASER1 lines give it; for FLASER the parameter ``robot_front_laser_max`` of a PARAM
line does (the last one counts). Failing both, the laser is taken for a SICK LMS, whose 13-bit codes 8183..8191
stand for *no reading*: 81.83 to 81.91 m when it counts centimetres, 8.183 to 8.191 m when it counts millimetres. The
limit is then 8.18 m when no reading of the log exceeds 8.192 m, else 80 m. A limit that lies among the codes (a
laser declared as 81.90) is brought below the first of them.

What is written, and what is lost of it, stands in docs/formats.md. No limit (inf) becomes the largest float64.
"""

from __future__ import annotations

import math
import sys
from array import array
from collections.abc import Callable, Iterator, Mapping
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

import numpy as np

from curvescan import se2
from curvescan.errors import InvalidArgumentError, LogFileError, LogFormatError, OutputError
from curvescan.io.carmen.lines import SCAN_PARSERS, ScanRecord, build_index, tag_of
from curvescan.io.files.lines import BrokenRecordError, ReadErrorCounter, printable, read_line_at, read_lines, text_file
from curvescan.io.log import Log, ScanAccess, scans_with_poses
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.scan import LaserScan
from curvescan.types import Floats, Pose

_SICK_LIMITS = ((8.182, 8.192), (81.82, 81.92))
"""Largest reading below the codes, and end of the scale, of a SICK LMS: in mm mode, in cm mode."""

_OTHER_LASERS = {
    "RLASER": "the rear laser",
    **{f"LASER{i}": "a further laser" for i in range(3, 6)},
    **{f"{kind}{i}": "a further laser" for kind in ("RAWLASER", "ROBOTLASER") for i in range(2, 6)},
}


class CarmenLog(ScanAccess):
    """The sweeps of a CARMEN log's front laser, in file order; a Log. Each iteration reads the file anew."""

    def __init__(self, path: Path, *, range_max: float | None = None, topic: str | None = None) -> None:
        if topic is not None:
            raise InvalidArgumentError(
                f"{path} is a CARMEN log, which has no topics, got topic {topic!r}: leave it out"
            )
        self.name, self.format = path.name, "CARMEN log"
        self._path = path
        self._index = build_index(path)
        if not self._index.series:
            if self._index.read_errors:
                raise LogFormatError(
                    f"{path} is a CARMEN log without a scan that can be read: {self._index.read_errors[0]}"
                )
            tags = printable(", ".join(self._index.tag_counts), 300) or "none"
            raise LogFormatError(
                f"{path} is a CARMEN log without a scan: it needs FLASER, ROBOTLASER1 or RAWLASER1 lines, and holds "
                f"{tags}"
            )
        self.read_errors = self._index.read_errors
        self.tag_counts: Mapping[str, int] = MappingProxyType(self._index.tag_counts)
        self._tag, self._series = next(iter(self._index.series.items()))
        self._range_max, self._turn_time = range_max, self._series.turn_time

    @cached_property
    def odometry(self) -> Trajectory | None:
        """Wheel odometry at each scan, in its raw frame; NaN where it is unknown, None without any but zeros.

        FLASER and ROBOTLASER1 lines give the pose of the laser. For RAWLASER1 it is the pose of the last ODOM line
        before the sweep, that is of the robot: the log does not say where the laser is mounted.
        """
        return _trajectory(self._series.stamps, self._series.poses)

    def robot_odometry(self) -> Trajectory | None:
        """Return the robot's pose at each sweep if the log has it besides the laser's; else ``odometry``."""
        return _trajectory(self._series.stamps, self._series.robot_poses) or self.odometry

    def why_estimated(self) -> str:
        """Return what says that the poses are the output of a SLAM: NEFF lines, which GMapping writes."""
        n_lines = self._index.tag_counts.get("NEFF", 0)
        return f"{n_lines:,} NEFF lines say that GMapping wrote them" if n_lines else ""

    @property
    def notes(self) -> tuple[str, ...]:
        """What was left out on purpose, and where the range limit comes from."""
        used = self._tag.decode()
        notes = [
            f"{len(other.stamps):,} {tag.decode()} lines are not read: {used} lines hold the front "
            "laser with more detail"
            for tag, other in self._index.series.items()
            if tag != self._tag
        ]
        notes += [
            f"{count:,} {tag} lines are not read: they are of {_OTHER_LASERS[tag]}"
            for tag, count in self._index.tag_counts.items()
            if tag in _OTHER_LASERS
        ]
        return (*notes, *self._range_notes())

    def __len__(self) -> int:
        return len(self._series.stamps)

    def __iter__(self) -> Iterator[LaserScan]:
        tag, parse = self._tag, SCAN_PARSERS[self._tag]
        for _, _, line in read_lines(self._path, ReadErrorCounter()):
            if tag_of(line) != tag:
                continue
            try:
                sweep = parse(line)
            except BrokenRecordError:
                continue  # counted by the index, which goes by the same parser
            yield self._scan(sweep)

    def _scan_at(self, i: int) -> LaserScan:
        line = read_line_at(self._path, self._series.offsets[i])
        try:
            return self._scan(SCAN_PARSERS[self._tag](line))
        except BrokenRecordError as error:
            raise LogFileError(f"{self._path} has changed since it was opened: {error}") from error

    def _scan(self, sweep: ScanRecord) -> LaserScan:
        limit = self._default_limit if math.isnan(sweep.range_max) else _below_codes(sweep.range_max)
        return LaserScan(
            sweep.ranges,
            angle_min=sweep.angle_min,
            angle_increment=sweep.angle_increment,
            range_max=limit if self._range_max is None else self._range_max,
            stamp=sweep.stamp,
            time_increment=self._turn_time * sweep.angle_increment / (2.0 * math.pi),
            intensities=sweep.intensities,
        )

    @cached_property
    def _default_limit(self) -> float:
        """Range limit where a line gives none."""
        if self._index.max_range is not None:
            return _below_codes(self._index.max_range)
        return 80.0 if self._series.is_beyond_mm_scale else 8.18

    def _range_notes(self) -> tuple[str, ...]:
        if self._range_max is not None or self._series.has_own_limit:
            return ()
        if self._index.max_range is not None:
            return (f"range_max {self._default_limit:g} m follows PARAM robot_front_laser_max",)
        return (
            f"the log does not give the laser's largest range: {self._default_limit:g} m is taken, as for "
            "a SICK LMS; range_max sets another",
        )


def _trajectory(stamps: array[float], rows: array[float]) -> Trajectory | None:
    poses = np.array(rows).reshape(-1, 3)
    is_filler = len(poses) > 1 and not np.any(poses)
    if is_filler or np.all(np.isnan(poses)):
        return None
    poses[:, 2] = se2.wrap(poses[:, 2])
    return Trajectory(stamps=np.array(stamps), poses=poses)


def _below_codes(range_max: float) -> float:
    for below, end in _SICK_LIMITS:
        if below < range_max <= end:
            return below
    return range_max


def write_carmen(path: Path, log: Log, on_scan: Callable[[], object]) -> tuple[str, ...]:
    """Write a log as CARMEN text; a LogWriter. Raises OutputError."""
    odometry = log.odometry
    is_posed = odometry is not None and bool(np.isfinite(odometry.poses).all())
    losses: dict[str, None] = {}
    was_known = False
    with text_file(path) as file:
        file.write("# CARMEN Logfile\n")
        for scan, pose in scans_with_poses(log):
            losses |= dict.fromkeys(_losses(scan))
            if not is_posed and (was_known or pose is not None):  # the pose of an ODOM line holds until the next
                row = _row(np.full(3, np.nan) if pose is None else pose)
                file.write(f"ODOM {row} 0 0 0 {scan.stamp!r} curvescan {scan.stamp!r}\n")
            was_known = pose is not None
            file.write(_line(scan, pose if is_posed else None))
            on_scan()
    if odometry is not None and len(odometry) > 1 and not odometry.poses.any():
        losses["odometry that is 0 throughout: readers of CARMEN logs take it for none"] = None
    return tuple(losses)


def _line(scan: LaserScan, pose: Pose | None) -> str:
    if not scan.has_uniform_angles:
        raise OutputError(
            f"cannot write the scan at {scan.stamp} s to a CARMEN log: its lines have evenly spaced beams, these are "
            "not; CSV and NPZ keep them"
        )
    ranges, strengths = scan.ranges, scan.intensities
    ranges = np.where((ranges > 0.0) & (ranges < scan.range_min), 0.0, ranges)
    start, step = scan.angle_min, scan.angle_increment
    if step < 0.0:
        start, step = start + step * max(len(scan) - 1, 0), -step
        ranges, strengths = ranges[::-1], None if strengths is None else strengths[::-1]
    if not len(scan):  # a line has a beam at least
        ranges, strengths = np.array([np.nan]), None
    limit = min(scan.range_max, sys.float_info.max)
    remissions = "0" if strengths is None else f"{len(strengths)} {_row(strengths)}"
    tail = "" if pose is None else f"{_row(pose)} {_row(pose)} 0 0 0 0 0 "
    tag = "RAWLASER1" if pose is None else "ROBOTLASER1"
    return (
        f"{tag} 0 {start!r} {step * (len(ranges) - 1)!r} {step!r} {limit!r} 0 0 {len(ranges)} {_row(ranges)} "
        f"{remissions} {tail}{scan.stamp!r} curvescan {scan.stamp!r}\n"
    )


def _losses(scan: LaserScan) -> list[str]:
    lost = []
    if scan.range_min > 0.0:
        lost.append("range_min: a CARMEN log does not give it; readings below it are written as 0")
    if scan.time_increment or scan.scan_time:
        lost.append("time_increment and scan_time: a CARMEN log does not give them")
    if scan.angle_increment < 0.0:
        lost.append("the direction of the sweep: beams are written counter-clockwise, at the same angles")
    return lost


def _row(values: Floats) -> str:
    return " ".join(map(repr, values.tolist()))
