"""Robust optimization: which edges are consistent with each other, by graduated non-convexity.

Yang, Antonante, Tzoumas and Carlone, "Graduated non-convexity for robust spatial perception", RA-L 2020, with truncated
least squares (GNC-TLS): an edge counts in full up to a squared Mahalanobis distance and not at all beyond, and the
cost becomes so by steps from a convex one. An edge that lost its weight may win it back at any step.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from curvescan.slam.config import ANYWHERE_M, GATE
from curvescan.slam.pose_graph.cholesky import Elimination
from curvescan.slam.pose_graph.graph import PoseGraph, components
from curvescan.slam.pose_graph.optimization import Edges, optimize, squared_distances
from curvescan.types import Floats, Pose

_STEP = 2.0
"""Factor of the convexity from a step to the next; 1.4 in the paper."""

_STEEPEST = 20.0
"""Convexity at which weights are 0 or 1 but for a twentieth of the limit."""


class RobustOptimum(NamedTuple):
    """Where robust least squares ended."""

    poses: Pose  # (n, 3)
    weights: Floats  # (m,): of each edge in [0, 1]; near 0 or 1 at the end
    costs: Floats  # (m,): squared Mahalanobis distance of each edge, up to its limit


def optimized(graph: PoseGraph, *, weights: Floats | None, least_convexity: float = 0.0) -> RobustOptimum:
    """Return the poses that most edges of a graph agree on, and which edges do; the first of each component stays.

    A closure beyond the gate may be a false match. A step that slipped may lead anywhere, which is as much less likely
    as it is narrow: else one step takes all of what a long way errs by.

    weights (m,): to begin with; None for all edges in full.
    """
    edges, least = Edges.of(graph.ends, graph.measured, graph.edge_covariances), graph.least_weights
    spread = graph.edge_covariances[:, :2, :2]
    anywhere = np.linalg.det(spread + ANYWHERE_M**2 * np.eye(2)) / np.linalg.det(spread)
    limits = GATE + np.where(graph.is_closure, 0.0, np.log(anywhere))
    weights = np.ones(len(edges.ends)) if weights is None else np.maximum(weights, least)
    elimination = Elimination.of(edges.ends, graph.n_poses)
    poses = _optimum(graph.poses, edges, weights, elimination)
    distances = squared_distances(poses, edges)
    worst = (distances / limits).max(initial=0.0)
    convexity = max(1.0 / max(2.0 * worst - 1.0, 1e-12), least_convexity)
    while worst > 1.0 and convexity < _STEEPEST:
        new = np.maximum(tls_weights(distances, limits, convexity), least)
        if np.all((new == least) | (new == 1.0)) and np.array_equal(new, weights):
            break
        weights = new
        poses = _optimum(poses, edges, weights, elimination)
        distances = squared_distances(poses, edges)
        convexity *= _STEP
    return RobustOptimum(poses=poses, weights=weights, costs=np.minimum(distances, limits))


def tls_weights(distances: Floats, limit: Floats | float, convexity: float) -> Floats:
    """Return (m,) weights in [0, 1] by squared Mahalanobis distances (Yang et al. 2020, eq. 14)."""
    inner, outer = convexity / (convexity + 1.0) * limit, (convexity + 1.0) / convexity * limit
    with np.errstate(divide="ignore"):
        middle = np.sqrt(limit * convexity * (convexity + 1.0) / distances) - convexity
    return np.where(distances <= inner, 1.0, np.where(distances >= outer, 0.0, middle))


def _optimum(poses: Pose, edges: Edges, weights: Floats, elimination: Elimination) -> Pose:
    used = np.flatnonzero(weights > 0.0)  # what does not count leaves the pattern
    # the first of each component: a session that hangs on closures alone may come loose
    anchors = np.unique(components(edges.ends[used], len(poses)), return_index=True)[1]
    return optimize(poses, edges.chosen(used), weights[used], anchors, elimination)
