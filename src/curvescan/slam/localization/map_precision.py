"""MapPrecision: how well a map knows where its keyframes lie, seen from each other.

A map bends where few matches tie its keyframes: a sensor that goes on from one of them to the next then comes to lie
beside where the first one has it. Along the best way through the graph, its edges' variances are added: other ways
between the two would lower the sum, so that it is never too small.
"""

from __future__ import annotations

from functools import lru_cache, partial
from typing import Any

import numpy as np

from curvescan.slam.map import SlamMap
from curvescan.types import Cov, Floats, Ints

_LEVER_M = 1.0
"""A way is better where it knows the position this far away better, metres."""

_FAR = 100.0
"""Ways of more than this variance are not followed, square metres."""


class MapPrecision:
    """Relative covariances of the keyframes of a map."""

    def __init__(self, slam_map: SlamMap) -> None:
        self._poses = slam_map.poses
        used = slam_map.weights > 0.5
        ends, cov = slam_map.ends[used], slam_map.edge_covariances[used]
        position = np.maximum(cov[:, 0, 0], cov[:, 1, 1])
        self._variances, ways = _best_edges(len(self._poses), ends, position, cov[:, 2, 2])
        self._before = lru_cache(maxsize=1)(partial(_before_each, ways))

    def between(self, i: int, j: int) -> Cov:
        """Return (3, 3) covariance of keyframe j seen from keyframe i: x, y, theta; the same in any frame."""
        if i < 0 or i == j:
            return np.zeros((3, 3))
        position, rotation, at = 0.0, 0.0, j
        while at != i:
            before = int(self._before(i)[at])
            if before < 0:  # parts that nothing joins, or no better
                return np.diag([_FAR, _FAR, np.pi**2])
            edge = self._variances[min(before, at), max(before, at)]
            position, rotation = position + edge[0], rotation + edge[1]
            at = before
        distance = float(np.hypot(*(self._poses[j] - self._poses[i])[:2]))
        aside = position + rotation * distance**2
        return np.diag([aside, aside, rotation])


def _before_each(ways: Any, i: int) -> Ints:
    """Return (n,) the keyframe before each on the best way from one; negative where there is none."""
    from scipy.sparse.csgraph import dijkstra  # loads for a good part of a second

    return np.asarray(dijkstra(ways, directed=False, indices=i, limit=_FAR, return_predecessors=True)[1])


def _best_edges(
    n: int, ends: Ints, position: Floats, rotation: Floats
) -> tuple[dict[tuple[int, int], tuple[float, float]], Any]:
    """Return the variance of the best edge of each pair of keyframes, and the graph weighed by them."""
    from scipy.sparse import csr_array

    weights = position + _LEVER_M**2 * rotation
    variances: dict[tuple[int, int], tuple[float, float]] = {}
    for k in np.argsort(-weights, kind="stable").tolist():  # the best one last
        i, j = sorted(ends[k].tolist())
        variances[i, j] = float(position[k]), float(rotation[k])
    pairs = np.array(list(variances), dtype=np.int64).reshape(-1, 2)
    best = np.array([p + _LEVER_M**2 * r for p, r in variances.values()])
    return variances, csr_array((best, (pairs[:, 0], pairs[:, 1])), shape=(n, n))
