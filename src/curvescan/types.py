"""Names for the arrays and the two records that travel between rooms.

The aliases carry meaning for the reader; shapes stand in the docstrings and are checked once, where
data enters the library.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, TypeAlias

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


@dataclass(frozen=True, kw_only=True)
class Trajectory:
    """Poses over time, one row a scan, in the order of the log.

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
