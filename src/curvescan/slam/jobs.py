"""Optimization of a pose graph, and its covariances: what a thread beside the stream does.

The heavy parts, kernels and SuperLU, release Python's lock.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from curvescan.odometry.gaps import LOST_COVARIANCE
from curvescan.slam.config import GATE, KEPT, NoiseConfig
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph, anchors_of, components, is_whole
from curvescan.slam.pose_graph.optimization import Edges, marginal_covariances, squared_distances
from curvescan.slam.pose_graph.posterior import (
    design_effect,
    heading_drift,
    own_noise,
    variance_factor,
    with_own_noise,
    without_floor,
)
from curvescan.slam.pose_graph.robust import RobustOptimum, optimize_robustly
from curvescan.types import Cov, Floats

_FROM_AFAR, _NEARBY = 0.05, 6.0
"""Convexity to begin with: where every edge is reconsidered, and where the optimum is near the one that the last job
left."""


def optimized(graph: PoseGraph, *, weights: Floats | None, least_convexity: float = _FROM_AFAR) -> RobustOptimum:
    """Return the robust optimum of a graph, begun with some weights; None for all edges in full."""
    edges = Edges.of(graph.ends, graph.measured, graph.edge_covariances)
    anchors = anchors_of(components(graph.ends, graph.n_poses))
    return optimize_robustly(
        graph.poses, edges, graph.least_weights, anchors, limit=GATE, weights=weights, least_convexity=least_convexity
    )


class Solution(NamedTuple):
    """A pose graph solved, and what it then knows of the keyframe that scans hang on."""

    graph: PoseGraph
    current: int
    covariances: Cov  # (n, 3, 3): of each keyframe, with the current one known exactly


def solve(graph: PoseGraph, current: int, noise: NoiseConfig, is_last: bool) -> Solution:
    """Move a pose graph, which nobody else may use meanwhile, to its robust optimum, and return what it knows there."""
    optimum = optimized(graph, weights=graph.weights, least_convexity=_FROM_AFAR if is_last else _NEARBY)
    graph.poses[:], graph.weights[:] = optimum.poses, optimum.weights
    return Solution(graph, current, covariances_seen_from(graph, current, noise))


def covariances_seen_from(graph: PoseGraph, k: int, noise: NoiseConfig) -> Cov:
    """Return (n, 3, 3) covariance of each pose with pose k known exactly; infinite in other components."""
    poses, ends, measured, weights = graph.poses, graph.ends, graph.measured, graph.weights.copy()
    # a step that slipped is as wide as it is off
    is_step = ~graph.is_closure
    off = squared_distances(poses, Edges.of(ends, measured, graph.edge_covariances))
    weights[is_step] = np.minimum(1.0, GATE / np.maximum(off[is_step], GATE))
    is_match = (graph.kinds != EdgeKind.MOTION) & (weights > 0.5)
    covariances = graph.edge_covariances.copy()
    covariances[is_match] = without_floor(covariances[is_match], noise.floor)
    labels = components(ends[weights > 0.0], len(poses))
    off = squared_distances(poses, Edges.of(ends, measured, covariances))
    factor = variance_factor(off[is_match], len(poses) - int(labels.max()) - 1)
    by = np.where(is_match, factor, 1.0) * design_effect(ends, is_match, len(poses), 1.0 - KEPT)
    scaled = covariances * by[:, np.newaxis, np.newaxis]
    scaled[:, 2, 2] += heading_drift(ends, measured, len(poses))
    anchors = anchors_of(labels)
    anchors[labels[k]] = k
    used = np.flatnonzero(weights > 0.0)
    edges = Edges.of(ends, measured, scaled).chosen(used)
    found = marginal_covariances(poses, edges, weights[used], anchors)
    found[labels != labels[k]] = LOST_COVARIANCE
    # what each of both scans adds to all of its edges; of what a match leaves open it says nothing
    common = (1.0 - KEPT) / (2.0 * KEPT) * covariances
    return with_own_noise(found, poses, own_noise(poses, ends, common, is_match & is_whole(covariances)), k)
