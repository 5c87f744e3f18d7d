"""Edits of a map's graph: drop a closure, add one, pin a keyframe, forbid a stretch; a small file that can be replayed.

An edit that adds holds the measured pose that was taken, so that a replay asks no matcher and gives the same bits.
"""

from __future__ import annotations

import json
import operator
import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from curvescan import se2
from curvescan.editing.operations import remapped
from curvescan.errors import InvalidArgumentError, LogFileError, LogFormatError
from curvescan.io.files.output import output_folder
from curvescan.io.trajectories.relations import write_g2o
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.mapping.map_server import write_map_files
from curvescan.mapping.occupancy import OccupancyGrid
from curvescan.matchers import MatchResult, match
from curvescan.odometry.measurement import as_measurement
from curvescan.slam.config import NoiseConfig
from curvescan.slam.map import SlamMap
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph
from curvescan.slam.pose_graph.posterior import covariances_seen_from
from curvescan.slam.pose_graph.robust import optimized

_VERSION = 1
_KINDS = ("drop", "add", "pin", "forbid")
_PINNED = np.diag([1e-6, 1e-6, 1e-6])
"""Covariance of a pinned keyframe seen from the first one: a millimetre and a milliradian."""

NOISE = NoiseConfig()
"""What the covariances of matches leave out."""


@dataclass(frozen=True, kw_only=True)
class Edit:
    """One edit: "drop" the closures between two keyframes, "add" one, "pin" a keyframe, "forbid" those of a stretch."""

    do: str
    i: int  # rows of keyframes in the map that is edited; "forbid": closures that end on one from i to j
    j: int  # i for "pin"
    # for "add" the pose of j in the frame of i; for "pin" where the keyframe stays, None for where it is
    pose: tuple[float, ...] | None = None
    covariance: tuple[float, ...] | None = None  # for "add" the nine numbers of its covariance

    def __post_init__(self) -> None:
        if self.do not in _KINDS:
            raise InvalidArgumentError(f"an edit must be one of {', '.join(_KINDS)}, got {self.do!r}")
        for name, length in (("pose", 3), ("covariance", 9)):
            values = getattr(self, name)
            if values is not None and (len(values) != length or not np.isfinite(values).all()):
                raise InvalidArgumentError(f"{name} must be {length} finite numbers, got {values!r}")
        if self.do == "add" and (self.pose is None or self.covariance is None):
            raise InvalidArgumentError('an edit that adds needs its "pose" and "covariance"')


def edited(slam_map: SlamMap, edits: Sequence[Edit]) -> SlamMap:
    """Return a map with its graph edited and optimized again; its occupancy is made anew of the keyframes.

    Raises InvalidArgumentError when an edit names what the map does not have.
    """
    if not edits:
        return slam_map
    graph = slam_map.graph()
    for edit in edits:
        _apply(graph, edit)
    return solved(slam_map, graph)


def _apply(graph: PoseGraph, edit: Edit) -> None:
    n, i, j = graph.n_poses, edit.i, edit.j
    if not (0 <= i < n and 0 <= j < n):
        raise InvalidArgumentError(f"the map has keyframes 0 to {n - 1}, got {j if 0 <= i < n else i}")
    if edit.do == "pin":
        if i == 0:
            raise InvalidArgumentError("keyframe 0 holds the frame of the map: it is pinned already")
        pose = graph.poses[i] if edit.pose is None else np.array(edit.pose)
        is_earlier = (graph.kinds == EdgeKind.BY_HAND) & (graph.ends == (0, i)).all(axis=1)
        graph.keep_edges(~is_earlier)
        graph.add_edge(0, i, se2.between(graph.poses[0], pose), _PINNED, EdgeKind.BY_HAND)
    elif edit.do == "add":
        if i == j:
            raise InvalidArgumentError(f"a closure joins two keyframes, got {i} twice")
        cov = np.reshape(edit.covariance or (), (3, 3))
        graph.add_edge(i, j, np.array(edit.pose), cov, EdgeKind.BY_HAND)
    elif edit.do == "forbid":
        is_within = (graph.ends >= min(i, j)) & (graph.ends <= max(i, j))
        graph.keep_edges((graph.kinds != EdgeKind.CLOSURE) | ~is_within.any(axis=1))
    else:
        is_gone = graph.is_closure & (np.sort(graph.ends, axis=1) == sorted((i, j))).all(axis=1)
        if not is_gone.any():
            raise InvalidArgumentError(f"there is no closure between keyframes {i} and {j}: `curvescan view` shows all")
        graph.keep_edges(~is_gone)


def solved(slam_map: SlamMap, graph: PoseGraph) -> SlamMap:
    """Return a map with another graph, optimized to the end, every closure reconsidered.

    A false closure may have taken the weight of right ones. So the graph is optimized twice, once from the weights of
    the map and once from full weights, and the better optimum is kept.
    """
    optima = [optimized(graph, weights=weights) for weights in (graph.weights, None)]
    optimum = min(optima, key=lambda found: found.costs.sum())
    graph.poses[:], graph.weights[:] = optimum.poses, optimum.weights
    covariances = covariances_seen_from(graph, 0, NOISE)
    return remapped(slam_map, covariances=covariances, **graph.arrays())


def ask_match(slam_map: SlamMap, i: int, j: int) -> tuple[MatchResult, Edit | None]:
    """Return the match of keyframe j with i without a guess, and the edit that adds it; None where it fails."""
    if not (0 <= i < len(slam_map) and 0 <= j < len(slam_map)) or i == j:
        raise InvalidArgumentError(f"a match takes two keyframes of 0 to {len(slam_map) - 1}, got {i} and {j}")
    result = match(slam_map.scans[i], slam_map.scans[j])
    if not result.ok:
        return result, None
    pose, covariance = result.pose.tolist(), NOISE.edge(as_measurement(result).covariance).ravel().tolist()
    return result, Edit(do="add", i=i, j=j, pose=tuple(pose), covariance=tuple(covariance))


def added(slam_map: SlamMap, i: int, j: int) -> Edit:
    """Return the edit that adds a closure as the matcher finds it. Raises InvalidArgumentError where it finds none."""
    result, edit = ask_match(slam_map, i, j)
    if edit is None:
        raise InvalidArgumentError(f"keyframes {i} and {j} cannot be joined: {result.outcome.value}")
    return edit


def edit_of(values: Mapping[str, Any]) -> Edit:
    """Return an edit from plain values, as the file and the page give them. Raises InvalidArgumentError."""
    unknown = values.keys() - Edit.__dataclass_fields__.keys()
    if unknown:
        raise InvalidArgumentError(f"an edit has no {', '.join(sorted(map(str, unknown)))}")
    try:
        i, j = operator.index(values["i"]), operator.index(values.get("j", values["i"]))
        numbers = {k: tuple(float(v) for v in values[k]) for k in ("pose", "covariance") if values.get(k) is not None}
        return Edit(do=str(values["do"]), i=i, j=j, **numbers)
    except (KeyError, TypeError, ValueError, OverflowError) as error:
        raise InvalidArgumentError(f"an edit has do, i, j, and for add pose and covariance: {error}") from error


def plain_edit(edit: Edit) -> dict[str, Any]:
    """Return an edit as plain values."""
    return {key: value for key, value in vars(edit).items() if value is not None}


def edits_text(edits: Sequence[Edit]) -> str:
    """Return the text of a file of edits."""
    return json.dumps({"curvescan_edits": _VERSION, "edits": [plain_edit(edit) for edit in edits]}, indent=1) + "\n"


def read_edits(path: str | os.PathLike[str]) -> tuple[Edit, ...]:
    """Read a file of edits. Raises LogFileError, LogFormatError."""
    try:
        content = json.loads(Path(path).read_text("utf-8"))
        if not isinstance(content, dict) or content.get("curvescan_edits") != _VERSION:
            raise InvalidArgumentError(f"it must say curvescan_edits: {_VERSION}")
        return tuple(edit_of(values) for values in content["edits"])
    except OSError as error:
        raise LogFileError(f"cannot read {os.fspath(path)!r}: {error.strerror or error}") from error
    except (ValueError, KeyError, AttributeError, TypeError, RecursionError) as error:
        raise LogFormatError(f"{path} is no file of edits, such as `curvescan view` saves: {error}") from error


@contextmanager
def map_folder(
    out: str | os.PathLike[str], given: SlamMap | OccupancyGrid, *, inputs: Sequence[str | os.PathLike[str]] = ()
) -> Iterator[Path]:
    """Write map.pgm with map.yaml into a folder, of keyframes map.csmap and graph.g2o too; yield it for what else."""
    with output_folder(out, inputs=inputs) as folder:
        grid = given.occupancy() if isinstance(given, SlamMap) else given
        if isinstance(given, SlamMap):
            replace(given, grid=grid).save(folder / "map.csmap")
            write_g2o(folder / "graph.g2o", keyframe_trajectory(given), given.edges)
        if grid.log_odds.size:
            write_map_files(folder, grid)
        yield folder


def save_map_folder(out: str | os.PathLike[str], slam_map: SlamMap, edits: Sequence[Edit]) -> tuple[str, ...]:
    """Write a map into a folder with its edits, and return the names of the files."""
    with map_folder(out, slam_map) as folder:
        (folder / "edits.json").write_text(edits_text(edits), encoding="utf-8", newline="\n")
        return tuple(sorted(file.name for file in folder.iterdir()))


def keyframe_trajectory(slam_map: SlamMap) -> Trajectory:
    """Return the keyframes of a map as a trajectory."""
    stamps = np.array([scan.stamp for scan in slam_map.scans])
    return Trajectory(stamps=stamps, poses=slam_map.poses, covariances=slam_map.covariances)
