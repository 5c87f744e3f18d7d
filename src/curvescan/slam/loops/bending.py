"""Bending: whether the closed map asks more of the odometry than it may err by.

Closures that are true leave the odometry's steps nearly as they were: it errs now and then by much, and else by centimetres. False ones,
which agree with each other because rooms are alike, shorten or fold way after way. The motion model's edges, wide and never given up,
measure it: their mean squared Mahalanobis distance, the worst hundredth left out, was 0.001 on Intel, 0.01 on ACES, and 0.37 to 1.3 on folded maps.
"""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan.slam.config import ClosuresConfig
from curvescan.slam.loops.closures import Closure, ClosureOutcome
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph
from curvescan.slam.pose_graph.optimization import Edges, squared_distances
from curvescan.types import Floats, Ints, Pose

_STEP_M, _STEP_RAD = 0.3, 0.3
"""What a step may be bent by, metres and radians."""

_N_LEAST = 100
"""Steps over which the mean is taken at the least."""

_SLIP_SHARE = 0.01
"""Share of the steps that may err by any amount: where the odometry slipped and a closure put it right."""


def is_bent(graph: PoseGraph, rules: ClosuresConfig) -> bool:
    """Return whether the closures of a graph bend the odometry more than it can err."""
    rows = np.flatnonzero(graph.is_step)
    room = 1.0 + np.square(graph.measured[rows]).sum(axis=1)
    wide = graph.covariances[rows] + room[:, np.newaxis, np.newaxis] * np.diag(np.square([_STEP_M, _STEP_M, _STEP_RAD]))
    edges = Edges.of(graph.ends[rows], graph.measured[rows], wide)
    kinds = graph.kinds[rows]
    if bending(graph.poses, edges) > rules.max_bend:
        return True
    return greatest_turn(graph.poses, edges, kinds) > rules.max_turn


def bending(poses: Pose, edges: Edges) -> float:
    """Return how far the poses leave the steps of the motion model: mean squared Mahalanobis distance, worst slips left out.

    poses (n, 3).
    """
    distances: Floats = squared_distances(poses, edges)
    n = len(distances)
    n_slips = min(n, max(2, round(_SLIP_SHARE * n)))
    return float(np.sort(distances)[: n - n_slips].sum()) / max(n, _N_LEAST)


def greatest_turn(poses: Pose, edges: Edges, kinds: Ints) -> float:
    """Return by how much the poses turn a step of the odometry that matches measured, the worst one, radians.

    Closures put slips along a corridor right by metres, but hardly ever a turn: 0.06 rad at the most on Intel and
    ACES. A map that is folded turns one step by a quarter or a half.

    poses (n, 3).
    """
    rows = np.flatnonzero(kinds == EdgeKind.MATCH)
    i, j = edges.ends[rows].T
    turns = se2.wrap(poses[j, 2] - poses[i, 2] - edges.measured[rows, 2])
    return float(np.abs(turns).max(initial=0.0))


def suspects(closures: list[Closure], n_linked: int, *, all_of_them: bool) -> set[int]:
    """Return the rows of closures that are to blame when the map is bent."""
    rows: set[int] = set()
    has_begun = all_of_them
    for row, closure in enumerate(closures):
        has_begun = has_begun or closure.outcome is ClosureOutcome.AGREED
        if has_begun and closure.is_accepted and closure.j - closure.i > n_linked:
            rows.add(row)
    return rows
