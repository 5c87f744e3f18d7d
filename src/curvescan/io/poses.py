"""read_poses: a trajectory or a reference from whatever file holds one, its format detected by content.

TUM text; CSV as the odometry writes it; CSV with columns stamp (or timestamp), x, y, theta; a log, whose own poses
count: wheel odometry, or what a SLAM system has corrected.
"""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from curvescan.errors import LogFileError, LogFormatError
from curvescan.io.files.lines import read_head
from curvescan.io.formats import FORMATS, HEAD_BYTES
from curvescan.io.reading import read_log
from curvescan.io.trajectories.layouts import first_line, is_our_csv, plain_rows, results_file
from curvescan.io.trajectories.trajectory import Trajectory


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseFile:
    """Poses and what the file says of them."""

    trajectory: Trajectory  # in file order; a row of NaN where a log gives no pose for a scan
    is_of_sensor: bool  # whether the format fixes that these are poses of the sensor; otherwise they may be the robot's


def read_poses(path: str | os.PathLike[str]) -> PoseFile:
    """Return the poses in a file.

    Parameters
    ----------
    path : str or path-like
        TUM text, CSV, or a log of any format that ``read_log`` reads; or a folder that ``curvescan odometry`` wrote,
        whose trajectory.csv is then read.

    Raises
    ------
    LogFileError
        When the file cannot be opened.
    LogFormatError
        When it holds no poses, or is of no such format.
    """
    file = results_file(path)
    if file.is_dir():
        return _poses_of_log(file)
    if not file.exists():  # the readers of logs would speak of a log
        raise LogFileError(f"trajectory {path} does not exist: check the path")
    head = read_head(file, HEAD_BYTES)
    if any(row.sniff(head) for row in FORMATS):
        return _poses_of_log(file)
    first = first_line(head)
    rows = plain_rows(file, first)
    return PoseFile(trajectory=Trajectory(**rows._asdict()), is_of_sensor=is_our_csv(first))


def _poses_of_log(path: Path) -> PoseFile:
    log = read_log(path)
    if log.odometry is None:
        raise LogFormatError(f"{path} is a log without poses: run `curvescan odometry` on it and give what that writes")
    return PoseFile(trajectory=log.odometry, is_of_sensor=True)
