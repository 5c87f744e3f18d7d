"""Points of a map as PLY or PCD, binary, for Open3D, CloudCompare and PCL: x, y, z as float32, z zero."""

from __future__ import annotations

import os

import numpy as np

from curvescan.io.files.output import output_file
from curvescan.types import Points

_PLY = (
    "ply\nformat binary_little_endian 1.0\nelement vertex {n}\n"
    "property float x\nproperty float y\nproperty float z\nend_header\n"
)
_PCD = (
    "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\nFIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n"
    "WIDTH {n}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {n}\nDATA binary\n"
)


def write_ply(path: str | os.PathLike[str], points: Points) -> None:
    """Write (n, 2) points, metres, as PLY. Raises OutputError."""
    _write(path, _PLY, points)


def write_pcd(path: str | os.PathLike[str], points: Points) -> None:
    """Write (n, 2) points, metres, as PCD. Raises OutputError."""
    _write(path, _PCD, points)


def _write(path: str | os.PathLike[str], header: str, points: Points) -> None:
    rows = np.zeros((len(points), 3), dtype="<f4")
    rows[:, :2] = points
    with output_file(path) as new:
        new.write_bytes(header.format(n=len(rows)).encode("ascii") + rows.tobytes())
