"""view.npz: what `curvescan view` shows of a run and no other file of its folder holds.

The poses by the odometry alone and by the wheels, the scans to the centimetre, and which scan each keyframe is.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from curvescan.io.arrays.npz_file import NpzFile
from curvescan.io.log import Log
from curvescan.scan import LaserScan
from curvescan.types import Ints, Pose

VIEW_FILE = "view.npz"

MAX_BEAMS = 240  # beams of a scan that are kept at most: every second or third of one that has more

_CENTIMETRES = 100.0
_FARTHEST = 65_000  # longest range that is kept, centimetres; 0 is no reading


def write_view_file(
    folder: Path,
    log: Log,
    n_scans: int,
    *,
    odometry: Pose | None = None,
    keyframe_numbers: Ints | None = None,
    keyframe_scans: Ints | None = None,
) -> None:
    """Write view.npz into a results folder.

    odometry (n, 3); keyframe_numbers (k,): number of each keyframe of the map; keyframe_scans (m, 2): number and scan
    of each keyframe that there ever was.
    """
    arrays: dict[str, Any] = beams_of(islice(log, n_scans))
    if odometry is not None:
        arrays["odometry"] = odometry.astype(np.float32)
    if log.odometry is not None:
        arrays["wheels"] = log.odometry.poses[:n_scans].astype(np.float32)
    if keyframe_numbers is not None:
        arrays["keyframe_numbers"] = keyframe_numbers
    if keyframe_scans is not None:
        arrays["keyframe_scans"] = keyframe_scans
    np.savez_compressed(folder / VIEW_FILE, **arrays)


def beams_of(scans: Iterable[LaserScan]) -> dict[str, Any]:
    """Return scans to the centimetre: ranges, beams of each scan, its layout, and the layouts' angles."""
    rows: list[NDArray[np.uint16]] = []
    layouts: dict[bytes, int] = {}
    angles: list[NDArray[np.float32]] = []
    layout_of: list[int] = []
    for scan in scans:
        step = -(-len(scan) // MAX_BEAMS) or 1
        seen = np.where(scan.valid, scan.ranges, 0.0)[::step] * _CENTIMETRES
        rows.append(np.rint(seen.clip(0, _FARTHEST)).astype(np.uint16))
        one = scan.angles[::step].astype(np.float32)
        key = one.tobytes()
        if key not in layouts:
            layouts[key] = len(angles)
            angles.append(one)
        layout_of.append(layouts[key])
    return {
        "ranges": np.concatenate([np.empty(0, np.uint16), *rows]),
        "layout": np.array(layout_of, dtype=np.uint32),
        "angles": np.concatenate([np.empty(0, np.float32), *angles]),
        "n_angles": np.array([len(one) for one in angles], dtype=np.uint32),
    }


def read_view_file(folder: Path) -> Mapping[str, Any]:
    """Return the arrays of view.npz; none where a folder has no such file."""
    path = folder / VIEW_FILE
    if not path.is_file():
        return {}
    file = NpzFile(path)
    return {name: file.read(name) for name in file.headers}
