"""Files of SLAM beside poses and maps: the graph, its loop-closure candidates, the figures of both."""

from __future__ import annotations

import csv
from collections import Counter
from collections.abc import Iterable, Sequence
from pathlib import Path

import numpy as np

from curvescan import se2
from curvescan.io.trajectories.g2o import write_g2o
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.odometry import Step, StepOutcome
from curvescan.slam import ClosureOutcome, Slam
from curvescan.slam.loops.closures import Closure
from curvescan.slam.map import SlamMap
from curvescan.slam.pose_graph.graph import EdgeKind
from curvescan.types import Cov, Pose, PoseEdge

CLOSURE_HEADER = (
    "scan", "keyframe_i", "keyframe_j", "score", "confidence", "squared_mahalanobis",
    "x", "y", "theta", "kind", "outcome", "meaning",
)  # fmt: skip


def save_graph(folder: Path, slam_map: SlamMap) -> None:
    """Write graph.g2o: a vertex a keyframe, and every edge that has a weight."""
    keyframes = Trajectory(stamps=np.array([scan.stamp for scan in slam_map.scans]), poses=slam_map.poses)
    write_g2o(folder / "graph.g2o", keyframes, slam_map.edges)


def write_closures(path: Path, closures: Sequence[Closure]) -> None:
    """Write the candidates for loop closures and matches of neighbours: scan, pose, outcome and reason of each."""
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
    graph = slam.backend.graph
    outcomes = Counter(c.outcome for c in slam.closures)
    n_closures, n_neighbours = slam.backend.count_matches()
    return {
        "keyframes": graph.n_poses,
        "loop_closures": n_closures,
        "matches_of_neighbours": n_neighbours,
        "edges": {
            kind.name.lower(): int(np.count_nonzero(graph.kinds == kind))
            for kind in EdgeKind
            if kind is not EdgeKind.CLOSURE
        },
        "closures_without_weight": int(np.count_nonzero(graph.is_closure & (graph.weights < 0.5))),
        "candidates": {outcome.name.lower(): outcomes[outcome] for outcome in ClosureOutcome},
        "fragments": slam.n_fragments,
        "closures_withdrawn_because_places_look_alike": slam.is_deceived,
        "seconds_to_finish": round(seconds_to_finish, 3),
    }


GUESS_SIGMAS = (0.1, 0.1, 0.1)  # standard deviations of a motion that no match measured: metres, metres, radians a step


def edges_of(steps: Iterable[Step]) -> list[PoseEdge]:
    """Return the edges of an odometry: one a step but the first, by its match.

    A step whose match failed joins its scan with the one before by the expected motion, so that the graph does not fall
    apart.
    """
    edges: list[PoseEdge] = []

    def join(i: int, step: Step, pose: Pose, covariance: Cov) -> None:
        edges.append(PoseEdge(i=i, j=step.index, pose=pose, covariance=covariance))

    last: Pose | None = None
    for step in steps:
        if step.match is not None and step.match.ok and step.reference is not None:
            join(step.reference, step, step.match.pose, step.match.covariance)
        elif step.outcome is StepOutcome.LOST:
            join(step.index - 1, step, step.motion, step.motion_covariance)
        elif last is not None:
            join(step.index - 1, step, se2.between(last, step.pose_odom), np.diag(np.square(GUESS_SIGMAS)))
        last = step.pose_odom
    return edges
