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
from collections.abc import Sequence

import numpy as np

from curvescan import se2
from curvescan.errors import InvalidArgumentError, LogFormatError
from curvescan.io.trajectories.rows import PoseRows, PosesInTime, numbers_of, reading_text, writing_text

CSV_HEADER = (
    "stamp", "x", "y", "theta",
    "cov_xx", "cov_xy", "cov_xt", "cov_yy", "cov_yt", "cov_tt",
    "outcome",
)  # fmt: skip

_UPPER = np.triu_indices(3)
_MAX_TILT = math.radians(5.0)


def write_tum(path: str | os.PathLike[str], trajectory: PosesInTime) -> None:
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


def tum_rows(path: str | os.PathLike[str]) -> PoseRows:
    """Return the poses of a TUM file; see :func:`curvescan.read_tum`."""
    stamps: list[float] = []
    poses: list[tuple[float, float, float]] = []
    with reading_text(path) as file:
        for number, line in enumerate(file, start=1):
            fields = line.split()
            if not fields or fields[0].startswith("#"):
                continue
            where = f"{path}, line {number}"
            if len(fields) != 8:
                raise LogFormatError(f"{where}: a TUM line has 8 fields (stamp x y z qx qy qz qw), got {len(fields)}")
            stamp, x, y, _, *quaternion = numbers_of(fields, where)
            stamps.append(stamp)
            poses.append((x, y, _yaw(quaternion, where)))
    if not stamps:
        raise LogFormatError(f"{path} holds no pose: a TUM line is stamp x y z qx qy qz qw")
    return PoseRows(np.array(stamps), np.array(poses))


def write_csv(path: str | os.PathLike[str], trajectory: PosesInTime, outcomes: Sequence[str]) -> None:
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
    if len(outcomes) != len(trajectory.stamps):
        raise InvalidArgumentError(
            f"outcomes must have one name a pose ({len(trajectory.stamps)}), got {len(outcomes)}"
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


def csv_rows(path: str | os.PathLike[str]) -> tuple[PoseRows, tuple[str, ...]]:
    """Return poses and outcomes that write_csv wrote; see :func:`curvescan.read_csv`."""
    numbers: list[list[float]] = []
    outcomes: list[str] = []
    is_any_cov = False
    with reading_text(path) as file:
        reader = csv.reader(file)
        if tuple(next(reader, ())) != CSV_HEADER:
            raise LogFormatError(f"{path} is not a trajectory: its first line must be {','.join(CSV_HEADER)!r}")
        for row in reader:
            where = f"{path}, line {reader.line_num}"
            if len(row) != len(CSV_HEADER):
                raise LogFormatError(f"{where}: a row has {len(CSV_HEADER)} fields, as the header has, got {len(row)}")
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
    return PoseRows(table[:, 0], table[:, 1:4], covariances), tuple(outcomes)


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
