"""Map files (.csmap): a zip archive of NumPy arrays, as numpy.savez_compressed writes it, with a version.

docs/maps.md lists the arrays. A reader refuses what is damaged or of a later version in one sentence; arrays that it
does not know are left aside, so that a later version may add some.
"""

from __future__ import annotations

import os
from typing import TYPE_CHECKING, Any

import numpy as np

from curvescan.errors import InvalidArgumentError, LogFileError, LogFormatError
from curvescan.io.arrays.npz_file import NpzFile
from curvescan.io.files.lines import as_path
from curvescan.io.files.output import output_file
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.occupancy import MAX_BYTES, OccupancyGrid
from curvescan.scan import LaserScan
from curvescan.slam.pose_graph.graph import EdgeKind
from curvescan.types import Floats

if TYPE_CHECKING:
    from curvescan.slam.map import SlamMap

VERSION = 1
"""Of the format that is written; files of this version and of those before it are read."""

_UPPER = np.triu_indices(3)
_WHOLE = np.array([[0, 1, 2], [1, 3, 4], [2, 4, 5]])  # the elements of a symmetric matrix among those of its upper half
_GRID = (
    "resolution", "hit", "miss", "lowest", "highest", "occupied_from", "free_to", "clear_no_return",
)  # fmt: skip
_OF_KEYFRAMES = {
    "poses": (3,), "covariances": (6,), "indices": (), "sessions": (), "stamps": (), "n_beams": (), "setups": (5,),
}  # fmt: skip
_OF_EDGES = {"edge_ends": (2,), "edge_poses": (3,), "edge_covariances": (6,), "edge_kinds": (), "edge_weights": ()}
"""The shape of a row of each array that has one a keyframe, or one an edge."""

_REQUIRED = (*_OF_KEYFRAMES, *_OF_EDGES, "csmap_version", "ranges", "angles")
_OPTIONAL = ("grid_log_odds", "grid_origin", "grid_config", "noise_doubled_at")


def write_map_file(path: str | os.PathLike[str], slam_map: SlamMap) -> None:
    """Write a map in one step; see :meth:`curvescan.SlamMap.save`."""
    scans = slam_map.scans
    uneven = [s for s in scans if not s.has_uniform_angles]
    arrays: dict[str, Any] = {
        "csmap_version": np.array([VERSION], dtype=np.int64),
        "poses": slam_map.poses,
        "covariances": slam_map.covariances[:, _UPPER[0], _UPPER[1]],
        "indices": slam_map.indices,
        "sessions": slam_map.sessions,
        "stamps": np.array([s.stamp for s in scans]),
        "n_beams": np.array([len(s) for s in scans], dtype=np.int64),
        "setups": np.array(
            [(s.angle_min, s.angle_increment, s.range_min, s.range_max, not s.has_uniform_angles) for s in scans],
            dtype=np.float64,
        ).reshape(-1, *_OF_KEYFRAMES["setups"]),
        "noise_doubled_at": np.array([s.noise_doubled_at for s in scans]),
        "ranges": np.concatenate([s.ranges for s in scans] or [np.empty(0)]).astype(np.float32),
        "angles": np.concatenate([s.angles for s in uneven] or [np.empty(0)]),
        "edge_ends": slam_map.ends,
        "edge_poses": slam_map.measured,
        "edge_covariances": slam_map.edge_covariances[:, _UPPER[0], _UPPER[1]],
        "edge_kinds": slam_map.kinds,
        "edge_weights": slam_map.weights,
    }
    if (grid := slam_map.grid) is not None:
        arrays["grid_log_odds"] = grid.log_odds
        arrays["grid_origin"] = grid.origin
        arrays["grid_config"] = np.array([float(getattr(grid.config, name)) for name in _GRID])
    with output_file(path) as new, new.open("wb") as file:
        np.savez_compressed(file, **arrays)


def read_map_file(path: str | os.PathLike[str]) -> dict[str, Any]:
    """Return what a map file holds, by the names of the fields of a SlamMap; see :func:`curvescan.load_map`."""
    path = as_path(path, "a map")
    if not path.is_file():
        what = (
            "is a folder: give the map.csmap or map.yaml in it" if path.is_dir() else "does not exist: check the path"
        )
        raise LogFileError(f"map {path} {what}")
    with path.open("rb") as opened:
        is_zip = opened.read(2) == b"PK"
    # what no scan has seen packs to nothing
    file = NpzFile(path, names=(*_REQUIRED, *_OPTIONAL), most_bytes=MAX_BYTES) if is_zip else None
    if file is None or "csmap_version" not in file.headers:
        raise LogFormatError(
            f"{path} is not a map that curvescan saved: give the map.csmap of `curvescan slam`; to localize, and for "
            "`curvescan map`, a map.yaml will do"
        )
    version = file.read("csmap_version").ravel()
    if not (version.size == 1 and 1 <= version[0] <= VERSION):
        last = f"install a later curvescan, as this one reads up to {VERSION}"
        raise LogFormatError(f"{path} is a map of version {str(version)[1:-1]}: {last}")
    if missing := [name for name in _REQUIRED if name not in file.headers]:
        raise LogFormatError(f"map {path} is damaged: {', '.join(missing)} missing")
    arrays = {name: file.read(name, np.float32 if name == "grid_log_odds" else np.float64) for name in file.headers}
    try:
        return _map_of(arrays)
    except (InvalidArgumentError, ValueError, LookupError, TypeError, OverflowError) as error:
        raise LogFormatError(f"map {path} is damaged: {error}") from error


def _map_of(arrays: dict[str, Floats]) -> dict[str, Any]:
    sizes = (len(arrays["poses"]), len(arrays["edge_ends"]))
    for n, rows in zip(sizes, (_OF_KEYFRAMES, _OF_EDGES), strict=True):
        for name, row in rows.items():
            if arrays[name].shape != (n, *row):
                raise ValueError(f"{name} must have shape {(n, *row)}, got {arrays[name].shape}")
            if name != "setups" and not np.isfinite(arrays[name]).all():
                raise ValueError(f"{name} must be finite")
    ends, edge_covariances = arrays["edge_ends"].astype(np.int64), arrays["edge_covariances"][:, _WHOLE]
    if not ((ends >= 0) & (ends < sizes[0])).all() or (ends[:, 0] == ends[:, 1]).any():
        raise ValueError("an edge joins keyframes that are not there")
    if not ((arrays["edge_weights"] >= 0.0) & (arrays["edge_weights"] <= 1.0)).all():
        raise ValueError("edge_weights must lie in [0, 1]")
    if sizes[1] and np.linalg.eigvalsh(edge_covariances)[:, 0].min() <= 0.0:
        raise ValueError("edge_covariances must be positive definite")
    # maps were saved with edges of the wheels alone, beside those of the same steps
    used = np.isin(kinds := arrays["edge_kinds"].astype(np.int64), [*EdgeKind])
    return {
        "scans": _scans_of(arrays),
        "poses": arrays["poses"],
        "covariances": arrays["covariances"][:, _WHOLE],
        "indices": arrays["indices"].astype(np.int64),
        "sessions": arrays["sessions"].astype(np.int64),
        "ends": ends[used],
        "measured": arrays["edge_poses"][used],
        "edge_covariances": edge_covariances[used],
        "kinds": kinds[used],
        "weights": arrays["edge_weights"][used],
        "grid": _grid_of(arrays),
    }


def _scans_of(arrays: dict[str, Floats]) -> tuple[LaserScan, ...]:
    n_beams = arrays["n_beams"].astype(np.int64)
    is_uneven = arrays["setups"][:, 4] != 0.0
    if (n_beams < 0).any() or n_beams.sum() != len(arrays["ranges"]):
        raise ValueError("the readings are not as many as its keyframes have beams")
    if n_beams[is_uneven].sum() != len(arrays["angles"]):
        raise ValueError("the angles are not as many as its unevenly spaced beams")
    all_ranges = np.split(arrays["ranges"], np.cumsum(n_beams))[:-1]
    all_angles = iter(np.split(arrays["angles"], np.cumsum(n_beams[is_uneven])))
    scans = []
    setups = np.column_stack((arrays["setups"], arrays.get("noise_doubled_at", np.full(len(n_beams), np.inf)))).tolist()
    for stamp, ranges, setup in zip(arrays["stamps"].tolist(), all_ranges, setups, strict=True):
        first, step, range_min, range_max, uneven, noise = setup
        angles = {"angles": next(all_angles)} if uneven else {"angle_min": first, "angle_increment": step}
        # a reading at a limit was rounded to float32
        low, high = min(range_min, float(np.float32(range_min))), max(range_max, float(np.float32(range_max)))
        scans.append(LaserScan(ranges, range_min=low, range_max=high, stamp=stamp, noise_doubled_at=noise, **angles))
    return tuple(scans)


def _grid_of(arrays: dict[str, Floats]) -> OccupancyGrid | None:
    if "grid_log_odds" not in arrays:
        return None
    values = dict(zip(_GRID, arrays["grid_config"].tolist(), strict=True))
    is_clear = bool(values.pop("clear_no_return"))
    log_odds, origin = np.asarray(arrays["grid_log_odds"], np.float32), arrays["grid_origin"]
    if log_odds.ndim != 2 or origin.shape != (2,) or not (np.isfinite(origin).all() and np.isfinite(log_odds).all()):
        raise ValueError("its occupancy grid must have rows and columns of finite numbers")
    return OccupancyGrid(log_odds=log_odds, origin=origin, config=OccupancyConfig(clear_no_return=is_clear, **values))
