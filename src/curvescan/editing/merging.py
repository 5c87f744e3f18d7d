"""merged: two maps joined by matches without a guess between their keyframes, or refused."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from curvescan import se2
from curvescan.editing.edits import NOISE, solved
from curvescan.editing.operations import part_of
from curvescan.errors import InvalidArgumentError
from curvescan.mapping.grid_editing import moved
from curvescan.mapping.occupancy import OccupancyGrid
from curvescan.matchers import DEFAULT_METHOD, find_matcher
from curvescan.odometry.measurement import as_measurement
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.localization.grid_map import map_of_grid
from curvescan.slam.map import SlamMap
from curvescan.slam.pose_graph.graph import EdgeKind
from curvescan.types import Bools, Cov, Floats, Ints, Pose

_N_ALIKE, _MOST_VIEWS = 3, 200
"""Keyframes of one map that each one of the other is matched with, and how many of the other at most."""

_AGREES_M, _AGREES_RAD = 0.5, 0.1
"""Two matches agree when they put the one map in the other within this: maps bend by as much over tens of metres."""

_LEAST, _MARGIN = 5, 3
"""Keyframes whose matches must agree, and how many times as many as on another place, which lies twice as far off."""


def merged(one: SlamMap, other: SlamMap) -> SlamMap:
    """Return two maps as one, in the frame of the first.

    Raises InvalidArgumentError where too few matches agree on how they lie to each other.
    """
    pairs, measured, covariances, confidence = _matches(one, other)
    # where each match puts the other map
    places = se2.compose(se2.compose(one.poses[pairs[:, 0]], measured), se2.inverse(other.poses[pairs[:, 1]]))
    chosen = _agreed(places, pairs[:, 1], confidence)
    near = [int(_is_same(places[k], places[chosen]).sum()) for k in np.flatnonzero(chosen).tolist()]
    placed = replace(other, poses=se2.compose(places[chosen][int(np.argmax(near))], other.poses))
    while True:
        both = _joined(one, placed, pairs[chosen], measured[chosen], covariances[chosen])
        # where maps bend, farther matches agree once nearer ones have joined them
        agrees = chosen | _is_same(measured, se2.between(both.poses[pairs[:, 0]], both.poses[pairs[:, 1] + len(one)]))
        if (agrees == chosen).all():
            return both
        chosen = agrees


def _joined(one: SlamMap, other: SlamMap, pairs: Ints, measured: Pose, covariances: Cov) -> SlamMap:
    """Return two maps in one frame with closures between them, optimized."""
    names = "poses", "indices", "measured", "edge_covariances", "kinds", "weights"
    alike: dict[str, Any] = {name: np.concatenate([getattr(one, name), getattr(other, name)]) for name in names}
    both = replace(
        one,
        scans=one.scans + other.scans,
        sessions=np.concatenate([one.sessions, other.sessions + one.n_sessions]),
        ends=np.concatenate([one.ends, other.ends + len(one)]),
        **alike,
    )
    graph = both.graph()
    for (i, j), pose, covariance in zip(pairs.tolist(), measured, covariances, strict=True):
        graph.add_edge(i, j + len(one), pose, covariance, EdgeKind.CLOSURE)
    return solved(both, graph)


def in_one_frame(one: SlamMap, other: SlamMap) -> tuple[SlamMap, SlamMap]:
    """Return two maps in the frame of the first, bent to lie on each other as :func:`merged` has them."""
    both = merged(one, other)
    rows = np.arange(len(both))
    return part_of(both, rows[: len(one)]), part_of(both, rows[len(one) :])


def laid_on(one: OccupancyGrid, other: OccupancyGrid) -> OccupancyGrid:
    """Return a plain map in the frame of another, by matches of what a laser would see in them."""
    seen, other_seen = (map_of_grid(grid) for grid in (one, other))
    first = merged(seen, other_seen).poses[len(seen)]
    return moved(other, se2.compose(first, se2.inverse(other_seen.poses[0])))


def _matches(one: SlamMap, other: SlamMap) -> tuple[Ints, Pose, Cov, Floats]:
    """Return (k, 2) keyframes of both maps that match without a guess, poses, covariances, and (k,) confidences."""
    known = Keyframes(find_matcher(DEFAULT_METHOD))
    known.add_all(one)
    pairs, poses, covariances, confidence = [], [], [], []
    for j in np.unique(np.linspace(0, len(other) - 1, min(_MOST_VIEWS, len(other))).astype(int)).tolist():
        current = known.prepare(other.scans[j])
        for i in known.index.most_similar(known.signature(current), _N_ALIKE).tolist():
            result = known.match(i, current, None)
            if result.ok and result.degenerate_direction is None:
                pairs.append((i, j))
                poses.append(result.pose)
                covariances.append(NOISE.edge(as_measurement(result).covariance))
                confidence.append(result.confidence)
    ends = np.array(pairs, dtype=np.int64).reshape(-1, 2)
    return ends, np.reshape(poses, (-1, 3)), np.reshape(covariances, (-1, 3, 3)), np.array(confidence)


def _agreed(places: Pose, views: Ints, confidence: Floats) -> Bools:
    """Return (k,) which matches agree on where they put a map (k, 3), or refuse; a view counts by its surest one."""
    near = np.array([_is_same(place, places) for place in places], dtype=np.bool_).reshape(len(places), len(places))
    right = np.where(near, confidence, 0.0)
    support = sum((right[:, views == view].max(axis=1) for view in np.unique(views)), np.zeros(len(places)))
    best = places[np.argmax(support)] if len(places) else np.zeros(3)
    most, rival = support.max(initial=0), support[~_is_same(best, places, 2.0)].max(initial=0)
    if most < _LEAST or most < _MARGIN * rival:
        raise InvalidArgumentError(
            f"nothing joins the two maps: {most:.3g} keyframes match without a guess and agree on how they lie, "
            f"{rival:.3g} on another place; {_LEAST} are needed, and {_MARGIN} times as many as on any other"
        )
    return _is_same(best, places)


def _is_same(one: Pose, other: Pose, times: float = 1.0) -> Bools:
    """Return (n,) whether two poses are the same but for what maps bend, or so many times as much."""
    off = se2.between(one, other)
    return np.asarray((np.hypot(off[:, 0], off[:, 1]) < times * _AGREES_M) & (np.abs(off[:, 2]) < times * _AGREES_RAD))
