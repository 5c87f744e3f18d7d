"""Trajectories to files and back: TUM text, and CSV with covariances.

TUM (Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems", 2012): ``stamp x y z qx qy qz qw`` a line. All
numbers are written with as many digits as it takes to read the same float64 again. In CSV everything comes back to
the bit; in TUM the stamp and the position do, while the angle passes through a quaternion and comes back within
1e-15 rad.
"""

from __future__ import annotations

import csv
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TextIO

import numpy as np

from curvescan import se2
from curvescan.errors import (
    CurvescanError,
    InvalidArgumentError,
    LogFileError,
    LogFormatError,
    OutputError,
)
from curvescan.io.files.output import output_file
from curvescan.io.files.printable import printable
from curvescan.types import Trajectory

CSV_HEADER = (
    "stamp", "x", "y", "theta",
    "cov_xx", "cov_xy", "cov_xt", "cov_yy", "cov_yt", "cov_tt",
    "outcome",
)  # fmt: skip

_UPPER = np.triu_indices(3)
_MAX_TILT = math.radians(5.0)


def write_tum(path: str | os.PathLike[str], trajectory: Trajectory) -> None:
    """Write a trajectory as TUM text, one line a pose, in its own order.

    Parameters
    ----------
    path : str or path-like
        The file, replaced if it exists.
    trajectory : Trajectory
        A pose of NaN is written as ``nan`` in all its fields.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    half = 0.5 * trajectory.poses[:, 2]
    rows = np.column_stack([trajectory.stamps, trajectory.poses[:, :2], np.sin(half), np.cos(half)])
    with writing_text(path) as file:
        for stamp, x, y, qz, qw in rows.tolist():
            file.write(f"{stamp!r} {x!r} {y!r} 0.0 0.0 0.0 {qz!r} {qw!r}\n")


def read_tum(path: str | os.PathLike[str]) -> Trajectory:
    """Return the trajectory of a TUM file whose motion is in the plane.

    Blank lines and lines that start with ``#`` are skipped. z is dropped; the angle is the yaw of the quaternion, which need not
    be normalised.

    Parameters
    ----------
    path : str or path-like
        The file.

    Returns
    -------
    Trajectory
        In file order, without covariances.

    Raises
    ------
    LogFileError
        When the file cannot be opened.
    LogFormatError
        When a line does not hold 8 numbers, a quaternion is zero or tilts by more than 5 deg out of the plane, or there is no line.
    """
    stamps: list[float] = []
    poses: list[tuple[float, float, float]] = []
    with reading_text(path) as file:
        for number, line in enumerate(file, start=1):
            fields = line.split()
            if not fields or fields[0].startswith("#"):
                continue
            where = f"{path}, line {number}"
            if len(fields) != 8:
                raise LogFormatError(
                    f"{where}: a TUM line has 8 fields (stamp x y z qx qy qz qw), got {len(fields)}"
                )
            stamp, x, y, _, *quaternion = numbers_of(fields, where)
            stamps.append(stamp)
            poses.append((x, y, _yaw(quaternion, where)))
    if not stamps:
        raise LogFormatError(f"{path} holds no pose: a TUM line is stamp x y z qx qy qz qw")
    return Trajectory(stamps=np.array(stamps), poses=np.array(poses))


def write_csv(
    path: str | os.PathLike[str], trajectory: Trajectory, outcomes: Sequence[str]
) -> None:
    """Write a trajectory with covariances and outcomes as CSV, one line a pose, in its own order.

    Parameters
    ----------
    path : str or path-like
        The file, replaced if it exists. The columns are CSV_HEADER.
    trajectory : Trajectory
        Of each covariance the upper triangle is written; the fields stay empty when there are none.
    outcomes : sequence of str
        Short name of what became of each scan, one a pose.

    Raises
    ------
    InvalidArgumentError
        When there is not one outcome a pose.
    OutputError
        When the file cannot be written.
    """
    if len(outcomes) != len(trajectory):
        raise InvalidArgumentError(
            f"outcomes must have one name a pose ({len(trajectory)}), got {len(outcomes)}"
        )
    with writing_text(path) as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(CSV_HEADER)
        for i, (stamp, pose, outcome) in enumerate(
            zip(trajectory.stamps.tolist(), trajectory.poses, outcomes, strict=True)
        ):
            cov: list[object] = [""] * 6
            if trajectory.covariances is not None:
                cov = trajectory.covariances[i][_UPPER].tolist()
            writer.writerow([stamp, *pose.tolist(), *cov, outcome])


def read_csv(path: str | os.PathLike[str]) -> tuple[Trajectory, tuple[str, ...]]:
    """Return the trajectory and the outcomes that write_csv wrote.

    Parameters
    ----------
    path : str or path-like
        The file.

    Returns
    -------
    trajectory : Trajectory
        In file order; without covariances when their fields are empty on every line.
    outcomes : tuple of str
        One a pose.

    Raises
    ------
    LogFileError
        When the file cannot be opened.
    LogFormatError
        When the header is another or a line does not fit it.
    """
    numbers: list[list[float]] = []
    outcomes: list[str] = []
    is_any_cov = False
    with reading_text(path) as file:
        reader = csv.reader(file)
        if tuple(next(reader, ())) != CSV_HEADER:
            raise LogFormatError(
                f"{path} is not a trajectory: its first line must be {','.join(CSV_HEADER)!r}"
            )
        for row in reader:
            where = f"{path}, line {reader.line_num}"
            if len(row) != len(CSV_HEADER):
                raise LogFormatError(
                    f"{where}: a row has {len(CSV_HEADER)} fields, as the header has, got {len(row)}"
                )
            has_cov = any(row[4:10])
            numbers.append(numbers_of(row[:10] if has_cov else [*row[:4], *["nan"] * 6], where))
            is_any_cov |= has_cov
            outcomes.append(row[10])
    table = np.array(numbers).reshape(-1, 10)
    covariances = None
    if is_any_cov:
        covariances = np.empty((len(table), 3, 3))
        covariances[:, _UPPER[0], _UPPER[1]] = table[:, 4:]
        covariances[:, _UPPER[1], _UPPER[0]] = table[:, 4:]
    trajectory = Trajectory(stamps=table[:, 0], poses=table[:, 1:4], covariances=covariances)
    return trajectory, tuple(outcomes)


def _yaw(quaternion: list[float], where: str) -> float:
    qx, qy, qz, qw = quaternion
    across, along = math.hypot(qx, qy), math.hypot(qz, qw)
    if across == 0.0 and along == 0.0:
        raise LogFormatError(f"{where}: a quaternion must not be zero")
    # angle between the z axes of sensor and world; NaN, a missing pose, is no tilt
    tilt = 2.0 * math.atan2(across, along)
    if tilt > _MAX_TILT:
        raise LogFormatError(
            f"{where}: a planar pose turns about z alone, and this one tilts by "
            f"{math.degrees(tilt):.1f} deg: project the trajectory onto the plane first"
        )
    return float(se2.wrap(2.0 * math.atan2(qz, qw)))


def numbers_of(fields: Iterable[str], where: str) -> list[float]:
    """Return the numbers of a line; raise LogFormatError where a field is none."""
    try:
        return [float(field) for field in fields]
    except ValueError as error:
        raise LogFormatError(
            f"{where}: a field is not a number ({printable(str(error), 120)})"
        ) from None


@contextmanager
def writing_text(path: str | os.PathLike[str]) -> Iterator[TextIO]:
    """Yield a text file that replaces `path` in one step when the block ends; raise OutputError where it cannot."""
    try:
        with output_file(path) as new, new.open("w", encoding="utf-8", newline="") as file:
            yield file
    except CurvescanError:
        raise
    except (OSError, ValueError) as error:
        raise OutputError(f"cannot write {path}: {error}") from error


@contextmanager
def reading_text(path: str | os.PathLike[str]) -> Iterator[TextIO]:
    """Yield a text file to read; raise LogFileError or LogFormatError where it cannot be read."""
    try:
        with Path(path).open(encoding="utf-8", errors="replace", newline="") as file:
            yield file
    except (LogFileError, LogFormatError):
        raise
    except FileNotFoundError as error:
        raise LogFileError(f"trajectory {path} does not exist: check the path") from error
    except csv.Error as error:
        raise LogFormatError(f"{path} is not a CSV file: {error}") from error
    except (OSError, ValueError) as error:
        raise LogFileError(f"cannot read {path}: {error}") from error
