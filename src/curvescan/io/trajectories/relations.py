"""Relative poses in files: the relations of the Freiburg SLAM benchmark, read, and pose graphs for g2o, written.

R. Kümmerle et al., "On measuring the accuracy of SLAM algorithms", Autonomous Robots 27 (2009). One relation a line:
``t1 t2 x y z roll pitch yaw``, the pose of the robot at t2 seen from the robot at t1; seconds, metres, radians.

g2o (Kuemmerle et al., "g2o: a general framework for graph optimization", 2011) takes the error of an edge in the frame
of the measured pose: delta = measurement^-1 (x_i^-1 x_j). Our covariances are of x, y, theta in the frame of scan i, so
each is turned by -theta before it is inverted to the information matrix.
"""

from __future__ import annotations

import math
import os
from array import array
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from curvescan import se2
from curvescan.errors import InvalidArgumentError, LogFileError, LogFormatError
from curvescan.io.files.lines import ReadErrorCounter, as_path, read_lines
from curvescan.io.trajectories.layouts import checked, writing_text
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.types import Bools, Cov, Floats, Pose, PoseEdge

_MAX_TILT = math.radians(5.0)


@dataclass(frozen=True, eq=False, kw_only=True)
class Relations:
    """Relative poses between scans of a log, in the order of their file.

    Attributes
    ----------
    first_stamps, second_stamps : (n,) float64
        Seconds, as the log gives them; some second ones are the earlier.
    poses : (n, 3) float64
        [x, y, theta] of the robot at the second stamp seen from the robot at the first.

    Raises
    ------
    InvalidArgumentError
        When the lengths disagree.
    """

    first_stamps: Floats
    second_stamps: Floats
    poses: Pose

    def __post_init__(self) -> None:
        n = len(self.first_stamps)
        if self.second_stamps.shape != (n,) or self.poses.shape != (n, 3):
            raise InvalidArgumentError(
                "relations have stamps of shape (n,) and poses of shape (n, 3), got "
                f"{self.first_stamps.shape}, {self.second_stamps.shape} and {self.poses.shape}"
            )

    def __len__(self) -> int:
        return len(self.first_stamps)

    @property
    def gaps(self) -> Floats:
        """(n,) time between the two scans of each relation, seconds, at least 0."""
        gaps: Floats = np.abs(self.second_stamps - self.first_stamps)
        return gaps


def read_relations(path: str | os.PathLike[str]) -> Relations:
    """Return the relations in a file, plain or gzip-compressed.

    Blank lines and lines that start with ``#`` are skipped; z is dropped.

    Parameters
    ----------
    path : str or path-like
        The file.

    Raises
    ------
    LogFileError
        When the file cannot be opened.
    LogFormatError
        When a line does not hold 8 finite numbers or leaves the plane by more than 5 deg, the file is damaged, or there
        is no line.
    """
    rows = array("d")
    read_errors = ReadErrorCounter()
    if not as_path(path, "a file of relations").exists():  # the reader of lines would speak of a log
        raise LogFileError(f"relations file {path} does not exist: check the path")
    for number, _, line in read_lines(Path(path), read_errors):
        fields = line.split()
        if fields and not fields[0].startswith(b"#"):
            rows.extend(_numbers(fields, f"{path}, line {number}"))
    for read_error in read_errors.read_errors():
        raise LogFormatError(f"{path}, {read_error.first}: {read_error.rule}")
    if not rows:
        raise LogFormatError(f"{path} holds no relation: a line is t1 t2 x y z roll pitch yaw (s, m, rad)")
    table = np.array(rows).reshape(-1, 8)
    return Relations(
        first_stamps=table[:, 0],
        second_stamps=table[:, 1],
        poses=np.column_stack([table[:, 2:4], se2.wrap(table[:, 7])]),
    )


def _numbers(fields: list[bytes], where: str) -> list[float]:
    if len(fields) != 8:
        raise LogFormatError(f"{where}: a relation has 8 fields (t1 t2 x y z roll pitch yaw), got {len(fields)}")
    try:
        values = [float(field) for field in fields]
    except ValueError:
        values = [math.nan]
    if not all(map(math.isfinite, values)):
        raise LogFormatError(f"{where}: a field of a relation is not a finite number")
    tilt = max(abs(values[5]), abs(values[6]))
    if tilt > _MAX_TILT:
        raise LogFormatError(
            f"{where}: a planar relation turns about z alone, and this one tilts by {math.degrees(tilt):.1f} deg"
        )
    return values


_UPPER = np.triu_indices(3)


def write_g2o(path: str | os.PathLike[str], trajectory: Trajectory, edges: Iterable[PoseEdge]) -> None:
    """Write a pose graph: a vertex a pose, by its number, and an edge a measurement; vertex 0 is fixed.

    Parameters
    ----------
    path : str or path-like
        The file, replaced if it exists.
    trajectory : Trajectory
        Where the optimiser starts; a pose of NaN has no vertex.
    edges : iterable of PoseEdge
        Between poses that are known.

    Raises
    ------
    InvalidArgumentError
        When an edge leads to a vertex that is not there, or its covariance is not positive definite.
    OutputError
        When the file cannot be written.
    """
    known: Bools = np.asarray(np.all(np.isfinite(checked(trajectory).poses), axis=1))
    with writing_text(path) as file:
        for i in np.flatnonzero(known).tolist():
            file.write(f"VERTEX_SE2 {i} {_row(trajectory.poses[i].tolist())}\n")
        for edge in edges:
            for k in (edge.i, edge.j):
                if not (0 <= k < len(known) and known[k]):
                    raise InvalidArgumentError(
                        f"an edge must join known poses, got {edge.i} to {edge.j} of {len(known)}"
                    )
            information = information_of(edge)[_UPPER].tolist()
            file.write(f"EDGE_SE2 {edge.i} {edge.j} {_row(edge.pose.tolist())} {_row(information)}\n")
        # last: some readers of the format stop at a word that they do not know
        if known.any():
            file.write(f"FIX {int(np.argmax(known))}\n")


def information_of(edge: PoseEdge) -> Cov:
    """Return the (3, 3) information matrix of an edge in the frame of its measured pose."""
    cos, sin = np.cos(edge.pose[2]), np.sin(edge.pose[2])
    turn = np.array([[cos, sin, 0.0], [-sin, cos, 0.0], [0.0, 0.0, 1.0]])
    try:
        lower = np.linalg.cholesky(turn @ edge.covariance @ turn.T)
    except np.linalg.LinAlgError:
        raise InvalidArgumentError(
            f"the covariance of an edge must be positive definite, got {edge.covariance.tolist()} from {edge.i} to "
            f"{edge.j}"
        ) from None
    inverse = np.linalg.inv(lower)
    return inverse.T @ inverse


def _row(values: Sequence[float]) -> str:
    return " ".join(map(repr, values))
