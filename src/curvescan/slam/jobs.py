"""Optimization of a pose graph, and its covariances: what a thread beside the stream does.

The heavy parts, kernels and SuperLU, release Python's lock.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from curvescan.odometry.gaps import LOST_COVARIANCE
from curvescan.slam.config import GATE, KEPT, NoiseConfig
from curvescan.slam.map import SlamMap
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
from curvescan.types import Cov, Floats, Ints, Pose

_FROM_AFAR, _NEARBY = 0.05, 6.0
"""Convexity to begin with: where every edge is reconsidered, and where the optimum is near the one that the last job
left."""

_LEAST_STEP = 1e-4
"""Weight that a step keeps however far it is off: a slip bends the graph, and does not break it."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Problem:
    """A pose graph as it was when an optimization began; its arrays are copies."""

    poses: Pose  # (n, 3)
    # of the m edges; see PoseGraph
    ends: Ints
    measured: Pose
    covariances: Cov
    kinds: Ints
    weights: Floats
    least: Floats  # (m,): weight that each edge keeps: a closure none, a step a little
    current: int = 0  # the keyframe that scans hang on

    @classmethod
    def of(cls, graph: PoseGraph | SlamMap, current: int = 0) -> Problem:
        """Return a copy of a graph, or of that of a map."""
        copies = {name: getattr(graph, name).copy() for name in ("poses", "ends", "measured", "kinds", "weights")}
        least = np.where(graph.kinds == EdgeKind.CLOSURE, 0.0, _LEAST_STEP)
        return cls(**copies, covariances=graph.edge_covariances.copy(), least=least, current=current)

    def optimized(self, *, weights: Floats | None, least_convexity: float = _FROM_AFAR) -> RobustOptimum:
        """Return the robust optimum, begun with some weights; None for all edges in full."""
        edges = Edges.of(self.ends, self.measured, self.covariances)
        anchors = anchors_of(components(self.ends, len(self.poses)))
        return optimize_robustly(
            self.poses, edges, self.least, anchors, limit=GATE, weights=weights, least_convexity=least_convexity
        )


def solve(problem: Problem, noise: NoiseConfig, is_last: bool) -> tuple[Problem, Cov]:
    """Return the robust optimum of a pose graph, and (n, 3, 3) covariances with its current keyframe known exactly."""
    optimum = problem.optimized(weights=problem.weights, least_convexity=_FROM_AFAR if is_last else _NEARBY)
    solved = replace(problem, poses=optimum.poses, weights=optimum.weights)
    return solved, covariances_seen_from(solved, noise)


def covariances_seen_from(solved: Problem, noise: NoiseConfig) -> Cov:
    """Return (n, 3, 3) covariance of each pose with the current one known exactly; infinite in other components."""
    poses, ends, weights, k = solved.poses, solved.ends, solved.weights.copy(), solved.current
    # a step that slipped is as wide as it is off
    is_step = solved.kinds != EdgeKind.CLOSURE
    off = squared_distances(poses, Edges.of(ends, solved.measured, solved.covariances))
    weights[is_step] = np.minimum(1.0, GATE / np.maximum(off[is_step], GATE))
    is_match = (solved.kinds != EdgeKind.MOTION) & (weights > 0.5)
    covariances = solved.covariances.copy()
    covariances[is_match] = without_floor(covariances[is_match], noise.floor)
    labels = components(ends[weights > 0.0], len(poses))
    off = squared_distances(poses, Edges.of(ends, solved.measured, covariances))
    factor = variance_factor(off[is_match], len(poses) - int(labels.max()) - 1)
    by = np.where(is_match, factor, 1.0) * design_effect(ends, is_match, len(poses), 1.0 - KEPT)
    scaled = covariances * by[:, np.newaxis, np.newaxis]
    scaled[:, 2, 2] += heading_drift(ends, solved.measured, len(poses))
    anchors = anchors_of(labels)
    anchors[labels[k]] = k
    used = np.flatnonzero(weights > 0.0)
    edges = Edges.of(ends, solved.measured, scaled).chosen(used)
    found = marginal_covariances(poses, edges, weights[used], anchors)
    found[labels != labels[k]] = LOST_COVARIANCE
    # what each of both scans adds to all of its edges; of what a match leaves open it says nothing
    common = (1.0 - KEPT) / (2.0 * KEPT) * covariances
    return with_own_noise(found, poses, own_noise(poses, ends, common, is_match & is_whole(covariances)), k)
