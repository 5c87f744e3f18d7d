"""Agreement: the odds of a set of matches that agree pairwise, against those of the sets that contradict it.

Pairs agree when the cycle through both closes within its covariance; a set in which all do is a clique (Mangelson,
Dominic, Eustice and Vasudevan, "Pairwise consistent measurement set maximization for robust multi-robot map merging",
ICRA 2018). Views of one place err alike: a match adds to the odds of its set in proportion to the way since the last
one that counted. The sum is bounded: places look alike for a stretch, corridors all along: alone they close nothing.
"""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan._jit import kernel
from curvescan.slam.config import GATE, SlamConfig
from curvescan.slam.loops.closures import MOST_ODDS, Closure
from curvescan.slam.loops.cycles import Chain, cycle_distances
from curvescan.slam.pose_graph.graph import is_whole
from curvescan.types import Bools, Ints

_VIEW_M = 2.0
"""Views this far apart show different surfaces, metres."""

MOST_LOG_ODDS = 14.0
"""Most that the matches of a set say together: one building in a million looks the same over a stretch of the way."""

_MOST_BRANCHES = 20_000


def best_group(pool: list[Closure], chain: Chain, config: SlamConfig) -> tuple[list[int], float]:
    """Return the set that the last closure of a pool belongs to, and its log odds.

    They are less those of what contradicts it, unless it is too unlikely in any case. The ways between closures count
    up to where they would guide a match.
    """
    known, last, whole = config.closures.certain_m, len(pool) - 1, is_whole(np.array([c.covariance for c in pool]))
    before = np.flatnonzero(whole[:-1] == whole[-1])  # what leaves a way open agrees with the next room as well
    friends = before[agreements(pool, before, np.array([last]), chain, config, known)[:, 0]]
    members = np.append(friends[largest_clique(agreements(pool, friends, friends, chain, config, known))], last)
    alone = odds(pool, members, chain, config)
    if alone <= config.closures.log_odds:
        return members.tolist(), alone
    others = np.setdiff1d(np.arange(len(pool)), members)
    # what contradicts most of the set, however the ways may err
    others = others[agreements(pool, others, members, chain, config, np.inf).mean(axis=1) < 0.5]
    against = others[largest_clique(agreements(pool, others, others, chain, config, known))]
    return members.tolist(), alone - max(odds(pool, against, chain, config), 0.0)


def agreements(pool: list[Closure], rows: Ints, columns: Ints, chain: Chain, config: SlamConfig, known: float) -> Bools:
    """Return whether the cycles through closures, each of some with each of others, close within their covariances.

    known: Standard deviation up to which the ways between closures count, metres.
    """
    ends = np.array([(c.i, c.j) for c in pool], dtype=np.int64)
    edges = np.array([c.pose for c in pool]), np.array([c.covariance for c in pool])
    spread, step = config.noise.spread, config.keyframes.distance
    distances = cycle_distances(ends, edges, chain, (rows, columns), spread, step, known)
    return np.asarray(distances[np.ix_(rows, columns)] < GATE)


def odds(pool: list[Closure], members: Ints, chain: Chain, config: SlamConfig) -> float:
    """Return the log odds of a set: of its views, and of where the graph expects them."""
    if not len(members):
        return 0.0
    chosen = [pool[k] for k in members.tolist()]
    said = np.array([c.log_odds for c in chosen])
    ends = chain.poses[np.array([(c.i, c.j) for c in chosen])]
    off = ends[:, np.newaxis] - ends
    # how much their ends differ along the odometry, metres; a radian counts as one
    apart = (np.hypot(off[..., 0], off[..., 1]) + np.abs(se2.wrap(off[..., 2]))).max(axis=-1)
    total, new = 0.0, np.full(len(chosen), _VIEW_M)  # metres from the nearest one that counted
    for k in np.argsort(-said, kind="stable").tolist():
        if new[k] > 0.0:
            total += float(new[k] / _VIEW_M * said[k])
            np.minimum(new, apart[k], out=new)
    most = MOST_LOG_ODDS * (float(said.max()) / MOST_ODDS)
    if not is_whole(np.array([c.covariance for c in chosen])).any():
        most = min(most, config.closures.log_odds)
    expected = [c.expectation for c in chosen if not c.is_accepted] or [c.expectation for c in chosen]
    return min(total, most) + float(np.mean(expected))


def largest_clique(agrees: Bools) -> Ints:
    """Return the rows of a large clique of an (n, n) graph, sorted: the maximum one of small graphs."""
    n = len(agrees)
    links = agrees & ~np.eye(n, dtype=np.bool_)
    order = np.argsort(-links.sum(axis=1), kind="stable")
    return np.sort(order[_clique(np.ascontiguousarray(links[order][:, order]))])


@kernel
def _clique(links: Bools) -> Ints:
    """Return a maximum clique, or the best after so many branches (Carraghan and Pardalos 1990)."""
    n = len(links)
    best = np.empty(n, dtype=np.int64)
    n_best = 0
    candidates = np.empty((n + 1, n), dtype=np.int64)
    n_candidates = np.zeros(n + 1, dtype=np.int64)
    upcoming = np.zeros(n + 1, dtype=np.int64)
    current = np.empty(n, dtype=np.int64)
    candidates[0], n_candidates[0] = np.arange(n), n
    depth, n_visited = 0, 0
    while depth >= 0:
        if n_candidates[depth] - upcoming[depth] + depth <= n_best or (n_visited >= _MOST_BRANCHES and n_best > 0):
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
