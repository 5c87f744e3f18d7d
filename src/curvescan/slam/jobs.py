"""Optimization: of a graph that grows in a thread beside the stream, its result taken a fixed number of scans later.

The number of scans, not the clock, says when: the same input gives the same bits, however fast the machine is. The
heavy parts, kernels and SuperLU, release Python's lock.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from curvescan.slam.config import GATE, NoiseConfig
from curvescan.slam.loops.belief import UNKNOWN
from curvescan.slam.map import SlamMap
from curvescan.slam.pose_graph.components import anchors_of, components
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph
from curvescan.slam.pose_graph.marginals import marginal_covariances
from curvescan.slam.pose_graph.optimization import Edges, normal_equations, squared_distances
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

_OPEN = 1.0
"""Variance of a match from which on it leaves a direction open, square metres."""

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
    def of(cls, graph: PoseGraph, current: int) -> Problem:
        """Return a copy of a graph."""
        return cls(
            poses=graph.poses.copy(),
            ends=graph.ends.copy(),
            measured=graph.measured.copy(),
            covariances=graph.covariances.copy(),
            kinds=graph.kinds.copy(),
            weights=graph.weights.copy(),
            least=np.where(graph.is_closure, 0.0, _LEAST_STEP),
            current=current,
        )

    @classmethod
    def of_map(cls, slam_map: SlamMap) -> Problem:
        """Return the graph of a map."""
        return cls(
            poses=slam_map.poses,
            ends=slam_map.ends,
            measured=slam_map.measured,
            covariances=slam_map.edge_covariances,
            kinds=slam_map.kinds,
            weights=slam_map.weights,
            least=np.where(slam_map.kinds == EdgeKind.CLOSURE, 0.0, _LEAST_STEP),
        )

    def optimized(self, *, weights: Floats | None, least_convexity: float = _FROM_AFAR) -> RobustOptimum:
        """Return the robust optimum, begun with some weights; None for all edges in full."""
        edges = Edges.of(self.ends, self.measured, self.covariances)
        anchors = anchors_of(components(self.ends, len(self.poses)))
        return optimize_robustly(
            self.poses, edges, self.least, anchors, limit=GATE, weights=weights, least_convexity=least_convexity
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class Solution:
    """What an optimization found."""

    poses: Pose  # (n, 3): revised
    weights: Floats  # (m,): revised
    covariances: Cov  # (n, 3, 3): of each pose with the current keyframe known exactly
    current: int


def solve(problem: Problem, noise: NoiseConfig, is_last: bool) -> Solution:
    """Return the robust optimum of a pose graph and its covariances."""
    optimum = problem.optimized(weights=problem.weights, least_convexity=_FROM_AFAR if is_last else _NEARBY)
    solved = replace(problem, poses=optimum.poses, weights=optimum.weights)
    return Solution(
        poses=solved.poses,
        weights=solved.weights,
        covariances=covariances_seen_from(solved, noise),
        current=problem.current,
    )


def covariances_seen_from(solved: Problem, noise: NoiseConfig) -> Cov:
    """Return (n, 3, 3) covariance of each pose with the current one known exactly; infinite in other components."""
    poses, weights, k = solved.poses, solved.weights.copy(), solved.current
    # a step that slipped is as wide as it is off
    is_step = solved.kinds != EdgeKind.CLOSURE
    off = squared_distances(poses, Edges.of(solved.ends, solved.measured, solved.covariances))
    weights[is_step] = np.minimum(1.0, GATE / np.maximum(off[is_step], GATE))
    is_match = (solved.kinds != EdgeKind.MOTION) & (weights > 0.5)
    covariances = solved.covariances.copy()
    covariances[is_match] = without_floor(covariances[is_match], noise.floor)
    edges = Edges.of(solved.ends, solved.measured, covariances)
    labels = components(solved.ends[weights > 0.0], len(poses))
    factor = variance_factor(squared_distances(poses, edges)[is_match], len(poses) - int(labels.max()) - 1)
    # steps that matches did not measure leave small residuals, and are not the surer for it
    by = np.where(is_match, max(factor, 1.0), 1.0)
    by *= design_effect(solved.ends, is_match, len(poses), 1.0 - noise.kept)
    scaled = covariances * by[:, np.newaxis, np.newaxis]
    scaled[:, 2, 2] += heading_drift(solved.ends, solved.measured, len(poses))
    found = _marginals(poses, Edges.of(solved.ends, solved.measured, scaled), weights, labels, k)
    common = noise.common(covariances)
    # of what a match leaves open it says nothing
    is_full = is_match & (np.trace(covariances[:, :2, :2], axis1=1, axis2=2) < _OPEN)
    return with_own_noise(found, poses, own_noise(poses, solved.ends, common, is_full), k)


def _marginals(poses: Pose, edges: Edges, weights: Floats, labels: Ints, k: int) -> Cov:
    """Return (n, 3, 3) marginal covariances with pose k known exactly."""
    used = np.flatnonzero(weights > 0.0)
    edges, weights = edges.chosen(used), weights[used]
    anchors = anchors_of(labels)
    anchors[labels[k]] = k
    information, _, _ = normal_equations(poses, edges, weights, anchors)
    found = marginal_covariances(information, anchors)
    found[labels != labels[k]] = UNKNOWN
    return found
