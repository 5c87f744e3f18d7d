"""MapPrecision: how well a map knows where its keyframes lie, seen from each other.

A map bends where few matches tie its keyframes: a sensor that goes on from one of them to the next then comes to lie
beside where the first one has it. Along the best way through the graph, its edges' variances are added: other ways
between the two would lower the sum, so that it is never too small.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from curvescan.slam.map import SlamMap
from curvescan.types import Cov, Ints

_FAR = 100.0
"""Ways of more than this variance are not followed, square metres."""


class MapPrecision:
    """Relative covariances of the keyframes of a map."""

    def __init__(self, slam_map: SlamMap) -> None:
        from scipy.sparse import csr_array  # loads for a good part of a second

        used = slam_map.weights > 0.5
        ends, cov = np.sort(slam_map.ends[used], axis=1), slam_map.edge_covariances[used]
        position, rotation = np.maximum(cov[:, 0, 0], cov[:, 1, 1]), cov[:, 2, 2]
        weights = position + rotation  # the variance of a position 1 m away
        order = np.argsort(weights, kind="stable")
        pairs, first = np.unique(ends[order], axis=0, return_index=True)
        best = order[first]
        self._poses, n = slam_map.poses, len(slam_map.poses)
        self._edge = {(i, j): k for (i, j), k in zip(pairs.tolist(), best.tolist(), strict=True)}
        self._position, self._rotation = position, rotation  # of each edge
        # by 32 bits, as the searches of SciPy 1.12 have it
        self._ways = csr_array((weights[best], tuple(pairs.astype(np.int32).T)), shape=(n, n))
        self._before = lru_cache(maxsize=1)(self._before_each)

    def between(self, i: int, j: int) -> Cov:
        """Return (3, 3) covariance of keyframe j seen from keyframe i: x, y, theta; the same in any frame."""
        if i < 0 or i == j:
            return np.zeros((3, 3))
        position, rotation, at = 0.0, 0.0, j
        while at != i:
            before = int(self._before(i)[at])
            if before < 0:  # parts that nothing joins, or no better
                return np.diag([_FAR, _FAR, np.pi**2])
            edge = self._edge[min(before, at), max(before, at)]
            position, rotation, at = position + self._position[edge], rotation + self._rotation[edge], before
        distance = float(np.hypot(*(self._poses[j] - self._poses[i])[:2]))
        aside = position + rotation * distance**2
        return np.diag([aside, aside, rotation])

    def _before_each(self, i: int) -> Ints:
        """Return (n,) the keyframe before each on the best way from one; negative where there is none."""
        from scipy.sparse.csgraph import dijkstra

        return np.asarray(dijkstra(self._ways, directed=False, indices=i, limit=_FAR, return_predecessors=True)[1])
