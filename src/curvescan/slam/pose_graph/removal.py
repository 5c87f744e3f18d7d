"""Removal of a pose from a graph: what its edges measured is carried over to those that stay.

The exact marginal ties all neighbours to each other. Kept of it are the steps of the chain, composed, and the closures,
moved to the heir: a pose of the same place that the removed one is tied to. After Eade, Fong and Munich, "Monocular
graph SLAM with complexity reduction", IROS 2010.
"""

from __future__ import annotations

import numpy as np

from curvescan.se2.uncertain import UncertainPose, compose, inverse
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph, is_whole
from curvescan.types import Ints

_LEAST_WEIGHT = 0.5
"""Edges that the optimum follows less than this are not carried over."""


def heir_of(graph: PoseGraph, v: int, among: Ints) -> int | None:
    """Return which of some poses a closure or match ties best to pose v; None if there is none."""
    row = _best_tie(graph, v, set(among.tolist()))
    return None if row is None else _other_end(graph, row, v)


def _best_tie(graph: PoseGraph, v: int, among: set[int]) -> int | None:
    """Return the edge that ties pose v best to one of some poses."""
    rows = [row for row in _edges_at(graph, v) if _other_end(graph, row, v) in among and _is_match(graph, row)]
    return min(rows, key=lambda row: float(np.trace(graph.covariances[row])), default=None)


def carry_over(graph: PoseGraph, v: int, heir: int) -> UncertainPose:
    """Carry the edges of pose v over to the poses that stay, take them out, and return v seen from its heir."""
    rows = _edges_at(graph, v)
    seen = {row: _seen_from(graph, row, v) for row in rows}
    to_heir = _best_tie(graph, v, {heir})
    assert to_heir is not None
    from_heir = inverse(seen[to_heir])
    steps = [row for row in rows if graph.kinds[row] != EdgeKind.CLOSURE]
    before = [row for row in steps if _other_end(graph, row, v) < v]
    after = [row for row in steps if _other_end(graph, row, v) > v]
    if before and after:
        a, b = before[-1], after[0]
        step = compose(inverse(seen[a]), seen[b])
        kind = EdgeKind(max(graph.kinds[a], graph.kinds[b]))
        weight = float(min(graph.weights[a], graph.weights[b]))
        graph.add_edge(_other_end(graph, a, v), _other_end(graph, b, v), step.pose, step.cov, kind, weight)
    tied = {_other_end(graph, row, heir) for row in _edges_at(graph, heir)}
    for row in rows:
        u = _other_end(graph, row, v)
        is_closure = graph.kinds[row] == EdgeKind.CLOSURE and graph.weights[row] > _LEAST_WEIGHT
        if is_closure and u != heir and u not in tied:
            tied.add(u)
            first, last = min(heir, u), max(heir, u)
            moved = compose(from_heir, seen[row])
            moved = moved if first == heir else inverse(moved)
            graph.add_edge(first, last, moved.pose, moved.cov, EdgeKind.CLOSURE)
    is_kept = np.ones(graph.n_edges, dtype=np.bool_)
    is_kept[rows] = False
    graph.keep_edges(is_kept)
    return from_heir


def _edges_at(graph: PoseGraph, v: int) -> list[int]:
    found: list[int] = np.flatnonzero((graph.ends == v).any(axis=1)).tolist()
    return found


def _other_end(graph: PoseGraph, row: int, v: int) -> int:
    i, j = graph.ends[row].tolist()
    return int(j if i == v else i)


def _is_match(graph: PoseGraph, row: int) -> bool:
    is_match = graph.kinds[row] in (EdgeKind.CLOSURE, EdgeKind.MATCH)
    # by an edge that leaves a direction open no pose can hang on an heir
    return bool(is_match and is_whole(graph.covariances[row]) and graph.weights[row] > _LEAST_WEIGHT)


def _seen_from(graph: PoseGraph, row: int, v: int) -> UncertainPose:
    """Return the other end of an edge seen from pose v."""
    edge = UncertainPose(graph.measured[row].copy(), graph.covariances[row].copy())
    return edge if graph.ends[row, 0] == v else inverse(edge)
