"""Poses to a file and back: the format by the file's ending when they are written, by its content when they are read."""

from __future__ import annotations

import math
import os
from pathlib import Path
from typing import Literal, TypeAlias, get_args

from curvescan.errors import InvalidArgumentError, LogFileError, LogFormatError
from curvescan.io.files.lines import GZIP_MAGIC, read_head
from curvescan.io.trajectories.columns import column_rows
from curvescan.io.trajectories.kitti import N_NUMBERS, kitti_rows, write_kitti
from curvescan.io.trajectories.rows import PoseRows, PosesInTime
from curvescan.io.trajectories.tum_csv import CSV_HEADER, csv_rows, tum_rows, write_csv, write_tum

TrajectoryFormat: TypeAlias = Literal["tum", "csv", "kitti"]
"""Formats in which a trajectory is written and read."""

_ENDINGS: dict[str, TrajectoryFormat] = {".tum": "tum", ".txt": "tum", ".csv": "csv", ".kitti": "kitti"}

_HEAD_BYTES = 1 << 12


def write_poses(
    path: str | os.PathLike[str],
    trajectory: PosesInTime,
    *,
    format: TrajectoryFormat | None = None,  # noqa: A002 - what it is
) -> None:
    """Write poses; see :meth:`curvescan.Trajectory.write`."""
    ending = Path(path).suffix.lower()
    kind = format or _ENDINGS.get(ending)
    if kind is None:
        raise InvalidArgumentError(
            f"no format of trajectories has the ending {ending!r} of {Path(path).name}: end the name with "
            f"{', '.join(_ENDINGS)}, or give format="
        )
    if kind == "tum":
        write_tum(path, trajectory)
    elif kind == "csv":
        write_csv(path, trajectory, [""] * len(trajectory.stamps))
    elif kind == "kitti":
        write_kitti(path, trajectory)
    else:
        raise InvalidArgumentError(f"format must be one of {', '.join(get_args(TrajectoryFormat))}, got {kind!r}")


def read_rows(path: str | os.PathLike[str]) -> PoseRows:
    """Return the poses in a file; see :meth:`curvescan.Trajectory.read`."""
    file = results_file(path)
    if file.is_dir():
        raise LogFileError(f"{path} is a folder without a trajectory.csv: give the results of a run, or a file")
    if not file.exists():
        raise LogFileError(f"trajectory {path} does not exist: check the path")
    first = first_line(read_head(file, _HEAD_BYTES))
    if is_our_csv(first):
        return csv_rows(file)[0]
    if _n_numbers(first) == N_NUMBERS:
        return kitti_rows(file)
    return plain_rows(file, first)


def plain_rows(path: Path, first: str) -> PoseRows:
    """Return the poses of TUM text, or of CSV whose columns have names.

    Raises LogFileError, LogFormatError.
    """
    if not first:
        raise LogFormatError(f"{path} is empty: a trajectory must hold at least one pose")
    is_tum = _n_numbers(first) > 3
    if not is_tum and "," not in first:
        raise LogFormatError(
            f"{path} holds no poses that can be read: give TUM text, CSV with columns stamp, x, y, theta, "
            "or a log, whose poses are read_log(path).odometry"
        )
    if _is_packed(path):
        raise LogFormatError(f"{path} is compressed with gzip and not a log: unpack it first")
    if is_tum:
        _check_quaternion(first.split(), path)
        return tum_rows(path)
    return column_rows(path)


def results_file(path: str | os.PathLike[str]) -> Path:
    """Return the trajectory in a folder of results; any other path as it is."""
    file = Path(path)
    if file.is_dir() and (file / "trajectory.csv").exists():
        return file / "trajectory.csv"
    return file


def is_our_csv(first: str) -> bool:
    """Return whether a first line is the header of the CSV that this package writes."""
    return first.split(",") == list(CSV_HEADER)


def first_line(head: bytes) -> str:
    """Return the first line that is neither blank nor a comment; "" without any."""
    for line in head.splitlines():
        if line.strip() and not line.lstrip().startswith(b"#"):
            return line.strip().decode("utf-8", errors="replace")
    return ""


def _n_numbers(line: str) -> int:
    """Return how many numbers a line is; 0 where it holds anything else."""
    try:
        return len([float(field) for field in line.split()])
    except ValueError:
        return 0


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
