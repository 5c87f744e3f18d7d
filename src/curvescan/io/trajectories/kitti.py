"""Trajectories as KITTI's odometry benchmark has them: the first three rows of each pose's matrix, twelve numbers a line."""

from __future__ import annotations

import os

import numpy as np

from curvescan.io.trajectories.tum_csv import writing_text
from curvescan.types import Trajectory


def write_kitti(path: str | os.PathLike[str], trajectory: Trajectory) -> None:
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
