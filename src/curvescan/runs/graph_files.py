"""Files of a run beside poses and maps: the graph, its loop-closure candidates, and view.npz for `curvescan view`."""

import csv
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from curvescan import se2
from curvescan.io.arrays.npz_file import NpzFile
from curvescan.io.log import Log
from curvescan.odometry import Step, StepOutcome
from curvescan.scan import LaserScan
from curvescan.slam import ClosureOutcome, Slam
from curvescan.slam.loops.closures import Closure
from curvescan.slam.pose_graph.graph import EdgeKind
from curvescan.types import Cov, Pose, PoseEdge

CLOSURE_HEADER = (
    "scan", "keyframe_i", "keyframe_j", "score", "confidence", "squared_mahalanobis",
    "x", "y", "theta", "kind", "outcome", "meaning",
)  # fmt: skip


def write_closures(path: Path, closures: Sequence[Closure]) -> None:
    """Write one row for each candidate of a loop closure and each match of neighbours: scan, pose, outcome, reason."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(CLOSURE_HEADER)
        for c in closures:
            numbers = [c.score, c.confidence, c.distance, *c.pose.tolist()]
            kind = "loop closure" if c.is_loop else "neighbours"
            words = [kind, c.outcome.name.lower(), c.outcome.value]
            writer.writerow([c.scan, c.i, c.j, *numbers, *words])


def describe_graph(slam: Slam, seconds_to_finish: float) -> dict[str, object]:
    """Return what run.json holds of the graph."""
    graph = slam.graph
    outcomes = Counter(c.outcome for c in slam.closures)
    n_closures, n_neighbours = slam.count_matches()
    return {
        "keyframes": graph.n_poses,
        "loop_closures": n_closures,
        "matches_of_neighbours": n_neighbours,
        "edges": {
            kind.name.lower(): int(np.count_nonzero(graph.kinds == kind))
            for kind in EdgeKind
            if kind < EdgeKind.CLOSURE
        },
        "closures_without_weight": int(np.count_nonzero(graph.is_closure & (graph.weights < 0.5))),
        "candidates": {outcome.name.lower(): outcomes[outcome] for outcome in ClosureOutcome},
        "fragments": slam.n_fragments,
        "seconds_to_finish": round(seconds_to_finish, 3),
    }


GUESS_SIGMAS = (0.1, 0.1, 0.1)  # standard deviations of a motion that no match measured: metres, metres, radians a step


def edges_of(steps: Iterable[Step]) -> list[PoseEdge]:
    """Return the edges of an odometry, one a step by its match; by the expected motion where the match failed."""
    edges: list[PoseEdge] = []

    def join(i: int, step: Step, pose: Pose, covariance: Cov) -> None:
        edges.append(PoseEdge(i=i, j=step.index, pose=pose, covariance=covariance))

    last: Pose | None = None
    for step in steps:
        if step.is_matched and step.match is not None and step.reference is not None:
            join(step.reference, step, step.match.pose, step.match.covariance)
        elif step.outcome is StepOutcome.LOST:
            join(step.index - 1, step, step.motion, step.motion_covariance)
        elif last is not None:
            join(step.index - 1, step, se2.between(last, step.pose_odom), np.diag(np.square(GUESS_SIGMAS)))
        last = step.pose_odom
    return edges


VIEW_FILE = "view.npz"
MAX_BEAMS = 240  # beams of a scan that are kept at most: every second or third of one that has more
_CENTIMETRES = 100.0
_FARTHEST = 65_000  # longest range that is kept, centimetres; 0 is no reading


def write_view_file(folder: Path, log: Log, n_scans: int, **known: NDArray[Any]) -> None:
    """Write view.npz into a results folder.

    known: odometry (n, 3); keyframe_numbers (k,): number of each keyframe of the map; keyframe_scans (m, 2): number and
    scan of each keyframe that there ever was; contradicted (c, 2): places where matches contradict the map.
    """
    arrays: dict[str, Any] = beams_of(islice(log, n_scans)) | known
    if log.odometry is not None:
        arrays["wheels"] = log.odometry.poses[:n_scans]
    for name in {"odometry", "wheels", "contradicted"} & arrays.keys():
        arrays[name] = arrays[name].astype(np.float32)
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
