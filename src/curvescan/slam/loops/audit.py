"""Audit: sure matches that the finished map refuses, grouped by agreement.

One of them may be wrong. Where matches from three keyframes and more agree with each other, the map is more likely wrong there.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan.slam.config import SlamConfig
from curvescan.slam.loops.agreement import agreements
from curvescan.slam.loops.closures import Closure
from curvescan.slam.loops.cycles import Chain
from curvescan.slam.pose_graph.consistency import largest_clique
from curvescan.types import Floats, Ints, Pose

SURE = 0.9
"""Confidence of a match from which on it may contradict the map."""

_N_KEYFRAMES = 3
"""Keyframes whose matches must agree."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Contradiction:
    """Sure matches that agree with each other and contradict the finished map.

    Attributes
    ----------
    place : (2,) float64
        Mean place of the later keyframes in the map, metres.
    pairs : (n, 2) int64
        Numbers of the keyframes of each match; the later one second.
    off : (3,) float64
        Median of where the matches put the later keyframe, seen from where the map has it: x, y, theta; metres and radians.
    """

    place: Floats
    pairs: Ints
    off: Pose

    @property
    def count(self) -> int:
        """Matches."""
        return len(self.pairs)

    @property
    def n_keyframes(self) -> int:
        """Later keyframes of the matches."""
        return len(set(self.pairs[:, 1].tolist()))


def contradictions(refused: list[Closure], poses: Pose, numbers: Ints, config: SlamConfig) -> list[Contradiction]:
    """Return the groups of matches that contradict a map, the largest first; `refused` are by row.

    poses (n, 3): of the finished map; numbers (n,).
    """
    found: list[Contradiction] = []
    for group in groups_against(refused, poses, config):
        ends = np.array([(c.i, c.j) for c in group])
        off = np.array([se2.between(se2.between(poses[c.i], poses[c.j]), c.pose) for c in group])
        place = poses[ends[:, 1], :2].mean(axis=0)
        found.append(Contradiction(place=place, pairs=numbers[ends], off=np.median(off, axis=0)))
    return sorted(found, key=lambda one: -one.count)


def groups_against(refused: list[Closure], poses: Pose, config: SlamConfig) -> list[list[Closure]]:
    """Return the sets of sure matches from three keyframes and more that agree with each other and not with a map."""
    rest = [c for c in refused if c.confidence >= SURE and _is_against(c, poses, config)]
    chain = Chain.of(poses, np.zeros((len(poses), 3, 3)))
    found: list[list[Closure]] = []
    while len({c.j for c in rest}) >= _N_KEYFRAMES:
        members = set(largest_clique(agreements(rest, chain, config, 0.0)).tolist())
        group = [c for k, c in enumerate(rest) if k in members]
        if len({c.j for c in group}) >= _N_KEYFRAMES:
            found.append(group)
        rest = [c for k, c in enumerate(rest) if k not in members]
    return found


def _is_against(closure: Closure, poses: Pose, config: SlamConfig) -> bool:
    """Return whether a map still contradicts a match."""
    off = closure.pose - se2.between(poses[closure.i], poses[closure.j])
    off[2] = se2.wrap(off[2])
    cov = closure.covariance + 4.0 * config.noise.floor
    return bool(off @ np.linalg.solve(cov, off) > config.closures.gate)
