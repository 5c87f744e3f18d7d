"""Audit: matches that the finished map refuses, grouped by agreement.

One of them may be wrong. Where many agree, or fail where the map shows places twice, it is more likely the map.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from curvescan import se2
from curvescan.slam.config import GATE, SlamConfig
from curvescan.slam.loops.agreement import agreements, largest_clique
from curvescan.slam.loops.closures import Closure, expectation_of
from curvescan.slam.loops.cycles import Chain, difference
from curvescan.slam.pose_graph.graph import is_whole
from curvescan.types import Floats, Ints, Pose

_N_KEYFRAMES = 5
"""Keyframes whose matches must agree: three agreed on a good map of Killian, ten and more do on bent ones."""

N_NEAR = 20
"""Most keyframes between closures that may speak for or against each other."""

SURE = 0.9
"""Confidence from which on a match alone may contradict the finished map: right in 99.9 %."""

_BENT_M = 0.5
"""A map that is off by less is not bent, metres."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Contradiction:
    """Matches that contradict the finished map: sure ones that agree with each other, or that fail in a row."""

    place: Floats  # (2,): mean place of the later keyframes in the map, metres
    pairs: Ints  # (n, 2): numbers of the keyframes of each match; the later one second
    off: Pose  # (3,): median of where they put the later keyframe, seen from where the map has it; NaN where they fail


def contradictions(groups: list[list[Closure]], poses: Pose, numbers: Ints) -> list[Contradiction]:
    """Return what groups of matches, by row, say against a map, the largest first: a few keyframes may be deceived."""
    found: list[Contradiction] = []
    for group in (one for one in groups if len({c.j for c in one}) >= _N_KEYFRAMES):
        ends = np.array([(c.i, c.j) for c in group])
        off = np.array([se2.between(se2.between(poses[c.i], poses[c.j]), c.pose) for c in group])
        median = np.median(off, axis=0)
        if not math.hypot(median[0], median[1]) <= _BENT_M:
            found.append(Contradiction(place=poses[ends[:, 1], :2].mean(axis=0), pairs=numbers[ends], off=median))
    return sorted(found, key=lambda one: -len(one.pairs))


def groups_against(tried: list[Closure], poses: Pose, config: SlamConfig) -> list[list[Closure]]:
    """Return the sets of matches that agree with each other and not with a map.

    Each has the expectation of a map whose ways may have slipped. Those of a set are near each other along the path:
    matches of far stretches agree by chance, as nothing is known of the way between.
    """
    against = []
    for one in tried:
        off = difference(se2.between(poses[one.i], poses[one.j]), one.pose)
        cov = one.covariance + config.noise.spread
        if not off @ np.linalg.solve(cov, off) < GATE:
            expectation = expectation_of(off, cov, config, is_open=not is_whole(one.covariance))
            against.append(replace(one, expectation=expectation))
    rest = sorted(against, key=lambda c: (c.j, c.i))
    chain = Chain.of(poses, np.zeros((len(poses), 3, 3)))
    found: list[list[Closure]] = []
    while rest:
        near = [c for c in rest if abs(c.j - rest[0].j) <= N_NEAR and abs(c.i - rest[0].i) <= N_NEAR]
        rows = np.arange(len(near))
        members = set(largest_clique(agreements(near, rows, rows, chain, config, 0.0)).tolist())
        group = [c for k, c in enumerate(near) if k in members]
        group = group if rest[0] in group else rest[:1]
        found.append(group)
        rest = [c for c in rest if c not in group]
    return found
