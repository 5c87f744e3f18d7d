"""Audit: what matches that the finished map refuses say against it together, and what it costs to follow them.

One of them may be wrong, and two corners may look alike for a stretch. Where many agree along the way, or fail where
the map shows places twice, it is more likely the map.
"""

from __future__ import annotations

import math
from copy import deepcopy
from dataclasses import dataclass, replace

import numpy as np

from curvescan import se2
from curvescan.slam.config import GATE, KEPT, SlamConfig
from curvescan.slam.loops.agreement import agreements, largest_clique, odds
from curvescan.slam.loops.closures import Closure
from curvescan.slam.loops.cycles import Chain, difference
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph
from curvescan.slam.pose_graph.posterior import design_effect
from curvescan.slam.pose_graph.robust import optimized
from curvescan.types import Floats, Ints, Pose

N_NEAR = 20  # most keyframes between closures that may speak for or against each other


@dataclass(frozen=True, eq=False, kw_only=True)
class Contradiction:
    """Matches that fail in a row where the finished map shows places twice."""

    place: Floats  # (2,): mean place of the later keyframes in the map, metres
    pairs: Ints  # (n, 2): numbers of the keyframes of each match; the later one second


def sets_against(tried: list[Closure], poses: Pose, config: SlamConfig) -> list[tuple[float, list[Closure]]]:
    """Return sets of matches that agree with each other and not with a map, and the log odds of each, highest first.

    Those of a group are near each other along the path: matches of far stretches agree by chance, as nothing is known
    of the way between. Groups that go on from each other are one set, as one slip explains them; each adds its odds.
    """
    chain = Chain.of(poses, np.zeros((len(poses), 3, 3)))
    found: list[tuple[float, list[Closure]]] = []
    for group in _groups([one for one in tried if is_refused(one, poses, config)], chain, config):
        said, members = odds(group, np.arange(len(group)), chain, config), group
        for k, (before, others) in enumerate(found):
            near = [c for c in others if _is_near(c, group[0])]
            pool, rows = near + group, np.arange(len(near) + len(group))
            if near and agreements(pool, rows[: len(near)], rows[len(near) :], chain, config, 0.0).mean() > 0.5:
                said, members = before + said, others + group
                del found[k]
                break
        found.append((said, members))
    return sorted(found, key=lambda one: -one[0])


def cost_of(members: list[Closure], graph: PoseGraph, alone: Floats) -> float:
    """Return half the chi-square, (m,) alone, that edges have more if a graph follows matches; inf if it does not."""
    trial, n = deepcopy(graph), len(graph.ends)
    for one in members:
        trial.add_edge(one.i, one.j, one.pose, one.covariance, EdgeKind.CLOSURE)
    together = optimized(trial, weights=trial.weights)
    alike = design_effect(graph.ends, graph.kinds != EdgeKind.MOTION, graph.n_poses, 1.0 - KEPT)
    is_followed = np.mean(together.weights[n:] > 0.5) > 0.5
    return 0.5 * float(((together.costs[:n] - alone) / alike).sum()) if is_followed else math.inf


def is_refused(one: Closure, poses: Pose, config: SlamConfig) -> bool:
    """Return whether a match failed, or contradicts the poses of a finished map, (n, 3)."""
    off = difference(se2.between(poses[one.i], poses[one.j]), one.pose) if math.isfinite(one.pose[0]) else one.pose
    return not off @ np.linalg.solve(one.covariance + config.noise.spread, off) < GATE


def _is_near(one: Closure, other: Closure) -> bool:
    return abs(one.j - other.j) <= N_NEAR and abs(one.i - other.i) <= N_NEAR


def _groups(refused: list[Closure], chain: Chain, config: SlamConfig) -> list[list[Closure]]:
    """Return groups of matches near each other that agree; what the graph expects is not asked: it refuses them."""
    rest = sorted((replace(one, expectation=0.0) for one in refused), key=lambda c: (c.j, c.i))
    found: list[list[Closure]] = []
    while rest:
        near = [c for c in rest if _is_near(c, rest[0])]
        rows = np.arange(len(near))
        members = set(largest_clique(agreements(near, rows, rows, chain, config, 0.0)).tolist())
        group = [c for k, c in enumerate(near) if k in members]
        found.append(group if rest[0] in group else rest[:1])
        rest = [c for c in rest if c not in found[-1]]
    return found
