"""read_poses: a trajectory or a reference from whatever file holds one, its format detected by content.

TUM text; CSV as the odometry writes it; CSV with columns stamp (or timestamp), x, y, theta; a log, whose own poses
count: wheel odometry, or what a SLAM system has corrected.
"""

from __future__ import annotations

import csv
import math
import os
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from curvescan import se2
from curvescan.errors import LogFileError, LogFormatError
from curvescan.io.files.lines import GZIP_MAGIC, read_head
from curvescan.io.files.printable import printable
from curvescan.io.formats import FORMATS, HEAD_BYTES
from curvescan.io.reading import read_log
from curvescan.io.trajectories.tum_csv import CSV_HEADER, read_tum
from curvescan.types import Trajectory

_STAMP_NAMES = ("stamp", "timestamp")
_POSE_NAMES = ("x", "y", "theta")


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseFile:
    """Poses and what the file says of them.

    Attributes
    ----------
    trajectory : Trajectory
        In file order; a row of NaN where a log gives no pose for a scan.
    is_of_sensor : bool
        Whether the format fixes that these are poses of the sensor; otherwise they may be the robot's.
    """

    trajectory: Trajectory
    is_of_sensor: bool


def read_poses(path: str | os.PathLike[str]) -> PoseFile:
    """Return the poses in a file.

    Parameters
    ----------
    path : str or path-like
        TUM text, CSV, or a log of any format that ``read_log`` reads; or a folder that ``curvescan odometry`` wrote, whose
        trajectory.csv is then read.

    Raises
    ------
    LogFileError
        When the file cannot be opened.
    LogFormatError
        When it holds no poses, or is of no such format.
    """
    file = Path(path)
    if file.is_dir() and (file / "trajectory.csv").exists():
        file = file / "trajectory.csv"
    if file.is_dir():
        return _poses_of_log(file)
    if not file.exists():  # the readers of logs would speak of a log
        raise LogFileError(f"trajectory {path} does not exist: check the path")
    head = read_head(file, HEAD_BYTES)
    if not head.strip():
        raise LogFormatError(f"{path} is empty: a trajectory must hold at least one pose")
    if any(row.sniff(head) for row in FORMATS):
        return _poses_of_log(file)
    first = _first_line(head)
    is_tum, is_csv = _is_tum(first), "," in first
    if not is_tum and not is_csv:
        raise LogFormatError(
            f"{path} holds no poses that can be read: give TUM text, CSV with columns stamp, x, y, theta, or a log"
        )
    if _is_packed(file):
        raise LogFormatError(f"{path} is compressed with gzip and not a log: unpack it first")
    if is_tum:
        _check_quaternion(first.split(), path)
        return PoseFile(trajectory=read_tum(file), is_of_sensor=False)
    return PoseFile(
        trajectory=read_pose_csv(file), is_of_sensor=first.split(",") == list(CSV_HEADER)
    )


def read_pose_csv(path: str | os.PathLike[str]) -> Trajectory:
    """Return the poses of a CSV file with the columns stamp (or timestamp), x, y and theta, and perhaps others.

    Blank lines and lines that start with ``#`` are skipped; the first other line names the columns.

    Parameters
    ----------
    path : str or path-like
        The file; metres, radians, seconds.

    Raises
    ------
    LogFileError
        When the file cannot be opened.
    LogFormatError
        When a column is missing, a line does not fit the header or holds no numbers, or there is no pose.
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
    return Trajectory(stamps=table[:, 0], poses=poses)


def _poses_of_log(path: Path) -> PoseFile:
    log = read_log(path)
    if log.odometry is None:
        raise LogFormatError(
            f"{path} is a log without poses: run `curvescan odometry` on it and give what that writes"
        )
    return PoseFile(trajectory=log.odometry, is_of_sensor=True)


def _first_line(head: bytes) -> str:
    """Return the first line that is neither blank nor a comment; "" without any."""
    for line in head.splitlines():
        if line.strip() and not line.lstrip().startswith(b"#"):
            return line.strip().decode("utf-8", errors="replace")
    return ""


def _is_tum(line: str) -> bool:
    try:
        return len([float(field) for field in line.split()]) > 3
    except ValueError:
        return False


def _check_quaternion(fields: list[str], path: str | os.PathLike[str]) -> None:
    """Refuse a line of eight numbers that are no pose: relations have as many."""
    length = math.hypot(*map(float, fields[4:8]))
    if len(fields) == 8 and abs(length - 1.0) > 0.01:
        raise LogFormatError(
            f"{path}: the quaternion of a TUM line (stamp x y z qx qy qz qw) has length 1, that of the first line has "
            f"{length:.3g}: if the file holds relations, read it with read_relations"
        )


def _is_packed(path: Path) -> bool:
    with path.open("rb") as file:
        return file.read(2) == GZIP_MAGIC


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
        raise LogFormatError(
            f"{where}: a field is not a number ({printable(str(error), 120)})"
        ) from None
