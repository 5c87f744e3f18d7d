"""Agreement: the odds of a set of matches that agree pairwise, against those of the sets that contradict it.

Pairs agree when the cycle through both closes within its covariance (Mangelson, Dominic, Eustice and Vasudevan,
"Pairwise consistent measurement set maximization for robust multi-robot map merging", ICRA 2018). Views of one place
err alike: a match adds to the odds of its set in proportion to the way since the last one that counted. One place may
look like another for a stretch, so that the sum is bounded.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan.slam.config import GATE, SlamConfig
from curvescan.slam.loops.closures import Closure, log_odds
from curvescan.slam.loops.cycles import Chain, cycle_distances
from curvescan.slam.pose_graph.consistency import largest_clique
from curvescan.types import Bools, Ints

_VIEW_M = 2.0
"""Views this far apart show different surfaces, metres."""


class Group(NamedTuple):
    """Closures that agree, and their log odds."""

    members: list[int]
    log_odds: float


def log_odds_of(group: list[Closure], known: list[Closure], chain: Chain, config: SlamConfig) -> float:
    """Return the log odds of closures that agree, less those of the known ones that contradict them."""
    pool = [*known, *group]
    members, others = np.arange(len(known), len(pool)), np.arange(len(known))
    against = _contradicting(pool, others, members, agreements(pool, chain, config, 0.0), chain, config)
    own = _odds(pool, members, chain, config)
    return own - max(_odds(pool, against, chain, config), 0.0)


def best_group(pool: list[Closure], chain: Chain, config: SlamConfig, known: float) -> tuple[Group, float]:
    """Return the set that the last closure of a pool belongs to, and the log odds of the best one that contradicts it.

    known: standard deviation up to which the ways between closures count, metres.
    """
    agrees = agreements(pool, chain, config, known)
    last = len(pool) - 1
    friends = np.flatnonzero(agrees[last, :last])
    members = np.append(friends[largest_clique(agrees[np.ix_(friends, friends)])], last)
    others = np.setdiff1d(np.arange(last), members)
    against = _contradicting(pool, others, members, agrees, chain, config)
    chosen = Group(members.tolist(), _odds(pool, members, chain, config))
    return chosen, _odds(pool, against, chain, config)


def _contradicting(
    pool: list[Closure], others: Ints, members: Ints, agrees: Bools, chain: Chain, config: SlamConfig
) -> Ints:
    """Return the largest set of others that contradict most of the members, however the ways between may have erred."""
    is_possible = agreements(pool, chain, config, np.inf)[np.ix_(others, members)]
    others = others[is_possible.mean(axis=1) < 0.5]
    return np.asarray(others[largest_clique(agrees[np.ix_(others, others)])])


def agreements(pool: list[Closure], chain: Chain, config: SlamConfig, known: float) -> Bools:
    """Return (n, n) whether the cycle through two closures closes within its covariance."""
    ends = np.array([(c.i, c.j) for c in pool], dtype=np.int64)
    measured, covariances = np.array([c.pose for c in pool]), np.array([c.covariance for c in pool])
    floor = np.diagonal(config.noise.floor).copy()
    step = config.keyframes.distance
    distances = cycle_distances(ends, measured, covariances, *chain, floor, step, known)
    return np.asarray(distances < GATE)


def _odds(pool: list[Closure], members: Ints, chain: Chain, config: SlamConfig) -> float:
    """Return the log odds of a set: of its views, and of where the graph expects them."""
    if not len(members):
        return 0.0
    chosen = [pool[k] for k in members.tolist()]
    total = 0.0
    counted: list[Closure] = []
    for c in sorted(chosen, key=lambda one: -log_odds(one)):
        new = min((max(_apart(chain, c.i, o.i), _apart(chain, c.j, o.j)) for o in counted), default=_VIEW_M)
        share = min(new / _VIEW_M, 1.0)
        if share > 0.0:
            counted.append(c)
            total += share * log_odds(c)
    expectation = float(np.mean([c.expectation for c in chosen]))
    return min(total, config.closures.most_log_odds) + expectation


def _apart(chain: Chain, a: int, b: int) -> float:
    """Return how much two keyframes differ along the odometry, metres; a radian counts as a metre."""
    x, y, turn = (chain.poses[a] - chain.poses[b]).tolist()
    return math.hypot(x, y) + abs(float(se2.wrap(turn)))
