"""Type names of the arrays and pose-graph edges that several folders use; docstrings give the shapes."""

import math
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from curvescan.errors import require

_Record = TypeVar("_Record")

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

    def __repr__(self) -> str:
        x, y, theta = self.pose
        return f"PoseEdge({self.i} -> {self.j}: x={x:.4f} m, y={y:.4f} m, theta={theta:.4f} rad)"


class UncertainPose(NamedTuple):
    """Pose of a frame b in a frame a, and how well it is known.

    Attributes
    ----------
    pose : (3,) float64
        [x, y, theta]; metres, metres, radians in (-pi, pi].
    covariance : (3, 3) float64
        Its covariance in the order x, y, theta, in frame a; zero where b is known exactly.
    """

    pose: Pose
    covariance: Cov

    def __repr__(self) -> str:
        x, y, theta = (float(value) for value in self.pose)
        sx, sy, st = np.sqrt(np.abs(np.diag(self.covariance))).tolist()
        return f"UncertainPose(x={x:.4f}±{sx:.4f} m, y={y:.4f}±{sy:.4f} m, theta={theta:.4f}±{st:.4f} rad)"


def with_fields(record: _Record, **fields: object) -> _Record:
    """Return a dataclass with other fields, not checked again; :func:`dataclasses.replace` takes ten times as long."""
    made = object.__new__(type(record))
    made.__dict__.update(record.__dict__, **fields)
    return made


def three_numbers(value: ArrayLike, rule: str) -> Floats:
    """Return three finite numbers, (3,), an array as it is; raise InvalidArgumentError with the rule and the value."""
    numbers: Floats = np.empty(0)
    try:
        given = np.asarray(value)
        if given.dtype.kind not in "SU":  # text is no number
            numbers = np.asarray(given, dtype=np.float64)
    except (TypeError, ValueError):
        pass
    # plain numbers: three of them take NumPy ten times as long
    require(numbers.shape == (3,) and all(map(math.isfinite, numbers.tolist())), rule, value)
    return numbers
