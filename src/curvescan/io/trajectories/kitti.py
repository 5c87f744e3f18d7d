"""Trajectories as KITTI's odometry benchmark has them: the first three rows of each pose's matrix, twelve numbers a line."""

from __future__ import annotations

import os

import numpy as np

from curvescan.errors import LogFormatError
from curvescan.io.trajectories.rows import PoseRows, PosesInTime, numbers_of, reading_text, writing_text

N_NUMBERS = 12
"""Numbers a line: three rows of four."""

_LEAST_UPRIGHT = 0.996
"""Cosine of the largest tilt of a planar pose, 5 deg."""


def write_kitti(path: str | os.PathLike[str], trajectory: PosesInTime) -> None:
    """Write the poses of a trajectory, one line each; the stamps are not in it.

    The plane of motion is x, y; z is up and 0 (KITTI's own cameras look along z: no axis is turned here). Numbers have as many
    digits as it takes to read the same float64 again.

    Parameters
    ----------
    path : str or path-like
        The file, replaced if it exists.
    trajectory : Trajectory
        A pose of NaN is written as ``nan`` in the elements that depend on it.

    Raises
    ------
    OutputError
        When the file cannot be written.
    """
    x, y, theta = trajectory.poses.T
    cos, sin, zero, one = np.cos(theta), np.sin(theta), np.zeros_like(x), np.ones_like(x)
    rows = np.stack([cos, -sin, zero, x, sin, cos, zero, y, zero, zero, one, zero], axis=-1)
    with writing_text(path) as file:
        file.writelines(" ".join(map(repr, row)) + "\n" for row in rows.tolist())


def kitti_rows(path: str | os.PathLike[str]) -> PoseRows:
    """Return the poses of a KITTI file; see :func:`curvescan.read_kitti`."""
    rows: list[list[float]] = []
    with reading_text(path) as file:
        for number, line in enumerate(file, start=1):
            fields = line.split()
            if not fields:
                continue
            where = f"{path}, line {number}"
            if len(fields) != N_NUMBERS:
                raise LogFormatError(f"{where}: a KITTI line has {N_NUMBERS} numbers (3x4), got {len(fields)}")
            row = numbers_of(fields, where)
            if row[10] < _LEAST_UPRIGHT:  # False for NaN, a missing pose
                raise LogFormatError(
                    f"{where}: a planar pose turns about z alone, and this one tilts: KITTI's cameras look along z; "
                    "turn the poses so that z is up"
                )
            rows.append(row)
    if not rows:
        raise LogFormatError(f"{path} holds no pose: a KITTI line is a matrix of 3x4 numbers")
    table = np.array(rows)
    theta = np.arctan2(table[:, 4], table[:, 0])
    return PoseRows(np.arange(len(rows), dtype=np.float64), np.column_stack([table[:, 3], table[:, 7], theta]))
