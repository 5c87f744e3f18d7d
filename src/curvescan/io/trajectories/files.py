"""A trajectory to a file and back: the format by the file's ending when it is written, by its content when it is read."""

from __future__ import annotations

import os
from pathlib import Path
from typing import get_args

from curvescan.errors import InvalidArgumentError, LogFormatError
from curvescan.io.files.lines import read_head
from curvescan.io.trajectories.kitti import N_NUMBERS, read_kitti, write_kitti
from curvescan.io.trajectories.poses import read_poses
from curvescan.io.trajectories.tum_csv import CSV_HEADER, read_csv, write_csv, write_tum
from curvescan.types import Trajectory, TrajectoryFormat

_ENDINGS: dict[str, TrajectoryFormat] = {
    ".tum": "tum",
    ".txt": "tum",
    ".csv": "csv",
    ".kitti": "kitti",
}

_HEAD_BYTES = 1 << 12


def write_trajectory(
    path: str | os.PathLike[str],
    trajectory: Trajectory,
    *,
    format: TrajectoryFormat | None = None,  # noqa: A002 - what it is
) -> None:
    """Write a trajectory; see :meth:`curvescan.Trajectory.write`."""
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
        write_csv(path, trajectory, [""] * len(trajectory))
    elif kind == "kitti":
        write_kitti(path, trajectory)
    else:
        raise InvalidArgumentError(
            f"format must be one of {', '.join(get_args(TrajectoryFormat))}, got {kind!r}"
        )


def read_trajectory(path: str | os.PathLike[str]) -> Trajectory:
    """Return the trajectory in a file; see :meth:`curvescan.Trajectory.read`."""
    file = Path(path)
    if file.is_dir() and (file / "trajectory.csv").exists():
        file = file / "trajectory.csv"
    if file.is_file():
        first = read_head(file, _HEAD_BYTES).split(b"\n", 1)[0].decode("utf-8", errors="replace")
        if first.strip() == ",".join(CSV_HEADER):
            return read_csv(file)[0]
        if len(first.split()) == N_NUMBERS and _are_numbers(first):
            return read_kitti(file)
    found = read_poses(file).trajectory
    if not len(found):
        raise LogFormatError(f"{path} holds no pose")
    return found


def _are_numbers(line: str) -> bool:
    try:
        return len([float(field) for field in line.split()]) > 0
    except ValueError:
        return False
