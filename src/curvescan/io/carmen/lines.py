"""The lines of a CARMEN log: the fields of each kind, and one pass over them all.

The fields, blank-separated (CARMEN's ``logger`` and ``logger_playback`` manual):

- ``FLASER n [n ranges] x y theta odom_x odom_y odom_theta stamp host logger_stamp``
- ``ROBOTLASER1 type start_angle fov resolution max_range accuracy remission_mode n [n ranges] m [m remissions]
  laser_x laser_y laser_theta robot_x robot_y robot_theta tv rv forward side turn_axis stamp host logger_stamp``
- ``RAWLASER1``: the same without the poses and what follows them up to the stamp
- ``ODOM x y theta tv rv accel stamp host logger_stamp``, ``PARAM name value ...``

A declared count is only ever compared with the number of fields that are there; nothing is allocated from it.
"""

from __future__ import annotations

import math
from array import array
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np

from curvescan.beams import even_beams, require_radians
from curvescan.errors import InvalidArgumentError
from curvescan.io.files.lines import BrokenRecordError, ReadError, ReadErrorCounter, printable, read_lines
from curvescan.io.log import NO_POSE, PoseRow
from curvescan.types import Floats, Ints

MAX_RANGE_PARAM = b"robot_front_laser_max"  # CARMEN's parameter for the largest range of the front laser, metres
_N_TAIL = 3  # stamp host logger_stamp


class ScanRecord(NamedTuple):
    """One sweep as its line gives it."""

    stamp: float  # seconds, finite
    ranges: Floats  # (n,): metres, n >= 1; any value, NaN and infinities included
    # radians; the increment is positive
    angle_min: float
    angle_increment: float
    range_max: float  # metres, positive; NaN where the line gives none
    intensities: Floats | None  # (n,): remissions
    pose: PoseRow | None  # pose of the laser in the odometry's frame, finite; None where the line gives none
    robot_pose: PoseRow | None  # pose of the robot likewise


def tag_of(line: bytes) -> bytes:
    """Return the message name of a line: ``b"#"`` for a comment, empty for a blank line."""
    words = line.lstrip()[:32].split(None, 1)
    if not words:
        return b""
    return b"#" if words[0].startswith(b"#") else words[0]


def flaser_angle_increment(n: int) -> float:
    """Return the angle between the beams of a FLASER line, radians, which the line itself does not give.

    A front laser sees 180 deg from -90 deg on. A SICK LMS with an odd number of beams has one at either end; with an
    even number the last is left out, so that 180 beams are exactly 1.0 deg apart and end at +89 deg.
    """
    return math.pi / (n if n % 2 == 0 else max(n - 1, 1))


def parse_flaser(line: bytes) -> ScanRecord:
    """Return the sweep of a FLASER line with the pose of the laser. Raises BrokenRecordError."""
    fields = line.split()
    n = _count(fields, 1, "FLASER")
    _check_length(fields, n + 8 + _N_TAIL, "FLASER")
    ranges = _numbers(fields[2 : n + 2], "FLASER")
    *poses, stamp = _finite_numbers(fields[n + 2 : n + 9], "FLASER")
    return ScanRecord(
        stamp,
        ranges,
        -math.pi / 2.0,
        flaser_angle_increment(n),
        math.nan,
        None,
        pose=(poses[0], poses[1], poses[2]),
        robot_pose=(poses[3], poses[4], poses[5]),
    )


def parse_odom(line: bytes) -> PoseRow:
    """Return the pose of the robot on an ODOM line; NaN, as write_carmen says it, where none is known.

    Raises BrokenRecordError.
    """
    fields = line.split(None, 10)
    if len(fields) < 7 + _N_TAIL:
        raise BrokenRecordError("ODOM line cut short")
    if fields[1:4] == [b"nan"] * 3:
        return NO_POSE
    x, y, theta = _finite_numbers(fields[1:4], "ODOM")
    return x, y, theta


def parse_max_range(line: bytes) -> float | None:
    """Return the largest range that a PARAM line gives for the front laser, metres; None for other parameters."""
    fields = line.split(None, 3)
    if len(fields) < 2 or fields[1] != MAX_RANGE_PARAM:
        return None
    try:
        value = float(fields[2])
    except (IndexError, ValueError):
        value = math.nan
    if not 0.0 < value < math.inf:
        raise BrokenRecordError(f"PARAM {MAX_RANGE_PARAM.decode()} is not a positive number")
    return value


def _parse_configured(line: bytes, *, tag: str, n_pose_fields: int) -> ScanRecord:
    """Return the sweep of a ROBOTLASER1 line, with the pose of the laser, or a RAWLASER1 line, which gives none."""
    fields = line.split()
    n = _count(fields, 8, tag)
    n_remissions = _count(fields, n + 9, tag, least=0)
    end = n + 10 + n_remissions
    _check_length(fields, end + n_pose_fields + _N_TAIL, tag)
    start_angle, fov, resolution, max_range = _numbers(fields[2:6], tag).tolist()
    if not math.isfinite(start_angle):
        raise BrokenRecordError(f"{tag} start angle not finite")
    tail = _finite_numbers(fields[end : end + n_pose_fields + 1], tag)
    step = _angle_increment(resolution, fov, n, tag)
    try:
        require_radians(even_beams(n, start_angle, step))
    except InvalidArgumentError as error:
        raise BrokenRecordError(f"{tag} line: {error}") from None
    return ScanRecord(
        stamp=tail[-1],
        ranges=_numbers(fields[9 : n + 9], tag),
        angle_min=start_angle,
        angle_increment=step,
        range_max=max_range if 0.0 < max_range < math.inf else math.nan,
        intensities=_numbers(fields[n + 10 : end], tag) if n_remissions == n else None,
        pose=(tail[0], tail[1], tail[2]) if n_pose_fields else None,
        robot_pose=(tail[3], tail[4], tail[5]) if n_pose_fields else None,
    )


def _angle_increment(resolution: float, fov: float, n: int, tag: str) -> float:
    for step in (resolution, fov / max(n - 1, 1)):
        if 0.0 < step <= 2.0 * math.pi:
            return step
    raise BrokenRecordError(f"{tag} line without a usable angle between beams")


def _count(fields: list[bytes], position: int, tag: str, *, least: int = 1) -> int:
    if position >= len(fields):
        raise BrokenRecordError(f"{tag} line cut short")
    try:
        count = int(fields[position][:20])
    except ValueError:
        raise BrokenRecordError(f"{tag} count not a whole number") from None
    if count < least:
        raise BrokenRecordError(f"{tag} count below {least}")
    return count


def _check_length(fields: list[bytes], expected: int, tag: str) -> None:
    if len(fields) < expected:
        raise BrokenRecordError(f"{tag} line cut short: fewer fields than its counts say")
    if len(fields) > expected:
        raise BrokenRecordError(f"{tag} line too long: more fields than its counts say")


def _numbers(fields: list[bytes], tag: str) -> Floats:
    try:
        return np.fromiter(map(float, fields), dtype=np.float64, count=len(fields))
    except ValueError:
        raise BrokenRecordError(f"{tag} line with a field that is not a number") from None


def _finite_numbers(fields: list[bytes], tag: str) -> list[float]:
    numbers: list[float] = _numbers(fields, tag).tolist()
    if not all(map(math.isfinite, numbers)):
        raise BrokenRecordError(f"{tag} pose or time stamp not finite")
    return numbers


SCAN_PARSERS: dict[bytes, Callable[[bytes], ScanRecord]] = {
    b"ROBOTLASER1": partial(_parse_configured, tag="ROBOTLASER1", n_pose_fields=11),
    b"FLASER": parse_flaser,
    b"RAWLASER1": partial(_parse_configured, tag="RAWLASER1", n_pose_fields=0),
}
"""Parser of each message that carries a sweep of the front laser, the most complete one first."""

_PLS_TURN = 1.0 / 25.0  # time of a turn of the mirror, seconds
_PLS_END = 51.2  # end of the scale of a PLS, metres
_EVERY = 8  # one sweep of so many is looked at
_N_READINGS = 1_000  # so many readings show on which steps they lie

_MOST_BY_CHANCE = 0.6
"""Share of the readings on the two commonest of the five centimetres of a step: 0.40 to 0.42 in six logs of an LMS,
which counts centimetres, 0.76 to 0.88 in three of a PLS."""


SICK_MM_END = 8.192  # end of the scale of a SICK LMS that counts millimetres, metres
_MAX_TAGS = 64
OTHER_TAGS = "(other)"
"""Where the lines of further unknown names are counted when there are too many names to be a log's."""


@dataclass
class Series:
    """What is kept of the sweeps of one message name: 64 bytes a sweep."""

    stamps: array[float] = field(default_factory=lambda: array("d"))  # one a sweep, seconds
    # three a sweep: x, y, theta of the laser, or of the robot where the lines do not distinguish them; NaN where
    # unknown
    poses: array[float] = field(default_factory=lambda: array("d"))
    robot_poses: array[float] = field(default_factory=lambda: array("d"))  # three a sweep, of the robot
    # one a sweep: where its line begins; see :func:`curvescan.io.files.lines.read_line_at`
    offsets: array[int] = field(default_factory=lambda: array("q"))
    is_beyond_mm_scale: bool = False  # whether a finite reading exceeds SICK_MM_END
    has_own_limit: bool = True  # whether each line gave its own range limit
    # of sweeps without one, every eighth: readings by their centimetre within a step of a SICK PLS, and the longest
    by_centimetre: Ints = field(default_factory=lambda: np.zeros(5, dtype=np.int64))
    longest: float = 0.0
    _n_without_limit: int = 0

    def add(self, sweep: ScanRecord, robot_pose: PoseRow, offset: int) -> None:
        """Append a sweep, with the pose of the robot for lines that give none."""
        self.stamps.append(sweep.stamp)
        self.offsets.append(offset)
        self.poses.extend(sweep.pose or robot_pose)
        self.robot_poses.extend(sweep.robot_pose or robot_pose)
        if math.isnan(sweep.range_max):
            self.has_own_limit = False
            if self._n_without_limit % _EVERY == 0:
                self._look_for_steps(sweep.ranges)
            self._n_without_limit += 1
            if not self.is_beyond_mm_scale:
                far = (sweep.ranges > SICK_MM_END) & (sweep.ranges < math.inf)
                self.is_beyond_mm_scale = bool(np.any(far))

    def _look_for_steps(self, ranges: Floats) -> None:
        read = ranges[(ranges > 0.0) & (ranges < 1e6)]  # not where it is NaN
        self.longest = max(self.longest, float(read.max(initial=0.0)))
        self.by_centimetre += np.bincount(np.rint(100.0 * read).astype(np.int64) % 5, minlength=5)

    @property
    def turn_time(self) -> float:
        """Time of a turn of the mirror, seconds; 0 for a laser of which nothing is known.

        A SICK PLS counts in steps of 5 cm, up to 51.15 m. Its sweep takes 20 ms, which FLASER lines do not say: a robot
        that turns by 45 deg/s is 0.9 deg farther at its end.
        """
        n = int(self.by_centimetre.sum())
        n_on_step = int(np.sort(self.by_centimetre)[-2:].sum())
        is_pls = n >= _N_READINGS and n_on_step > _MOST_BY_CHANCE * n
        return _PLS_TURN if is_pls and self.longest <= _PLS_END else 0.0


@dataclass(frozen=True, kw_only=True)
class Index:
    """What one pass over a CARMEN log found."""

    # by message name, in the order of SCAN_PARSERS; only names with a sound sweep
    series: dict[bytes, Series]
    max_range: float | None  # range limit of the last PARAM line that gives one, metres
    # lines by message name, sound or not, in order of appearance; ``"#"`` are comments
    tag_counts: dict[str, int]
    read_errors: tuple[ReadError, ...]  # most frequent first


def build_index(path: Path) -> Index:
    """Return what one pass over the file finds; memory grows by 64 bytes a sweep. Raises LogFileError."""
    read_errors = ReadErrorCounter()
    counts: dict[bytes, int] = {}
    series = {tag: Series() for tag in SCAN_PARSERS}
    robot_pose, max_range = NO_POSE, None
    for number, offset, line in read_lines(path, read_errors):
        tag = tag_of(line)
        if tag:
            # a file of arbitrary text may have as many first words as lines: they share one count
            is_known = tag in counts or len(counts) < _MAX_TAGS or tag in SCAN_PARSERS
            name = tag if is_known else OTHER_TAGS.encode()
            counts[name] = counts.get(name, 0) + 1
        try:
            if tag in SCAN_PARSERS:
                sweep = SCAN_PARSERS[tag](line)
                series[tag].add(sweep, robot_pose, offset)
            elif tag == b"ODOM":
                robot_pose = parse_odom(line)
            elif tag == b"PARAM":
                max_range = parse_max_range(line) or max_range
        except BrokenRecordError as error:
            read_errors.add(str(error), number)
    names: dict[str, int] = {}
    for tag, count in counts.items():
        name_of_tag = printable(tag.decode("ascii", errors="replace"))
        names[name_of_tag] = names.get(name_of_tag, 0) + count
    return Index(
        series={tag: found for tag, found in series.items() if found.stamps},
        max_range=max_range,
        tag_counts=names,
        read_errors=read_errors.read_errors(),
    )
