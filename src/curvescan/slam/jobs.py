"""Optimization of a pose graph: what a thread beside the stream does.

The heavy parts, kernels and SuperLU, release Python's lock.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from curvescan.slam.config import ANYWHERE_M, GATE, NoiseConfig
from curvescan.slam.pose_graph.graph import PoseGraph
from curvescan.slam.pose_graph.optimization import Edges
from curvescan.slam.pose_graph.posterior import covariances_seen_from
from curvescan.slam.pose_graph.robust import RobustOptimum, optimize_robustly
from curvescan.types import Cov, Floats

_NEARBY = 6.0
"""Convexity to begin with where the optimum is near that of the last job; else every edge is reconsidered."""


class Solution(NamedTuple):
    """A pose graph solved, and what it then knows of the keyframe that scans hang on."""

    graph: PoseGraph
    current: int
    covariances: Cov  # (n, 3, 3): of each keyframe, with the current one known exactly


def solve(graph: PoseGraph, current: int, noise: NoiseConfig, is_last: bool) -> Solution:
    """Move a pose graph, a copy of the caller's, to its robust optimum, and return it with what it knows there."""
    optimum = optimized(graph, weights=graph.weights, least_convexity=0.0 if is_last else _NEARBY)
    graph.poses[:], graph.weights[:] = optimum.poses, optimum.weights
    return Solution(graph, current, covariances_seen_from(graph, current, noise))


def optimized(graph: PoseGraph, *, weights: Floats | None, least_convexity: float = 0.0) -> RobustOptimum:
    """Return the robust optimum of a graph, begun with some weights; None for all edges in full.

    A closure beyond the gate may be a false match. A step that slipped may lead anywhere, which is as much less likely
    as it is narrow: else one step takes all of what a long way errs by.
    """
    edges = Edges.of(graph.ends, graph.measured, graph.edge_covariances)
    spread = graph.edge_covariances[:, :2, :2]
    anywhere = np.linalg.det(spread + ANYWHERE_M**2 * np.eye(2)) / np.linalg.det(spread)
    limits = GATE + np.where(graph.is_closure, 0.0, np.log(anywhere))
    return optimize_robustly(
        graph.poses, edges, graph.least_weights, limits, weights=weights, least_convexity=least_convexity
    )
