"""Trajectory: poses over time, which are written to files and read from them."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from typing import overload

import numpy as np

from curvescan.configs import counted
from curvescan.errors import InvalidArgumentError
from curvescan.io.trajectories.layouts import TUM, TrajectoryFormat, csv_rows, read_rows, rows_of, write_poses
from curvescan.types import Cov, Floats, Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class Trajectory:
    """Poses over time, one row a scan, in the order of the log.

    ``len(t)``, ``t[i]`` (a pose), ``t[a:b]`` (a trajectory); iteration gives the poses.

    Attributes
    ----------
    stamps : (n,) float64
        Seconds, as the log gives them; they may repeat or go back.
    poses : (n, 3) float64
        [x, y, theta] of the sensor in the trajectory's own fixed frame; a row of NaN where the log
        gives no pose for that scan.
    covariances : (n, 3, 3) float64 or None
        Covariance of each pose in the fixed frame; None when the source gives none.

    Raises
    ------
    InvalidArgumentError
        When the lengths or shapes disagree.
    """

    stamps: Floats
    poses: Pose
    covariances: Cov | None = None

    def __post_init__(self) -> None:
        stamps = np.ascontiguousarray(self.stamps, dtype=np.float64)
        poses = np.ascontiguousarray(self.poses, dtype=np.float64)
        if stamps.ndim != 1 or poses.shape != (stamps.size, 3):
            raise InvalidArgumentError(
                f"a trajectory has stamps of shape (n,) and poses of shape (n, 3), got {stamps.shape} and {poses.shape}"
            )
        object.__setattr__(self, "stamps", stamps)
        object.__setattr__(self, "poses", poses)
        if self.covariances is not None:
            covariances = np.ascontiguousarray(self.covariances, dtype=np.float64)
            if covariances.shape != (stamps.size, 3, 3):
                raise InvalidArgumentError(
                    f"covariances must have shape ({stamps.size}, 3, 3), got {covariances.shape}"
                )
            object.__setattr__(self, "covariances", covariances)

    def __eq__(self, other: object) -> bool:
        """Return whether stamps, poses and covariances are the same to the bit; NaN equals NaN."""
        if not isinstance(other, Trajectory):
            return NotImplemented
        pairs = ((self.stamps, other.stamps), (self.poses, other.poses))
        if not all(np.array_equal(a, b, equal_nan=True) for a, b in pairs):
            return False
        if self.covariances is None or other.covariances is None:
            return self.covariances is other.covariances
        return np.array_equal(self.covariances, other.covariances, equal_nan=True)

    __hash__ = None  # type: ignore[assignment]

    def __len__(self) -> int:
        return int(self.stamps.size)

    def __iter__(self) -> Iterator[Pose]:
        return iter(self.poses)

    @overload
    def __getitem__(self, i: int) -> Pose: ...
    @overload
    def __getitem__(self, i: slice) -> "Trajectory": ...
    def __getitem__(self, i: int | slice) -> "Pose | Trajectory":
        """Return pose i, or the trajectory of a slice."""
        if not isinstance(i, slice):
            pose: Pose = self.poses[i]
            return pose
        covariances = None if self.covariances is None else self.covariances[i]
        return Trajectory(stamps=self.stamps[i], poses=self.poses[i], covariances=covariances)

    def __repr__(self) -> str:
        if not len(self):
            return "Trajectory(no pose)"
        steps = np.diff(self.poses[np.isfinite(self.poses).all(axis=1), :2], axis=0)
        covariances = "" if self.covariances is None else ", with covariances"
        return (
            f"Trajectory({counted(len(self), 'pose')} over {float(np.ptp(self.stamps)):,.1f} s, "
            f"{float(np.hypot(*steps.T).sum()):,.1f} m{covariances})"
        )

    def to_array(self) -> Floats:
        """Return (n, 4) float64: stamp, x, y, theta a row; seconds, metres, metres, radians."""
        return np.column_stack([self.stamps, self.poses])

    def to_matrices(self) -> Floats:
        """Return each pose as a homogeneous matrix that takes points of the sensor to the frame, (n, 3, 3)."""
        x, y, theta = self.poses.T
        matrices = np.zeros((len(self), 3, 3))
        matrices[:, 0, 0] = matrices[:, 1, 1] = np.cos(theta)
        matrices[:, 1, 0] = np.sin(theta)
        matrices[:, 0, 1] = -matrices[:, 1, 0]
        matrices[:, 0, 2], matrices[:, 1, 2], matrices[:, 2, 2] = x, y, 1.0
        return matrices

    def write(
        self,
        path: str | os.PathLike[str],
        *,
        format: TrajectoryFormat | None = None,  # noqa: A002
    ) -> None:
        """Write the trajectory to a file, atomically.

        Parameters
        ----------
        path : str or path-like
            The file, replaced if it exists.
        format : {"tum", "csv", "kitti"} or None
            TUM text, CSV with covariances, or KITTI's 3x4 matrices, which have no stamps; None to go by the ending of
            `path`: .tum or .txt, .csv, .kitti.

        Raises
        ------
        InvalidArgumentError
            When the format is unknown, or none is given and the ending is of no format.
        OutputError
            When the file cannot be written.
        """
        write_poses(path, self, format=format)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> "Trajectory":
        """Return the trajectory in a file.

        Parameters
        ----------
        path : str or path-like
            TUM text, CSV (as :meth:`write` makes it, or any with columns stamp, x, y, theta), KITTI's matrices (stamps
            are then 0, 1, 2, ...), or the results folder of a run; recognized by content. The poses in a log are its
            ``odometry``; :func:`curvescan.read_poses` takes files of both kinds.

        Raises
        ------
        LogFileError
            When the file cannot be opened.
        LogFormatError
            When it holds no poses, or is of no such format.
        """
        return cls(**read_rows(path)._asdict())


def read_tum(path: str | os.PathLike[str]) -> Trajectory:
    """Return the trajectory of a TUM file whose motion is in the plane.

    Blank lines and lines that start with ``#`` are skipped. z is dropped; the angle is the yaw of the quaternion, which
    need not be normalised.

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
        When a line does not hold 8 numbers, a quaternion is zero or tilts by more than 5 deg out of the plane, or there
        is no line.
    """
    return Trajectory(**rows_of(path, TUM)._asdict())


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
    rows, outcomes = csv_rows(path)
    return Trajectory(**rows._asdict()), outcomes
