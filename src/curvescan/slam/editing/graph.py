"""MapGraph: the graph of a saved map, changed edge by edge and optimized anew."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from curvescan.slam.config import GATE, SlamConfig
from curvescan.slam.jobs import Problem, covariances_seen_from, least_weights
from curvescan.slam.map import SlamMap
from curvescan.slam.pose_graph.components import anchors_of, components
from curvescan.slam.pose_graph.graph import EdgeKind
from curvescan.slam.pose_graph.optimization import Edges
from curvescan.slam.pose_graph.robust import optimize_robustly
from curvescan.types import Bools, Cov, Floats, Ints, Pose

_FROM_AFAR = 0.05
"""Convexity to begin with: every edge is reconsidered."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MapGraph:
    """The pose graph of a :class:`curvescan.SlamMap`: poses, edges, and which edges keep their weight.

    Attributes
    ----------
    poses : (n, 3) float64
        Of the keyframes.
    ends, measured, covariances, kinds, weights
        Of the edges.
    is_trusted : (m,) bool
        Whether an edge was put in by hand.
    """

    poses: Pose
    ends: Ints
    measured: Pose
    covariances: Cov
    kinds: Ints
    weights: Floats
    is_trusted: Bools

    @classmethod
    def of(cls, slam_map: SlamMap) -> Self:
        """Return the graph of a map."""
        return cls(
            poses=slam_map.poses,
            ends=slam_map.ends,
            measured=slam_map.measured,
            covariances=slam_map.edge_covariances,
            kinds=slam_map.kinds,
            weights=slam_map.weights,
            is_trusted=np.zeros(len(slam_map.ends), dtype=np.bool_),
        )

    def with_edge(self, i: int, j: int, pose: Pose, covariance: Cov) -> MapGraph:
        """Return the graph with a closure more, which keeps its weight."""
        return replace(
            self,
            ends=np.vstack([self.ends, [i, j]]),
            measured=np.vstack([self.measured, pose]),
            covariances=np.concatenate([self.covariances, covariance[np.newaxis]]),
            kinds=np.append(self.kinds, EdgeKind.CLOSURE),
            weights=np.append(self.weights, 1.0),
            is_trusted=np.append(self.is_trusted, True),
        )

    def without(self, gone: Bools) -> MapGraph:
        """Return the graph without some edges.

        gone (m,).
        """
        rows = np.flatnonzero(~gone)
        names = ("ends", "measured", "covariances", "kinds", "weights", "is_trusted")
        return replace(self, **{name: getattr(self, name)[rows] for name in names})


def solved(slam_map: SlamMap, graph: MapGraph, config: SlamConfig) -> SlamMap:
    """Return a map with another graph, optimized to the end, every closure reconsidered.

    A false closure may have cost the right ones their weight: of two optima, one begun with the weights of the map and
    one with all edges in full, the better one is taken.
    """
    edges = Edges.of(graph.ends, graph.measured, graph.covariances)
    optima = [
        optimize_robustly(
            graph.poses,
            edges,
            np.where(graph.is_trusted, 1.0, least_weights(graph.kinds)),
            anchors_of(components(graph.ends, len(graph.poses))),
            limit=GATE,
            weights=weights,
            least_convexity=_FROM_AFAR,
        )
        for weights in (graph.weights, None)
    ]
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
    return replace(new, covariances=map_covariances(new, config))


def map_covariances(slam_map: SlamMap, config: SlamConfig) -> Cov:
    """Return (n, 3, 3) covariance of each keyframe of a map, the first one known exactly."""
    problem = Problem(
        poses=slam_map.poses, ends=slam_map.ends, measured=slam_map.measured, covariances=slam_map.edge_covariances,
        kinds=slam_map.kinds, weights=slam_map.weights, current=0,
    )  # fmt: skip
    return covariances_seen_from(problem, config.noise)
