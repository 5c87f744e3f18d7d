"""Pairwise consistency: which of many closures agree with each other.

Two closures (i, j) and (k, l) and the graph's own relative poses i-k and j-l make a cycle; it must close within its
covariance (Mangelson et al. 2018, eq. 3). The largest set in which all pairs agree is a maximum clique.
"""

from __future__ import annotations

import numpy as np

from curvescan._jit import kernel
from curvescan.types import Bools, Ints


def largest_clique(agrees: Bools, ranks: Ints | None = None) -> Ints:
    """Return the rows of a large clique of a graph, sorted: the maximum one of small graphs, a greedy one of large.

    agrees (n, n); ranks (n,): Ties go to the row of the lowest rank; None for the order of the rows.
    """
    n = len(agrees)
    links = agrees & ~np.eye(n, dtype=np.bool_)
    order = np.lexsort((np.arange(n) if ranks is None else ranks, -links.sum(axis=1)))
    sorted_links = np.ascontiguousarray(links[order][:, order])
    return np.sort(order[_clique(sorted_links, 20_000)])


@kernel
def _clique(links: Bools, max_nodes: int) -> Ints:
    """Return a maximum clique, or the best after max_nodes branches (Carraghan and Pardalos 1990)."""
    n = len(links)
    best = np.empty(n, dtype=np.int64)
    n_best = 0
    candidates = np.empty((n + 1, n), dtype=np.int64)
    n_candidates = np.zeros(n + 1, dtype=np.int64)
    upcoming = np.zeros(n + 1, dtype=np.int64)
    current = np.empty(n, dtype=np.int64)
    for k in range(n):
        candidates[0, k] = k
    n_candidates[0] = n
    depth, n_visited = 0, 0
    while depth >= 0:
        if n_candidates[depth] - upcoming[depth] + depth <= n_best or (n_visited >= max_nodes and n_best > 0):
            depth -= 1
            continue
        chosen = candidates[depth, upcoming[depth]]
        upcoming[depth] += 1
        n_visited += 1
        current[depth] = chosen
        kept = 0
        for k in range(upcoming[depth], n_candidates[depth]):
            if links[chosen, candidates[depth, k]]:
                candidates[depth + 1, kept] = candidates[depth, k]
                kept += 1
        if kept == 0:
            if depth + 1 > n_best:
                n_best = depth + 1
                best[:n_best] = current[:n_best]
            continue
        depth += 1
        n_candidates[depth], upcoming[depth] = kept, 0
    return best[:n_best].copy()
