"""The layout of scans as CSV, which reader and writer share.

Lines that are blank or start with ``#`` are skipped. The first other line names the columns: any of COLUMNS, in any
order, and at last ``ranges``. Then a line a scan; all fields from the column ``ranges`` on are its ranges, so that the number of
beams may change from line to line. Metres, radians, seconds; an empty field is NaN. Two kinds of lines may stand before a scan:

- ``angles,a0,a1,...``: directions of the beams of all scans from here on that give no angle_min and angle_increment;
- ``intensities,i0,i1,...``: strength of the returns of the next scan.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan.errors import InvalidArgumentError, LogFormatError
from curvescan.io.arrays.stream import NO_POSE, OPTIONAL, PoseRow, Record
from curvescan.io.files.printable import printable
from curvescan.scan import LaserScan
from curvescan.types import Floats

COLUMNS = ("stamp", "angle_min", "angle_increment", *OPTIONAL)
POSE_COLUMNS = ("x", "y", "theta")
"""Wheel odometry: pose of the laser at the scan."""

RANGES, ANGLES, INTENSITIES = "ranges", "angles", "intensities"

_BOM = b"\xef\xbb\xbf"


class BrokenRowError(LogFormatError):
    """A line breaks the rule that the message names; the message holds no value of the line."""


class Beams(NamedTuple):
    """What the lines before a scan say of it.

    Attributes
    ----------
    angles : (n,) float64 or None
        Directions of the beams, radians.
    intensities : (n,) float64 or None
        Strength of the returns.
    """

    angles: Floats | None = None
    intensities: Floats | None = None


def is_content(line: bytes) -> bool:
    """Return whether a line is neither blank nor a comment."""
    line = line.removeprefix(_BOM).strip()
    return bool(line) and not line.startswith(b"#")


def header_names(line: bytes) -> tuple[str, ...]:
    """Return the names of the columns up to ``ranges``, without quotes and blanks."""
    text = line.removeprefix(_BOM).decode("utf-8", errors="replace")
    names = [name.strip(' \t\r"') for name in text.split(",")]
    return tuple(names[: names.index(RANGES) + 1] if RANGES in names else names)


def check_header(names: tuple[str, ...], path: object) -> None:
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


def parse_numbers(fields: list[bytes]) -> Floats:
    """Return the numbers of fields, NaN for an empty one.

    Raises BrokenRowError.
    """
    try:
        return np.fromiter(map(float, fields), dtype=np.float64, count=len(fields))
    except ValueError:
        filled = (field if field.strip() else b"nan" for field in fields)
    try:
        return np.fromiter(map(float, filled), dtype=np.float64, count=len(fields))
    except ValueError:
        raise BrokenRowError("line with a field that is not a number") from None


def parse_scan(fields: list[bytes], names: tuple[str, ...], before: Beams, range_max: float | None) -> Record:
    """Return the scan of a line.

    Raises BrokenRowError.
    """
    n_columns = len(names) - 1
    if len(fields) < n_columns:
        raise BrokenRowError("line cut short: fewer fields than the header names")
    numbers = parse_numbers(fields)
    given = dict(zip(names, numbers[:n_columns].tolist(), strict=False))
    finite = {name: number for name, number in given.items() if not math.isnan(number)}
    value = {**OPTIONAL, **finite}
    if not math.isfinite(value.get("stamp", math.nan)):
        raise BrokenRowError("time stamp not finite")
    limit = value["range_max"] if range_max is None else range_max
    if not 0.0 <= value["range_min"] < limit:
        raise BrokenRowError("range limits break 0 <= range_min < range_max")
    ranges = numbers[n_columns:]
    if before.intensities is not None and before.intensities.size != ranges.size:
        raise BrokenRowError("line of intensities that has not one value a range")
    try:
        scan = LaserScan(
            ranges,
            **_directions(value, before.angles, ranges.size),  # type: ignore[arg-type]
            range_min=value["range_min"],
            range_max=limit,
            stamp=value["stamp"],
            intensities=before.intensities,
            time_increment=value["time_increment"],
            scan_time=value["scan_time"],
        )
    except InvalidArgumentError:
        raise BrokenRowError("angles or times that make no scan") from None
    return Record(scan, _pose(value))


def _directions(value: dict[str, float], angles: Floats | None, n: int) -> dict[str, object]:
    if "angle_min" in value and "angle_increment" in value:
        return {"angle_min": value["angle_min"], "angle_increment": value["angle_increment"]}
    if angles is None:
        raise BrokenRowError(
            "scan without directions: no angle_min and angle_increment, and no sound line of angles before"
        )
    if angles.size != n:
        raise BrokenRowError("line of angles that has not one value a range")
    return {"angles": angles}


def _pose(value: dict[str, float]) -> PoseRow:
    pose = value.get("x", math.nan), value.get("y", math.nan), value.get("theta", math.nan)
    return pose if all(map(math.isfinite, pose)) else NO_POSE
