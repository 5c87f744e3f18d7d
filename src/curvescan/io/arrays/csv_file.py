"""Scans as CSV, for those who write their own driver; every float64 is read again to the bit.

The layout stands in docs/formats.md: a header that names the columns, then a line a scan whose last fields are its
ranges; lines of ``angles`` and ``intensities`` may stand before a scan.
"""

import math
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path

import numpy as np

from curvescan.errors import LogFormatError
from curvescan.io.arrays.columns import (
    COLUMNS,
    DEFAULTS,
    POSE_COLUMNS,
    Record,
    StreamLog,
    is_on_grid,
    make_pose,
    make_scan,
)
from curvescan.io.files.lines import BrokenRecordError, ReadErrorCounter, printable, read_line_at, read_lines, text_file
from curvescan.io.log import Log, scans_with_poses
from curvescan.scan import LaserScan
from curvescan.types import Floats

FORMAT = "CSV of scans"
RANGES, ANGLES, INTENSITIES = "ranges", "angles", "intensities"
_TITLE = "# scans of a 2D laser: metres, radians, seconds; a line each, its ranges from the last column on\n"
_NOWHERE = -1  # offset of a line that there is not


def open_csv(path: Path, *, range_max: float | None = None, topic: str | None = None) -> StreamLog:
    """Return the scans of a CSV file, which has no topics; a line that breaks the layout is skipped and counted."""
    read, read_one = partial(_records, path, range_max), partial(_one, path, range_max)
    return StreamLog(path, kind=FORMAT, topic=topic, read=read, read_one=read_one)


def is_content(line: bytes) -> bool:
    """Return whether a line is neither blank nor a comment."""
    line = line.strip()
    return bool(line) and not line.startswith(b"#")


def header_names(line: bytes) -> tuple[str, ...]:
    """Return the names of the columns up to ``ranges``, without quotes and blanks."""
    text = line.decode("utf-8", errors="replace")
    names = [name.strip(' \t\r"') for name in text.split(",")]
    return tuple(names[: names.index(RANGES) + 1] if RANGES in names else names)


def _check_header(names: tuple[str, ...], path: object) -> None:
    """Raise LogFormatError when these columns do not make scans."""
    rule = f"{path} is a CSV file whose first line must name the columns"
    known = (*COLUMNS, *POSE_COLUMNS)
    if names[-1] != RANGES:
        raise LogFormatError(f"{rule}, the last of them {RANGES!r}: it holds {printable(', '.join(names[:9]), 200)}")
    for name in names[:-1]:
        if name not in known:
            raise LogFormatError(f"{rule}: {name[:40]!r} is none of {', '.join(known)}")
        if names.count(name) > 1:
            raise LogFormatError(f"{rule} once each: {name!r} is there twice")
    if "stamp" not in names:
        raise LogFormatError(f"{rule}: 'stamp' is missing")


def _records(path: Path, range_max: float | None, read_errors: ReadErrorCounter) -> Iterator[Record]:
    names: tuple[str, ...] = ()
    before: dict[str, Floats | None] = {ANGLES: None, INTENSITIES: None}
    places = dict.fromkeys(before, _NOWHERE)
    for number, offset, line in read_lines(path, read_errors):
        if not is_content(line):
            continue
        if not names:
            names = header_names(line)
            _check_header(names, path)
            continue
        fields = line.split(b",")
        tag = fields[0].strip().decode("utf-8", errors="replace")
        try:
            if tag in before:
                if tag == ANGLES:  # a broken line leaves none
                    before[tag], places[tag] = None, _NOWHERE
                before[tag], places[tag] = _numbers(fields[1:]), offset
            else:
                (angles, intensities), place = before.values(), (offset, *places.values())
                before[INTENSITIES], places[INTENSITIES] = None, _NOWHERE
                yield _record(fields, names, angles, intensities, range_max)._replace(place=place)
        except BrokenRecordError as error:
            read_errors.add(str(error), number)
    if not names:
        raise LogFormatError(f"{path} is empty: a log must hold at least one scan")


def _one(path: Path, range_max: float | None, place: tuple[int, ...]) -> LaserScan:
    """Return the scan whose line, and those of its angles and intensities, begin at these offsets."""
    header = next(line for _, _, line in read_lines(path, ReadErrorCounter()) if is_content(line))
    rows = [None if k == _NOWHERE else read_line_at(path, k).split(b",") for k in place]
    angles, intensities = (None if row is None else _numbers(row[1:]) for row in rows[1:])
    return _record(rows[0] or [], header_names(header), angles, intensities, range_max).scan


def _numbers(fields: list[bytes]) -> Floats:
    """Return the numbers of fields, NaN for an empty one. Raises BrokenRecordError."""
    try:
        return np.fromiter(map(float, fields), dtype=np.float64, count=len(fields))
    except ValueError:
        filled = (field if field.strip() else b"nan" for field in fields)
    try:
        return np.fromiter(map(float, filled), dtype=np.float64, count=len(fields))
    except ValueError:
        raise BrokenRecordError("line with a field that is not a number") from None


def _record(
    fields: list[bytes],
    names: tuple[str, ...],
    angles: Floats | None,
    intensities: Floats | None,
    range_max: float | None,
) -> Record:
    """Return the scan of a line, and the pose of the wheels in it. Raises BrokenRecordError."""
    n_columns = len(names) - 1
    if len(fields) < n_columns:
        raise BrokenRecordError("line cut short: fewer fields than the header names")
    numbers = _numbers(fields)
    ranges = numbers[n_columns:]
    value = {"stamp": math.nan, **DEFAULTS}
    value |= {k: v for k, v in zip(names, numbers[:n_columns].tolist(), strict=False) if not math.isnan(v)}
    if range_max is not None:
        value["range_max"] = range_max
    if intensities is not None and intensities.size != ranges.size:
        raise BrokenRecordError("line of intensities that has not one value a range")
    if not math.isnan(value["angle_min"] + value["angle_increment"]):
        angles = None
    elif angles is None:
        raise BrokenRecordError(
            "scan without directions: no angle_min and angle_increment, and no sound line of angles before"
        )
    elif angles.size != ranges.size:
        raise BrokenRecordError("line of angles that has not one value a range")
    return Record(
        make_scan(value, ranges, angles, intensities), make_pose(*(value.get(name, math.nan) for name in POSE_COLUMNS))
    )


def write_csv_scans(path: Path, log: Log, on_scan: Callable[[], object]) -> tuple[str, ...]:
    """Write a log as CSV; a LogWriter that loses nothing."""
    has_poses = log.odometry is not None
    angles: Floats = np.empty(0)
    with text_file(path) as file:
        file.write(_TITLE)
        file.write(",".join((*COLUMNS, *(POSE_COLUMNS if has_poses else ()), RANGES)) + "\n")
        for scan, pose in scans_with_poses(log):
            is_even = is_on_grid(scan)
            if not is_even and not np.array_equal(angles, scan.angles):
                angles = scan.angles
                file.write(f"{ANGLES},{_row(angles)}\n")
            if scan.intensities is not None and len(scan):
                file.write(f"{INTENSITIES},{_row(scan.intensities)}\n")
            left_out = () if is_even else ("angle_min", "angle_increment")
            file.write(",".join("" if name in left_out else repr(getattr(scan, name)) for name in COLUMNS))
            if has_poses:
                file.write(",,," if pose is None else f",{_row(pose)}")
            file.write(f",{_row(scan.ranges)}\n" if len(scan) else "\n")
            on_scan()
    return ()


def _row(values: Floats) -> str:
    return ",".join(map(repr, values.tolist()))
