"""Poses from CSV of anybody's making, whose first line names the columns."""

from __future__ import annotations

import csv
import os
from pathlib import Path

import numpy as np

from curvescan import se2
from curvescan.errors import LogFileError, LogFormatError
from curvescan.io.files.printable import printable
from curvescan.io.trajectories.rows import PoseRows

_STAMP_NAMES = ("stamp", "timestamp")
_POSE_NAMES = ("x", "y", "theta")


def column_rows(path: str | os.PathLike[str]) -> PoseRows:
    """Return the poses of a CSV file with the columns stamp (or timestamp), x, y and theta, and perhaps others.

    Blank lines and lines that start with ``#`` are skipped; the first other line names the columns.

    Raises LogFileError, LogFormatError.
    """
    try:
        text = Path(path).read_text(encoding="utf-8", errors="replace")
    except (OSError, ValueError) as error:
        raise LogFileError(f"cannot read {path}: {error}") from error
    # lines keep their numbers: a comment becomes a blank row, which the reader hands over as []
    lines = ["" if line.lstrip().startswith("#") else line for line in text.splitlines()]
    columns: list[int] = []
    names: list[str] = []
    rows: list[list[float]] = []
    try:
        for number, row in enumerate(csv.reader(lines), start=1):
            if not any(field.strip() for field in row):
                continue
            if not names:
                names = [name.strip().lower() for name in row]
                columns = _columns(names, path)
                continue
            rows.append(_row(row, len(names), columns, f"{path}, line {number}"))
    except csv.Error as error:
        raise LogFormatError(f"{path} is not a CSV file: {error}") from error
    if not rows:
        raise LogFormatError(f"{path} is empty: a trajectory must hold at least one pose")
    table = np.array(rows)
    poses = np.column_stack([table[:, 1:3], se2.wrap(table[:, 3])])
    return PoseRows(table[:, 0], poses)


def _columns(names: list[str], path: str | os.PathLike[str]) -> list[int]:
    stamp = next((name for name in _STAMP_NAMES if name in names), None)
    missing = [name for name in _POSE_NAMES if name not in names]
    if stamp is None or missing:
        raise LogFormatError(
            f"{path}: poses in CSV need the columns stamp (or timestamp), x, y and theta, got {', '.join(names)[:60]!r}"
        )
    return [names.index(name) for name in (stamp, *_POSE_NAMES)]


def _row(row: list[str], n: int, columns: list[int], where: str) -> list[float]:
    if len(row) != n:
        raise LogFormatError(f"{where}: a row has {n} fields, as the header has, got {len(row)}")
    try:
        return [float(row[k]) for k in columns]
    except ValueError as error:
        raise LogFormatError(f"{where}: a field is not a number ({printable(str(error), 120)})") from None
