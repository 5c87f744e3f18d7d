"""One pass over a CARMEN log: which lines are sweeps, what they say of time and place, what is broken."""

from __future__ import annotations

import math
from array import array
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from curvescan.io.carmen.lines import SCAN_PARSERS, ScanRecord, parse_max_range, parse_odom, tag_of
from curvescan.io.files.lines import LineMark, read_lines
from curvescan.io.files.printable import printable
from curvescan.io.files.read_errors import BrokenRecordError, ReadError, ReadErrorCounter
from curvescan.io.log import NO_POSE, PoseRow
from curvescan.types import Floats, Ints

_PLS_TURN = 1.0 / 25.0  # time of a turn of the mirror, seconds
_PLS_END = 51.2  # end of the scale of a PLS, metres
_EVERY = 8  # one sweep of so many is looked at
_N_READINGS = 1_000  # so many readings show on which steps they lie

_MOST_BY_CHANCE = 0.6
"""Share of the readings on the two commonest of the five centimetres of a step: 0.40 to 0.42 in six logs of an LMS,
which counts centimetres, 0.76 to 0.88 in three of a PLS."""


@dataclass
class PlsSigns:
    """What the readings of a log's sweeps say of their laser: FLASER lines lack the times of the beams of a SICK PLS.

    Its mirror turns 25 times a second, so that half a turn, a sweep, takes 20 ms: a robot that turns by 45 degrees a
    second is 0.9 degrees farther at its end. A PLS counts in steps of 5 cm, up to 51.15 m.
    """

    # (5,): readings by their centimetre within a step of a PLS
    by_centimetre: Ints = field(default_factory=lambda: np.zeros(5, dtype=np.int64))
    longest: float = 0.0  # the longest finite reading, metres
    _n_sweeps: int = 0

    def add(self, ranges: Floats) -> None:
        """Take up a sweep, (n,) metres."""
        self._n_sweeps += 1
        if self._n_sweeps % _EVERY != 1:
            return
        read = ranges[(ranges > 0.0) & (ranges < 1e6)]  # not where it is NaN
        if not read.size:
            return
        self.longest = max(self.longest, float(read.max()))
        centimetres = np.rint(100.0 * read).astype(np.int64) % 5
        self.by_centimetre += np.bincount(centimetres, minlength=5)

    @property
    def turn_time(self) -> float:
        """Time of a turn of the mirror, seconds; 0 for a laser of which nothing is known."""
        n = int(self.by_centimetre.sum())
        n_on_step = int(np.sort(self.by_centimetre)[-2:].sum())
        is_pls = n >= _N_READINGS and n_on_step > _MOST_BY_CHANCE * n
        return _PLS_TURN if is_pls and self.longest <= _PLS_END else 0.0


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
    # what the readings say of the laser, where the lines do not give its limit
    signs: PlsSigns = field(default_factory=PlsSigns)

    def add(self, sweep: ScanRecord, robot_pose: PoseRow, offset: int) -> None:
        """Append a sweep, with the pose of the robot for lines that give none."""
        self.stamps.append(sweep.stamp)
        self.offsets.append(offset)
        self.poses.extend(sweep.pose or robot_pose)
        self.robot_poses.extend(sweep.robot_pose or robot_pose)
        if math.isnan(sweep.range_max):
            self.has_own_limit = False
            self.signs.add(sweep.ranges)
            if not self.is_beyond_mm_scale:
                far = (sweep.ranges > SICK_MM_END) & (sweep.ranges < math.inf)
                self.is_beyond_mm_scale = bool(np.any(far))


@dataclass(frozen=True, kw_only=True)
class Index:
    """What one pass over a CARMEN log found."""

    # dict of bytes to Series: by message name, in the order of SWEEP_PARSERS; only names with a sound sweep
    series: dict[bytes, Series]
    max_range: float | None  # range limit of the last PARAM line that gives one, metres
    # dict of str to int: lines by message name, sound or not, in order of appearance; ``"#"`` are comments
    tag_counts: dict[str, int]
    read_errors: tuple[ReadError, ...]  # most frequent first


def build_index(path: Path) -> Index:
    """Return what one pass over the file finds; memory grows by 64 bytes a sweep. Raises LogFileError."""
    read_errors = ReadErrorCounter()
    counts: dict[bytes, int] = {}
    series = {tag: Series() for tag in SCAN_PARSERS}
    robot_pose, max_range = NO_POSE, None
    mark = LineMark()
    for number, line in read_lines(path, read_errors, mark):
        tag = tag_of(line)
        _count_tag(counts, tag)
        try:
            if tag in SCAN_PARSERS:
                sweep = SCAN_PARSERS[tag](line)
                series[tag].add(sweep, robot_pose, mark.offset)
            elif tag == b"ODOM":
                robot_pose = parse_odom(line)
            elif tag == b"PARAM":
                max_range = parse_max_range(line) or max_range
        except BrokenRecordError as error:
            read_errors.add(str(error), number)
    return Index(
        series={tag: found for tag, found in series.items() if found.stamps},
        max_range=max_range,
        tag_counts=_named(counts),
        read_errors=read_errors.read_errors(),
    )


def _count_tag(counts: dict[bytes, int], tag: bytes) -> None:
    # a file of arbitrary text may have as many first words as lines: they share one count
    if tag not in counts and len(counts) >= _MAX_TAGS and tag not in SCAN_PARSERS:
        tag = OTHER_TAGS.encode()
    if tag:
        counts[tag] = counts.get(tag, 0) + 1


def _named(counts: dict[bytes, int]) -> dict[str, int]:
    names: dict[str, int] = {}
    for tag, count in counts.items():
        name = printable(tag.decode("ascii", errors="replace"))
        names[name] = names.get(name, 0) + count
    return names
