"""read_results: a results folder of `curvescan odometry`, `slam` or `localize`, or a map file, as the page shows it."""

import csv
import json
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from curvescan import se2
from curvescan.errors import LogFileError, LogFormatError
from curvescan.io.trajectories.layouts import csv_rows
from curvescan.live.live_map import picture_of, status_of
from curvescan.mapping.map_server import read_map
from curvescan.mapping.occupancy import OccupancyGrid
from curvescan.odometry import StepOutcome
from curvescan.runs.graph_files import beams_of, read_view_file
from curvescan.runs.results import RUN_RECORD
from curvescan.slam import SlamMap, load_map
from curvescan.slam.loops.closures import ClosureOutcome
from curvescan.slam.pose_graph.graph import EdgeKind
from curvescan.types import Cov, Floats, Ints, Pose

_SENTENCES = {o.name.lower(): o.value for o in StepOutcome}
_ACCEPTED = (ClosureOutcome.ACCEPTED.name.lower(), ClosureOutcome.AGREED.name.lower())
_BEAMS = {"ranges": np.uint16, "layout": np.int32, "angles": np.float32, "n_angles": np.int32}  # of all scans
_COLUMNS = ("keyframe_i", "keyframe_j", "kind", "outcome", "meaning", "score", "confidence", "squared_mahalanobis")
_FOLLOWED = 0.5  # the optimum follows an edge of more weight
_UNFOLLOWED = ("left_out", "It was accepted; the optimum leaves it out, as other edges contradict it.")
_CARRIED = ("in_the_map", "It has no record: added by hand, of an earlier session, or of keyframes that have gone.")
_DROPPED = ("dropped", "It was accepted, and is no longer in the map.")


class TriedClosure(NamedTuple):
    """A row of closures.csv."""

    # numbers of its keyframes
    i: int
    j: int
    is_loop: bool  # or a match of neighbours along the path
    outcome: str
    meaning: str
    values: list[float]  # score, confidence and squared Mahalanobis distance; NaN where there is none


@dataclass(frozen=True, kw_only=True)
class FinishedRun:
    """A finished run."""

    tree: Mapping[str, Any]  # what the page shows, to be packed
    slam_map: SlamMap | None  # its map, if it is one of SLAM
    numbers: Ints  # (k,): number of each keyframe in the records of closures
    scan_of: Mapping[int, int]  # scan of a keyframe by its number
    closures: Sequence[TriedClosure]


def read_results(path: Path) -> FinishedRun:
    """Return a results folder, or a map file or the folder of one, as the page shows it."""
    if not (path / "trajectory.csv").is_file():
        alone = path if path.is_file() else path / "map.csmap"
        if alone.is_file():
            return _of_map(alone)
        raise LogFileError(f"{path} is no results folder: it has neither trajectory.csv nor map.csmap")
    record = _record(path)
    rows, outcomes = csv_rows(path / "trajectory.csv")
    seen = read_view_file(path)
    slam_map = load_map(path / "map.csmap") if (path / "map.csmap").is_file() else None
    grid = slam_map.occupancy() if slam_map is not None else None
    if grid is None and (path / "map.yaml").is_file():
        grid = read_map(path / "map.yaml")
    numbers = seen.get("keyframe_numbers", np.arange(0 if slam_map is None else len(slam_map))).astype(np.int64)
    scan_of = dict(seen["keyframe_scans"].astype(np.int64).tolist()) if "keyframe_scans" in seen else {}
    closures = _closures(path / "closures.csv")
    kinds, given = sorted(set(outcomes)), record.get("input")
    tree = {
        "name": str((given.get("name") if isinstance(given, Mapping) else None) or path.name),
        "mode": "SLAM" if slam_map is not None else "localization" if "first_fix" in record else "odometry",
        "verdict": record.get("verdict"),
        "outcome": np.array([kinds.index(one) for one in outcomes], dtype=np.uint8),
        "outcomes": [[*status_of(one), _SENTENCES.get(one, one)] for one in kinds],
        "contradicted": seen.get("contradicted", ()),
        **_track(rows.stamps - rows.stamps[:1], rows.poses, rows.covariances, grid, seen),
    }
    if slam_map is not None:
        tree |= describe_map(slam_map, closures, numbers, scan_of, rows.poses)
    return FinishedRun(tree=tree, slam_map=slam_map, numbers=numbers, scan_of=scan_of, closures=closures)


def _of_map(path: Path) -> FinishedRun:
    """Return a map file as a run whose scans are its keyframes."""
    slam_map = load_map(path)
    stamps, numbers = np.array([scan.stamp for scan in slam_map.scans]), np.arange(len(slam_map))
    seen = beams_of(slam_map.scans)
    tree = {
        "name": path.name,
        "mode": "map",
        "verdict": None,
        "outcome": np.zeros(len(slam_map), dtype=np.uint8),
        "outcomes": [[*status_of("matched"), "A keyframe of the map."]],
        **_track(stamps - stamps.min(initial=np.inf), slam_map.poses, slam_map.covariances, slam_map.occupancy(), seen),
        **describe_map(slam_map, [], numbers, {}, slam_map.poses),
    }
    return FinishedRun(tree=tree, slam_map=slam_map, numbers=numbers, scan_of={}, closures=())


def _track(
    stamps: Floats, poses: Pose, covariances: Cov | None, grid: OccupancyGrid | None, seen: Mapping[str, Any]
) -> dict[str, Any]:
    """Return what the page shows of the scans and under them."""
    return {
        "stamps": stamps,
        "poses": poses.astype(np.float32),
        "covariances": _four(covariances, len(poses)),
        "odometry": _aligned(seen.get("odometry"), poses),
        "wheels": _aligned(seen.get("wheels"), poses),
        "map": _picture(grid),
        "ranges": None,
        **{name: seen[name].astype(kind) for name, kind in _BEAMS.items() if "ranges" in seen},
    }


def revised_tree(run: FinishedRun, mended: SlamMap) -> dict[str, Any]:
    """Return what changes on the page when its map is mended: each scan moves along with the keyframe before it."""
    assert run.slam_map is not None
    path, n = np.asarray(run.tree["poses"], dtype=np.float64), len(run.tree["poses"])
    is_newest = run.slam_map.sessions == run.slam_map.n_sessions - 1
    rows = np.arange(n)
    if run.tree["mode"] != "map":
        newest = np.flatnonzero(is_newest)
        at = np.searchsorted(run.slam_map.indices[newest], np.arange(n), side="right") - 1
        rows = newest[np.maximum(at, 0)]
    moved = se2.compose(mended.poses[rows], se2.between(run.slam_map.poses[rows], path))
    return {
        "poses": moved.astype(np.float32),
        "map": _picture(mended.occupancy()),
        **describe_map(mended, run.closures, run.numbers, run.scan_of, moved),
    }


def describe_map(
    slam_map: SlamMap, closures: Sequence[TriedClosure], numbers: Ints, scan_of: Mapping[int, int], path: Pose
) -> dict[str, Any]:
    """Return keyframes, and each closure that was tried or that the map holds, with its outcome and its place.

    numbers (k,); scan_of: scan of a keyframe by its number; path (n, 3) poses of the scans.
    """
    row_of = {int(number): row for row, number in enumerate(numbers.tolist())}
    is_closure = slam_map.kinds >= EdgeKind.CLOSURE
    weight_of = {
        tuple(e): w for e, w in zip(slam_map.ends[is_closure].tolist(), slam_map.weights[is_closure], strict=True)
    }

    def place(number: int) -> tuple[float, float]:
        row, scan = row_of.get(number, -1), scan_of.get(number, -1)
        poses, k = (slam_map.poses, row) if row >= 0 else (path, scan)
        return (float(poses[k, 0]), float(poses[k, 1])) if 0 <= k < len(poses) else (np.nan, np.nan)

    found: list[tuple[int, int, tuple[str, str], list[float]]] = []
    for i, j, is_loop, name, text, values in closures:
        # neighbours along the path are matched too; they close no loop
        of_neighbours = "" if is_loop else " (neighbours)"
        weight = weight_of.pop((row_of.get(i, -1), row_of.get(j, -1)), None)
        if name in _ACCEPTED and weight is None and i in row_of and j in row_of:
            name, text = _DROPPED
        elif name in _ACCEPTED and weight is not None and weight <= _FOLLOWED:
            name, text = _UNFOLLOWED
        found.append((i, j, (name + of_neighbours, text), values))
    for (a, b), weight in weight_of.items():
        what = _CARRIED if weight > _FOLLOWED else _UNFOLLOWED
        found.append((int(numbers[a]), int(numbers[b]), what, [np.nan] * 3))
    counts = Counter(what for _, _, what, _ in found)
    kinds = list(counts)
    rows = [(row_of.get(i, -1), row_of.get(j, -1)) for i, j, *_ in found]
    return {
        "keyframes": slam_map.poses.astype(np.float32),
        "keyframe_covariances": _four(slam_map.covariances, len(slam_map)),
        "closures": {
            "rows": np.array(rows, dtype=np.int32).reshape(-1, 2),
            "places": np.array([place(n) for i, j, *_ in found for n in (i, j)], dtype=np.float32).ravel(),
            "figures": np.array([values for *_, values in found], dtype=np.float32).ravel(),
            "kind": np.array([kinds.index(what) for _, _, what, _ in found], dtype=np.uint8),
            "kinds": [
                [name, text, name.split(" ")[0] in (*_ACCEPTED, _CARRIED[0]), n] for (name, text), n in counts.items()
            ],
        },
    }


def _picture(grid: OccupancyGrid | None) -> dict[str, Any] | None:
    """Return the picture of an occupancy map, for the page; None where it has no cell."""
    picture = None if grid is None else picture_of(grid, 0)
    if picture is None:
        return None
    return {"png": picture.png, "origin": picture.origin, "resolution": picture.resolution, "shape": picture.shape}


def _aligned(poses: Floats | None, path: Pose) -> Floats | None:
    """Return other poses of the same scans moved so that the first known one lies on the path."""
    if poses is None:
        return None
    n = min(len(poses), len(path))
    both = np.flatnonzero(np.isfinite(poses[:n, 0]) & np.isfinite(path[:n, 0]))
    if not both.size:
        return None
    return se2.compose(se2.compose(path[both[0]], se2.inverse(poses[both[0]])), poses[:n]).astype(np.float32)


def _four(covariances: Cov | None, n: int) -> Floats:
    """Return (n, 4) xx, xy, yy, tt of covariances; NaN without."""
    if covariances is None:
        return np.full((n, 4), np.nan, dtype=np.float32)
    return covariances[:, [0, 0, 1, 2], [0, 1, 1, 2]].astype(np.float32)


def _closures(path: Path) -> list[TriedClosure]:
    if not path.is_file():
        return []
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return [_closure(row) for row in csv.DictReader(file)]
    except (ValueError, csv.Error) as error:
        raise LogFormatError(f"{path} is damaged: {error}") from error


def _closure(row: Mapping[str, str]) -> TriedClosure:
    if missing := [name for name in _COLUMNS if row.get(name) is None]:
        raise ValueError(f"a row has no {missing[0]}")
    i, j, kind, outcome, meaning, *figures = (row[name] for name in _COLUMNS)
    values = [float(figure or "nan") for figure in figures]
    return TriedClosure(int(i), int(j), kind == "loop closure", outcome, meaning, values)


def _record(folder: Path) -> dict[str, Any]:
    path = folder / RUN_RECORD
    try:
        record = json.loads(path.read_text("utf-8")) if path.is_file() else {}
    except ValueError as error:
        raise LogFormatError(f"{path} is damaged: {error}") from error
    return record if isinstance(record, dict) else {}
