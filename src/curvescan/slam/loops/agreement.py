"""Pending closures, and the sets of them that agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from curvescan.slam.config import SlamConfig
from curvescan.slam.loops.closures import Closure
from curvescan.slam.loops.cycles import cycle_distances
from curvescan.slam.pose_graph.consistency import largest_clique
from curvescan.types import Bools, Ints, Pose


class Waiting:
    """Closures where the graph does not know the relative pose well, until enough of them agree.

    Parameters
    ----------
    config : SlamConfig
        The rules.
    """

    def __init__(self, config: SlamConfig) -> None:
        self._config = config
        self._closures: list[Closure] = []

    def confirm(self, closure: Closure) -> None:
        """Take a closure that is accepted already: others of its scans must agree with it."""
        self._closures.append(closure)
        del self._closures[: -self._config.closures.n_waiting]

    def renumber(self, row_of: Ints) -> None:
        """Count keyframes anew by (n,) new row of each, -1 of those that are gone."""
        self._closures = [
            replace(c, i=int(row_of[c.i]), j=int(row_of[c.j]))
            for c in self._closures
            if row_of[c.i] >= 0 and row_of[c.j] >= 0
        ]

    def add(self, closure: Closure, poses: Pose) -> list[Closure]:
        """Take a closure, and return those that are accepted now because they agree; none if too few do.

        Parameters
        ----------
        closure : Closure
            The new one.
        poses : (n, 3) float64
            Poses of the keyframes.
        """
        rules = self._config.closures
        self._closures.append(closure)
        del self._closures[: -rules.n_waiting]
        group = [c for c in self._closures if abs(c.j - closure.j) <= 20]
        agrees = self._agreements(group, poses)
        last = len(group) - 1
        friends = np.flatnonzero(agrees[last, :last])
        members = np.append(friends[largest_clique(agrees[np.ix_(friends, friends)])], last)
        if not self._is_enough(members, group, agrees):
            return []
        chosen = [group[k] for k in members.tolist() if not group[k].is_accepted]
        first, newest = min(c.j for c in chosen), max(c.j for c in chosen)
        self._closures = [c for c in self._closures if not first <= c.j <= newest]
        return chosen

    def _is_enough(self, members: np.ndarray, group: list[Closure], agrees: Bools) -> bool:
        rules = self._config.closures
        chosen = [group[k] for k in members.tolist()]
        is_doubtful = any(c.is_doubtful for c in chosen)
        n_least = (2 if is_doubtful else 1) * rules.n_agreeing
        if len(chosen) < n_least or len({c.j for c in chosen}) < (3 if is_doubtful else 2):
            return False
        others = np.array([k for k in range(len(group)) if k not in set(members.tolist())])
        if not len(others):
            return True
        rival = largest_clique(agrees[np.ix_(others, others)])
        return len(chosen) >= rules.margin * len(rival)

    def _agreements(self, group: list[Closure], poses: Pose) -> Bools:
        """Return (n, n) whether the cycle through two closures closes within its covariance."""
        ends = np.array([(c.i, c.j) for c in group], dtype=np.int64)
        measured = np.array([c.pose for c in group])
        covariances = np.array([c.covariance for c in group])
        # edges between two keyframes usually err by this
        floor = np.diagonal(self._config.noise.floor).copy()
        distances = cycle_distances(
            ends, measured, covariances, poses, floor, self._config.keyframes.distance
        )
        return np.asarray(distances < self._config.closures.gate)
