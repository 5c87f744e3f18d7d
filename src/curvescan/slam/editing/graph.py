"""The graph of a saved map, changed edge by edge and optimized anew."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from curvescan.slam.config import GATE, SlamConfig
from curvescan.slam.jobs import Problem, covariances_seen_from
from curvescan.slam.map import SlamMap
from curvescan.slam.pose_graph.graph import EdgeKind
from curvescan.types import Bools, Cov, Pose


def with_edge(graph: Problem, i: int, j: int, pose: Pose, covariance: Cov) -> Problem:
    """Return a graph with a closure more, put in by hand, which keeps its weight."""
    return replace(
        graph,
        ends=np.vstack([graph.ends, [i, j]]),
        measured=np.vstack([graph.measured, pose]),
        covariances=np.concatenate([graph.covariances, covariance[np.newaxis]]),
        kinds=np.append(graph.kinds, EdgeKind.CLOSURE),
        weights=np.append(graph.weights, 1.0),
        least=np.append(graph.least, 1.0),
    )


def without(graph: Problem, gone: Bools) -> Problem:
    """Return a graph without some edges, gone (m,)."""
    names = ("ends", "measured", "covariances", "kinds", "weights", "least")
    return replace(graph, **{name: getattr(graph, name)[~gone] for name in names})


def solved(slam_map: SlamMap, graph: Problem, config: SlamConfig) -> SlamMap:
    """Return a map with another graph, optimized to the end, every closure reconsidered.

    A false closure may have cost the right ones their weight: of two optima, one begun with the weights of the map and
    one with all edges in full, the better one is taken.
    """
    optima = [graph.optimized(weights=weights) for weights in (graph.weights, None)]
    optimum = min(optima, key=lambda found: float(np.minimum(found.distances, GATE).sum()))
    new = replace(
        slam_map,
        poses=optimum.poses,
        ends=graph.ends,
        measured=graph.measured,
        edge_covariances=graph.covariances,
        kinds=graph.kinds,
        weights=optimum.weights,
        grid=None,
    )
    return replace(new, covariances=covariances_seen_from(Problem.of(new), config.noise))
