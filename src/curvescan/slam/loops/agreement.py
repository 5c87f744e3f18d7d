"""Pending closures, and the sets of them that agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from curvescan.slam.config import SlamConfig
from curvescan.slam.loops.closures import Closure, ClosureOutcome
from curvescan.slam.loops.cycles import Chain, cycle_distances
from curvescan.slam.pose_graph.consistency import largest_clique
from curvescan.types import Bools, Floats, Ints


class Waiting:
    """Closures where the graph does not know the relative pose well, until enough of them agree."""

    def __init__(self, config: SlamConfig) -> None:
        self._config = config
        self._closures: list[Closure] = []
        self._known: set[tuple[int, int]] = set()  # what the newest optimization knows

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

    def add(self, closure: Closure, chain: Chain) -> list[Closure]:
        """Take a closure, and return those that are accepted now because they agree; none if too few do.

        What was accepted has its say until the graph's own covariances know of it, after the next optimization: what
        agrees with it needs fewer others, what contradicts it is not taken at all. What the graph contradicts, too,
        is not taken while matches from two keyframes that lie where the graph expects them contradict it: where rooms
        are alike, both their own place and the next room match.
        """
        if self._is_contradicted(closure, chain):
            return []
        self._closures.append(closure)
        del self._closures[: -self._config.closures.n_waiting]
        return self._agreeing(closure, chain, n_views=2)

    def _is_contradicted(self, closure: Closure, chain: Chain) -> bool:
        """Return whether what was accepted since the last optimization and the chain's motions exclude a closure."""
        agreed = [c for c in self._closures if c.outcome is ClosureOutcome.AGREED]
        if not agreed:
            return False
        excludes = self._distances([*agreed, closure], chain, np.inf)[-1, :-1] > self._config.closures.gate
        return bool(2 * np.count_nonzero(excludes) > len(agreed))

    def optimize(self) -> None:
        """Remember what is accepted as an optimization begins."""
        self._known = {(c.i, c.j) for c in self._closures if c.is_accepted}

    def adopt(self) -> None:
        """Drop what was accepted by agreement before an optimization that has ended: from now on the graph speaks for it."""
        self._closures = [
            c for c in self._closures if c.outcome is not ClosureOutcome.AGREED or (c.i, c.j) not in self._known
        ]

    def conclude(self, chain: Chain) -> list[Closure]:
        """Return which closures of the last keyframe are accepted at the end of a stream, where no further view can be waited for.

        A log often ends as its loop closes. Matches of one keyframe with several others are enough then, where the
        graph does not contradict them.
        """
        last = len(chain.poses) - 1
        pending = [c for c in self._closures if c.j == last and not (c.is_accepted or c.is_doubtful)]
        return self._agreeing(pending[-1], chain, n_views=1) if pending else []

    def _agreeing(self, closure: Closure, chain: Chain, n_views: int) -> list[Closure]:
        """Return the closures that are accepted because they agree with one, made from `n_views` keyframes at least."""
        group = [c for c in self._closures if abs(c.j - closure.j) <= 20 and c is not closure]
        group.append(closure)
        agrees = self._agreements(group, chain)
        last = len(group) - 1
        friends = np.flatnonzero(agrees[last, :last])
        members = np.append(friends[largest_clique(agrees[np.ix_(friends, friends)])], last)
        if not self._is_enough(members, group, agrees, n_views):
            return []
        if self._is_outweighed(members, group, chain):
            return []
        chosen = [group[k] for k in members.tolist() if not group[k].is_accepted]
        first, newest = min(c.j for c in chosen), max(c.j for c in chosen)
        agreed = [replace(c, outcome=ClosureOutcome.AGREED) for c in chosen]
        self._closures = [c for c in self._closures if c.is_accepted or not first <= c.j <= newest] + agreed
        return agreed

    def _is_enough(self, members: np.ndarray, group: list[Closure], agrees: Bools, n_views: int) -> bool:
        rules = self._config.closures
        chosen = [group[k] for k in members.tolist()]
        is_doubtful = any(c.is_doubtful for c in chosen)
        n_least = (2 if is_doubtful else 1) * rules.n_agreeing
        views = {c.j for c in chosen}
        if len(chosen) < n_least or len(views) < n_views + is_doubtful:
            return False
        # one place may look like another by chance, a stretch of the way hardly
        if any(c.is_indistinct for c in chosen) and (
            len(views) < rules.n_stretch or max(views) - min(views) < 2 * rules.n_stretch
        ):
            return False
        others = np.array([k for k in range(len(group)) if k not in set(members.tolist())])
        if not len(others):
            return True
        rival = largest_clique(agrees[np.ix_(others, others)])
        return len(chosen) >= rules.margin * len(rival)

    def _is_outweighed(self, members: np.ndarray, group: list[Closure], chain: Chain) -> bool:
        """Return whether what the graph contradicts is contradicted as well by matches that lie where the graph expects them."""
        chosen = [group[k] for k in members.tolist()]
        if not any(c.is_doubtful and not c.is_accepted for c in chosen):
            return False
        of_set = set(members.tolist())
        likely = [c for k, c in enumerate(group) if k not in of_set and not c.is_doubtful]
        n = len(chosen)
        distances = self._distances([*chosen, *likely], chain, np.inf)[n:, :n]
        excludes = (distances > self._config.closures.gate).mean(axis=1) > 0.5
        return len({c.j for c, is_against in zip(likely, excludes, strict=True) if is_against}) >= 2

    def _agreements(self, group: list[Closure], chain: Chain) -> Bools:
        """Return (n, n) whether the cycle through two closures closes within its covariance."""
        rules = self._config.closures
        return np.asarray(self._distances(group, chain, rules.certain_m) < rules.gate)

    def _distances(self, group: list[Closure], chain: Chain, known: float) -> Floats:
        """Return (n, n) by how much the cycle through two closures does not close; see :func:`cycle_distances`."""
        ends = np.array([(c.i, c.j) for c in group], dtype=np.int64)
        measured = np.array([c.pose for c in group])
        covariances = np.array([c.covariance for c in group])
        # edges between two keyframes usually err by this
        floor = np.diagonal(self._config.noise.floor).copy()
        step = self._config.keyframes.distance
        return cycle_distances(ends, measured, covariances, chain.poses, chain.gathered, floor, step, known)
