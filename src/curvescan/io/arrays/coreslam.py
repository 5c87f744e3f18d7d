"""Scans of the Mines ParisTech rover as CoreSLAM, tinySLAM and BreezySLAM log them; the columns: docs/formats.md.

The rover's constants are those of Steux and El Hamzaoui, "CoreSLAM: a SLAM algorithm in less than 200 lines of C code",
ICARCV 2010. In ``exp1.dat`` the wheels lead the scans by 0.15 s (correlation 0.92, against 0.70 line by line); the
odometry is left as it is.
"""

import math
from collections.abc import Iterator
from functools import partial
from pathlib import Path

import numpy as np

from curvescan import se2
from curvescan.io.arrays.columns import Record, StreamLog
from curvescan.io.files.lines import BrokenRecordError, ReadErrorCounter, read_line_at, read_lines
from curvescan.scan import LaserScan
from curvescan.types import Pose

FORMAT = "CoreSLAM log"
N_BEAMS = 682
N_COLUMNS = (24 + N_BEAMS, 24 + N_BEAMS + 1)
N_COVERED = 70  # beams at either end that the rover itself stands in; their readings become NaN
ANGLE_INCREMENT = 2.0 * math.pi / 1024.0  # steps of a URG-04LX, radians
ANGLE_MIN = -340.0 * ANGLE_INCREMENT  # its first step is number 44, and 384 looks ahead
RANGE_MIN, RANGE_MAX = 0.02, 5.6
SCAN_TIME = 0.1  # one turn of its mirror, seconds
TICK = 2.0 * math.pi * 0.077 / 2000.0  # way of a wheel of 77 mm radius in a tick, metres
AXLE = 2.0 * 0.165  # between the wheels, metres
MOUNT = (0.145, 0.0, 0.0)  # pose of the laser on the rover, whose origin is the middle of the axle

_NOTES = (
    "the log does not describe its robot: laser, wheels and mount are taken to be those of the Mines ParisTech rover",
    f"the first and the last {N_COVERED} beams are left out: they see the rover itself",
)


def open_coreslam(path: Path, *, range_max: float | None = None, topic: str | None = None) -> StreamLog:
    """Return the scans of a CoreSLAM log, with odometry from its wheel encoders; it has no topics."""
    limit = RANGE_MAX if range_max is None else range_max
    return StreamLog(
        path,
        kind=FORMAT,
        topic=topic,
        read=partial(_records, path, limit),
        read_one=lambda place: _scan(read_line_at(path, place[0]).split(), limit),
        notes=_NOTES,
        mount=MOUNT,
    )


def _records(path: Path, range_max: float, read_errors: ReadErrorCounter) -> Iterator[Record]:
    ticks: tuple[int, int] | None = None
    robot = se2.identity()
    for number, offset, line in read_lines(path, read_errors):
        fields = line.split()
        if not fields:
            continue
        try:
            scan = _scan(fields, range_max)
            now = int(fields[2]), int(fields[3])
            robot, ticks = _moved(robot, ticks or now, now), now
            x, y, theta = se2.compose(robot, np.array(MOUNT)).tolist()
        except (BrokenRecordError, ValueError, OverflowError) as error:
            is_ours = isinstance(error, BrokenRecordError)
            read_errors.add(str(error) if is_ours else "line with a field that is no number", number)
            continue
        yield Record(scan, (x, y, theta), (offset,))


def _scan(fields: list[bytes], range_max: float) -> LaserScan:
    if len(fields) < N_COLUMNS[0]:
        raise BrokenRecordError("line cut short: fewer than 706 fields")
    if len(fields) > N_COLUMNS[1]:
        raise BrokenRecordError("line too long: more than 707 fields")
    stamp = float(fields[0])
    if not math.isfinite(stamp):
        raise BrokenRecordError("time stamp not finite")
    millimetres = map(float, fields[24 : N_COLUMNS[0]])
    ranges = np.fromiter(millimetres, dtype=np.float64, count=N_BEAMS) / 1e3
    ranges[:N_COVERED] = ranges[-N_COVERED:] = np.nan
    return LaserScan(
        ranges,
        angle_min=ANGLE_MIN,
        angle_increment=ANGLE_INCREMENT,
        range_min=RANGE_MIN,
        range_max=range_max,
        stamp=stamp / 1e6,
        time_increment=SCAN_TIME / 1024.0,
        scan_time=SCAN_TIME,
    )


def _moved(pose: Pose, last: tuple[int, int], ticks: tuple[int, int]) -> Pose:
    """Return the pose of the rover after its wheels have come to these counts, on an arc of constant curvature."""
    way_left, way_right = TICK * (ticks[0] - last[0]), TICK * (ticks[1] - last[1])
    way, turn = 0.5 * (way_left + way_right), (way_right - way_left) / AXLE
    # along the chord of the arc, whose direction is the mean of the two headings
    chord = way * float(np.sinc(turn / (2.0 * math.pi)))
    return se2.compose(pose, np.array([chord * math.cos(0.5 * turn), chord * math.sin(0.5 * turn), turn]))
