"""Scans from CSV files, for those who write their own driver; the layout is that of csv_layout.py."""

from __future__ import annotations

from collections.abc import Iterator
from functools import partial
from pathlib import Path

from curvescan.errors import LogFormatError
from curvescan.io.arrays.csv_layout import (
    ANGLES,
    INTENSITIES,
    Beams,
    BrokenRowError,
    check_header,
    header_names,
    is_content,
    parse_numbers,
    parse_scan,
)
from curvescan.io.arrays.stream import Record, StreamLog, refuse_topic
from curvescan.io.files.lines import LineMark, read_line_at, read_lines
from curvescan.io.files.read_errors import ReadErrorCounter
from curvescan.scan import LaserScan

FORMAT = "CSV of scans"

_NOWHERE = -1
"""Offset of a line that there is not."""


def open_csv(path: Path, *, range_max: float | None = None, topic: str | None = None) -> StreamLog:
    """Return the scans of a CSV file; a line that breaks the layout is skipped and counted.

    topic: Only None: a CSV file has no topics. Raises LogFileError, LogFormatError, InvalidArgumentError.
    """
    refuse_topic(path, FORMAT, topic)
    read = partial(_records, path, range_max)
    return StreamLog(str(path), name=path.name, kind=FORMAT, read=read, read_one=partial(_one, path, range_max))


def _records(path: Path, range_max: float | None, read_errors: ReadErrorCounter) -> Iterator[Record]:
    names: tuple[str, ...] = ()
    before, mark = Beams(), LineMark()
    angles_at = intensities_at = _NOWHERE
    for number, line in read_lines(path, read_errors, mark):
        if not is_content(line):
            continue
        if not names:
            names = header_names(line)
            check_header(names, path)
            continue
        fields = line.split(b",")
        tag = fields[0].strip()
        try:
            if tag == ANGLES.encode():
                before, angles_at = (before._replace(angles=None), _NOWHERE)  # a broken line leaves none
                before = before._replace(angles=parse_numbers(fields[1:]))
                angles_at = mark.offset
            elif tag == INTENSITIES.encode():
                before = before._replace(intensities=parse_numbers(fields[1:]))
                intensities_at = mark.offset
            else:
                now, before = before, before._replace(intensities=None)
                place = (mark.offset, angles_at, intensities_at)
                intensities_at = _NOWHERE
                yield parse_scan(fields, names, now, range_max)._replace(place=place)
        except BrokenRowError as error:
            read_errors.add(str(error), number)
    if not names:
        raise LogFormatError(f"{path} is empty: a log must hold at least one scan")


def _one(path: Path, range_max: float | None, place: tuple[int, ...]) -> LaserScan:
    """Return the scan whose line, and those of its angles and intensities, begin at these offsets."""
    at, angles_at, intensities_at = place
    header = next(line for _, line in read_lines(path, ReadErrorCounter()) if is_content(line))
    angles, intensities = (
        None if k == _NOWHERE else parse_numbers(read_line_at(path, k).split(b",")[1:])
        for k in (angles_at, intensities_at)
    )
    beams = Beams(angles=angles, intensities=intensities)
    fields = read_line_at(path, at).split(b",")
    return parse_scan(fields, header_names(header), beams, range_max).scan
