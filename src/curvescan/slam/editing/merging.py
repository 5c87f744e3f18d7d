"""merged: two maps joined by matches without a guess between their keyframes, or refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from curvescan import se2
from curvescan.errors import InvalidArgumentError
from curvescan.odometry.measurement import as_measurement
from curvescan.slam.config import SlamConfig
from curvescan.slam.editing.graph import MapGraph, solved
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.loops.closures import is_confident
from curvescan.slam.map import SlamMap
from curvescan.slam.pose_graph.graph import EdgeKind
from curvescan.types import Bools, Cov, Pose

_N_ALIKE, _MOST_VIEWS = 3, 200
"""Keyframes of one map that each one of the other is matched with, and how many of the other, evenly chosen, at
most."""

_AGREES_M, _AGREES_RAD = 0.5, 0.1
"""Two matches agree when they put the one map in the other within this: maps bend by as much over tens of metres."""

_LEAST, _MARGIN = 5, 3.0
"""Keyframes whose matches must agree, and how many times as many as agree on any other place."""


def merged(one: SlamMap, other: SlamMap, config: SlamConfig | None = None) -> SlamMap:
    """Return two maps as one, in the frame of the first.

    Raises InvalidArgumentError where too few matches agree on how they lie to each other.
    """
    config = config or SlamConfig()
    pairs, measured, covariances = _matches(one, other, config)
    chosen = _agreed(one, other, pairs, measured)
    i, j = pairs[chosen, 0], pairs[chosen, 1]
    places = _places(one, other, pairs[chosen], measured[chosen])
    place = places[np.argmax([_near(places, k).sum() for k in range(len(places))])]
    n = len(one)
    graph = MapGraph(
        poses=np.concatenate([one.poses, se2.compose(place, other.poses)]),
        ends=np.concatenate([one.ends, other.ends + n, np.stack([i, j + n], axis=1)]),
        measured=np.concatenate([one.measured, other.measured, measured[chosen]]),
        covariances=np.concatenate([one.edge_covariances, other.edge_covariances, covariances[chosen]]),
        kinds=np.concatenate([one.kinds, other.kinds, np.full(len(i), EdgeKind.CLOSURE)]),
        weights=np.concatenate([one.weights, other.weights, np.ones(len(i))]),
        is_trusted=np.zeros(len(one.ends) + len(other.ends) + len(i), dtype=np.bool_),
    )
    both = replace(
        one,
        scans=one.scans + other.scans,
        poses=graph.poses,
        indices=np.concatenate([one.indices, other.indices]),
        sessions=np.concatenate([one.sessions, other.sessions + one.n_sessions]),
    )
    return solved(both, graph, config)


def _matches(one: SlamMap, other: SlamMap, config: SlamConfig) -> tuple[np.ndarray, Pose, Cov]:
    """Return (k, 2) keyframes of both maps that match without a guess, (k, 3) poses, (k, 3, 3) their covariances."""
    known = Keyframes("curvescan", None, len(one))
    for k, scan in enumerate(one.scans):
        known.add(scan, k)
    pairs, poses, covariances = [], [], []
    for j in np.unique(np.linspace(0, len(other) - 1, min(_MOST_VIEWS, len(other))).astype(int)).tolist():
        current = known.prepare(other.scans[j])
        for i in known.index.most_similar(known.signature(current), _N_ALIKE).tolist():
            result = current.matcher.match(known.prepared(i).features, current.features, None)
            if result.ok and result.degenerate_direction is None and is_confident(result, config):
                pairs.append((i, j))
                poses.append(result.pose)
                covariances.append(config.noise.edge(as_measurement(result).cov))
    shape = len(pairs)
    return (
        np.array(pairs, dtype=np.int64).reshape(-1, 2),
        np.reshape(poses, (shape, 3)),
        np.reshape(covariances, (shape, 3, 3)),
    )


def _agreed(one: SlamMap, other: SlamMap, pairs: np.ndarray, measured: Pose) -> Bools:
    """Return (k,) which matches agree on how the maps lie to each other, or refuse."""
    places = _places(one, other, pairs, measured)
    support = [len(set(pairs[_near(places, k), 1].tolist())) for k in range(len(places))]
    best = int(np.argmax(support)) if support else 0
    near = _near(places, best) if support else np.zeros(0, dtype=np.bool_)
    rival = max((n for k, n in enumerate(support) if not near[k]), default=0)
    most = support[best] if support else 0
    if most < _LEAST or most < _MARGIN * rival:
        raise InvalidArgumentError(
            f"nothing joins the two maps: {most} keyframes match without a guess and agree on how they lie, "
            f"{rival} on another place; {_LEAST} are needed, and {_MARGIN:g} times as many as on any other"
        )
    return near


def _places(one: SlamMap, other: SlamMap, pairs: np.ndarray, measured: Pose) -> Pose:
    """Return (k, 3) pose of the other map in the first one, by each match."""
    there = se2.compose(one.poses[pairs[:, 0]], measured)
    return se2.compose(there, se2.inverse(other.poses[pairs[:, 1]]))


def _near(places: Pose, k: int) -> Bools:
    off = se2.between(places[k], places)
    return np.asarray((np.hypot(off[:, 0], off[:, 1]) < _AGREES_M) & (np.abs(off[:, 2]) < _AGREES_RAD))
