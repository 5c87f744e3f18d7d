"""Pending closures, and the sets of them that agree."""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan.se2.uncertain import UncertainPose, compose, fuse
from curvescan.slam.config import SlamConfig
from curvescan.slam.loops.closures import Closure
from curvescan.slam.pose_graph.consistency import largest_clique
from curvescan.types import Bools, Pose


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
        agrees = np.zeros((len(group), len(group)), dtype=np.bool_)
        for a, one in enumerate(group):
            for b in range(a):
                agrees[a, b] = agrees[b, a] = self._agree(one, group[b], poses)
        last = len(group) - 1
        friends = np.flatnonzero(agrees[last])
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

    def _agree(self, one: Closure, other: Closure, poses: Pose) -> bool:
        """Return whether the cycle through two closures closes within its covariance."""
        to_i = self._by_graph(other.i, one.i, poses)
        to_j = self._by_graph(one.j, other.j, poses)
        around = compose(compose(to_i, UncertainPose(one.pose, one.covariance)), to_j)
        there = UncertainPose(other.pose, other.covariance)
        return fuse(around, there)[1] < self._config.closures.gate

    def _by_graph(self, a: int, b: int, poses: Pose) -> UncertainPose:
        """Return keyframe b seen from a, both of one stretch, with what edges between them usually err by."""
        if a == b:
            return UncertainPose(np.zeros(3), np.zeros((3, 3)))
        pose = se2.between(poses[a], poses[b])
        n_edges = 1.0 + float(np.hypot(pose[0], pose[1])) / self._config.keyframes.distance
        return UncertainPose(pose, 4.0 * n_edges * self._config.noise.floor)
