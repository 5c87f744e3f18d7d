"""Names for the arrays and the two records that travel between rooms.

The aliases carry meaning for the reader; shapes stand in the docstrings and are checked once, where
data enters the library.
"""

from __future__ import annotations

import importlib
import os
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Literal, TypeAlias, overload

import numpy as np
from numpy.typing import NDArray

from curvescan.errors import InvalidArgumentError

if TYPE_CHECKING:
    from collections.abc import Iterator

Floats: TypeAlias = NDArray[np.float64]
"""Any float64 array; the docstring gives its shape."""

Ints: TypeAlias = NDArray[np.int64]
"""Any int64 array, mostly indices."""

Bools: TypeAlias = NDArray[np.bool_]
"""A mask."""

Codes: TypeAlias = NDArray[np.uint8]
"""Values of an IntEnum, one a reading."""

Points: TypeAlias = NDArray[np.float64]
"""(n, 2) Cartesian points [x, y], metres; NaN rows are readings without a return."""

Pose: TypeAlias = NDArray[np.float64]
"""(..., 3) poses [x, y, theta]: metres, metres, radians in (-pi, pi]."""

Cov: TypeAlias = NDArray[np.float64]
"""(..., 3, 3) covariances of a pose, in the order x, y, theta: m^2, m rad, rad^2."""


TrajectoryFormat: TypeAlias = Literal["tum", "csv", "kitti"]
"""Formats in which a trajectory is written and read."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PoseEdge:
    """A measured pose of one scan in another: an edge of a pose graph.

    Attributes
    ----------
    i, j : int
        Numbers of the scans, from 0.
    pose : (3,) float64
        [x, y, theta] of scan j seen from scan i.
    covariance : (3, 3) float64
        Of the pose, x, y, theta in the frame of scan i.
    """

    i: int
    j: int
    pose: Pose
    covariance: Cov

    def __repr__(self) -> str:
        x, y, theta = self.pose
        return f"PoseEdge({self.i} -> {self.j}: x={x:.4f} m, y={y:.4f} m, theta={theta:.4f} rad)"


@dataclass(frozen=True, kw_only=True)
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
                "a trajectory has stamps of shape (n,) and poses of shape (n, 3), "
                f"got {stamps.shape} and {poses.shape}"
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

    def __len__(self) -> int:
        return int(self.stamps.size)

    def __iter__(self) -> Iterator[Pose]:
        return iter(self.poses)

    @overload
    def __getitem__(self, i: int) -> Pose: ...
    @overload
    def __getitem__(self, i: slice) -> Trajectory: ...
    def __getitem__(self, i: int | slice) -> Pose | Trajectory:
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
            f"Trajectory({len(self):,} poses over {float(np.ptp(self.stamps)):,.1f} s, "
            f"{float(np.hypot(*steps.T).sum()):,.1f} m{covariances})"
        )

    def to_array(self) -> Floats:
        """Return (n, 4) float64: stamp, x, y, theta a row; seconds, metres, metres, radians."""
        return np.column_stack([self.stamps, self.poses])

    def to_matrices(self) -> Floats:
        """Return (n, 3, 3) float64: each pose as a homogeneous matrix, which takes points of the sensor to the frame."""
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
        _files().write_trajectory(path, self, format=format)

    @classmethod
    def read(cls, path: str | os.PathLike[str]) -> Trajectory:
        """Return the trajectory in a file.

        Parameters
        ----------
        path : str or path-like
            TUM text, CSV (as :meth:`write` makes it, or any with columns stamp, x, y, theta), KITTI's matrices (stamps
            are then 0, 1, 2, ...), a log with poses, or the results folder of a run; recognized by content.

        Raises
        ------
        LogFileError
            When the file cannot be opened.
        LogFormatError
            When it holds no poses, or is of no such format.
        """
        trajectory: Trajectory = _files().read_trajectory(path)
        return trajectory


def _files() -> Any:
    # readers and writers stand above the types: imported when they are used
    return importlib.import_module("curvescan.io.trajectories.files")
