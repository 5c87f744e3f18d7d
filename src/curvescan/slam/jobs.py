"""Optimization beside the stream: it runs in a thread, and its result is taken a fixed number of scans later.

The number of scans, not the clock, says when: the same input gives the same bits, however fast the machine is. The heavy parts, kernels
and SuperLU, release Python's lock.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from curvescan.slam.loops.belief import UNKNOWN
from curvescan.slam.pose_graph.components import anchors_of, components
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph
from curvescan.slam.pose_graph.marginals import marginal_covariances
from curvescan.slam.pose_graph.optimization import Edges, normal_equations
from curvescan.slam.pose_graph.robust import optimize_robustly
from curvescan.slam.pose_graph.sparse import block_pattern
from curvescan.types import Bools, Cov, Floats, Ints, Pose

_FROM_AFAR, _NEARBY = 0.05, 6.0
"""Convexity to begin with: where every edge is reconsidered, and where the optimum is near the one that the last job left."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem:
    """A pose graph as it was when an optimization began; its arrays are copies.

    Attributes
    ----------
    poses : (n, 3) float64
        Poses.
    ends, measured, covariances, kinds, weights
        Of the edges; see PoseGraph.
    current : int
        The keyframe that scans hang on.
    """

    poses: Pose
    ends: Ints
    measured: Pose
    covariances: Cov
    kinds: Ints
    weights: Floats
    current: int

    @classmethod
    def of(cls, graph: PoseGraph, current: int) -> Problem:
        """Return a copy of a graph."""
        return cls(
            poses=graph.poses.copy(),
            ends=graph.ends.copy(),
            measured=graph.measured.copy(),
            covariances=graph.covariances.copy(),
            kinds=graph.kinds.copy(),
            weights=graph.weights.copy(),
            current=current,
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Solution:
    """What an optimization found.

    Attributes
    ----------
    poses : (n, 3) float64
        Revised poses.
    weights : (m,) float64
        Revised weights of the edges.
    distances : (m,) float64
        Squared Mahalanobis distance of each edge.
    covariances : (n, 3, 3) float64
        Covariance of each pose with the current keyframe known exactly.
    current : int
        That keyframe.
    """

    poses: Pose
    weights: Floats
    distances: Floats
    covariances: Cov
    current: int


class Job:
    """An optimization under way."""

    def __init__(self, problem: Problem, limit: float, pool: ThreadPoolExecutor, *, is_last: bool = False) -> None:
        self._future: Future[Solution] = pool.submit(solve, problem, limit, is_last)

    def result(self) -> Solution:
        """Return the solution, when it is there."""
        return self._future.result()


def solve(problem: Problem, limit: float, is_last: bool) -> Solution:
    """Return the robust optimum of a pose graph and its covariances."""
    graph_edges = Edges.of(problem.ends, problem.measured, problem.covariances)
    anchors = anchors_of(components(problem.ends, len(problem.poses)))
    optimum = optimize_robustly(
        problem.poses,
        graph_edges,
        trusted_edges(problem.kinds),
        anchors,
        limit=limit,
        from_chordal=False,
        weights=problem.weights,
        least_convexity=_FROM_AFAR if is_last else _NEARBY,
    )
    return Solution(
        poses=optimum.poses,
        weights=optimum.weights,
        distances=optimum.distances,
        covariances=covariances_seen_from(optimum.poses, graph_edges, optimum.weights, problem.current),
        current=problem.current,
    )


def covariances_seen_from(poses: Pose, edges: Edges, weights: Floats, k: int) -> Cov:
    """Return (n, 3, 3) covariance of each pose with pose k known exactly; infinite in other components."""
    used = np.flatnonzero(weights > 0.0)
    edges, weights = edges.chosen(used), weights[used]
    labels = components(edges.ends, len(poses))
    anchors = anchors_of(labels)
    anchors[labels[k]] = k
    pattern = block_pattern(len(poses), edges.ends, 3)
    data, _, _ = normal_equations(poses, edges, weights, anchors, pattern)
    found = marginal_covariances(pattern, data, anchors)
    found[labels != labels[k]] = UNKNOWN
    return found


def trusted_edges(kinds: Ints) -> Bools:
    """Return which edges keep their weight: those of the motion model, which hold the graph together."""
    return np.asarray(kinds == EdgeKind.MOTION)
