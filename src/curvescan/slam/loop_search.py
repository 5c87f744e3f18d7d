"""LoopSearch: which keyframes are matched with each other, and which of the matches become loop closures.

A new keyframe queues the earlier ones that may show its place; a few are matched with each scan. What agrees with where the graph surely
expects it is accepted, what the graph does not know waits for others that agree.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan.matchers import MatchResult
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam.config import SlamConfig
from curvescan.slam.growing_map import GrowingMap
from curvescan.slam.loops.agreement import Waiting
from curvescan.slam.loops.audit import Contradiction, contradictions
from curvescan.slam.loops.bending import suspects
from curvescan.slam.loops.candidates import choose_candidates
from curvescan.slam.loops.closures import UNKNOWN_M, Closure, ClosureOutcome, is_certain, judged, vaguely
from curvescan.types import Bools


class Candidate(NamedTuple):
    """Two keyframes to be matched, and where the graph expects j in the frame of i."""

    i: int
    j: int
    expected: UncertainPose


class LoopSearch:
    """The search for loop closures in a map that grows.

    Attributes
    ----------
    closures : list of Closure
        Candidates that were matched, and what became of them, by the numbers of their keyframes.
    n_withdrawals : int
        How often closures were withdrawn.
    is_urgent, is_surprised : bool
        Whether the graph is to be optimized at once, or soon, for the closures since :meth:`settle`.
    """

    def __init__(self, growing: GrowingMap, config: SlamConfig) -> None:
        self.config = config
        self.closures: list[Closure] = []
        self.n_withdrawals = 0
        self.is_urgent = self.is_surprised = False
        self._map = growing
        self._queue: deque[Candidate] = deque()
        self._tried: dict[int, set[int]] = {}  # by the number of each keyframe those of others
        self._waiting = Waiting(config)
        self._missed: dict[int, int] = {}  # of the keyframe tried last
        self._refused: list[Closure] = []  # in the last pass, by row

    def settle(self) -> None:
        """Forget that the graph is to be optimized: it is under way."""
        self.is_urgent = self.is_surprised = False
        self._waiting.optimize()

    def adopt(self) -> None:
        """Let the graph speak for the closures that the optimization knew: it is done."""
        self._waiting.adopt()

    def enqueue(self, k: int) -> None:
        """Queue the keyframes that the newest one, of row k, is to be matched with."""
        growing, keyframes = self._map, self._map.keyframes
        linked = [
            i
            for i in range(max(k - self.config.keyframes.n_linked, 0), k - 1)
            if growing.fragments[i] == growing.fragments[k]
        ]
        for i in linked:
            self._queue.append(Candidate(i, k, growing.along(i, k)))
        relative, covariances = growing.belief.seen_from_all(
            growing.graph.poses[: k + 1], growing.since, growing.current
        )
        similarity = keyframes.index.similarity(keyframes.signature(keyframes.prepared(k)))
        chosen = choose_candidates(relative, covariances, self.config, keyframes, similarity[:k])
        for i in chosen:
            expected = UncertainPose(relative[i], covariances[i])
            self._queue.append(Candidate(i, k, expected))

    def work(self, index: int) -> list[Closure]:
        """Match the share of the queue that is due with scan `index`, and return the closures accepted."""
        accepted: list[Closure] = []
        for _ in range(min(self.config.closures.matches_per_scan, len(self._queue))):
            accepted += self._try(self._queue.popleft(), index)
        return accepted

    def finish(self, index: int) -> None:
        """Match all that is queued, and accept what agrees: no further view will come."""
        while self._queue:
            self._try(self._queue.popleft(), index)
        if self.n_withdrawals == 0:
            for one in self._waiting.conclude(self._map.chain()):
                self._accept(one)

    def densify(self, index: int) -> None:
        """Match each keyframe with the nearest others that it has not been matched with."""
        graph, fragments = self._map.graph, np.array(self._map.fragments)
        poses = graph.poses
        for k in range(1, graph.n_poses):
            relative = se2.between(poses[:k], poses[k])
            relative[fragments[:k] != fragments[k], 0] = np.inf
            cov = np.broadcast_to(4.0 * self.config.noise.floor, (k, 3, 3))
            for i in choose_candidates(relative, cov, self.config, self._map.keyframes):
                self._try(Candidate(i, k, UncertainPose(relative[i], cov[i])), index, self._refused)

    def contradictions(self) -> list[Contradiction]:
        """Return which matches of the last pass contradict the map as it is now."""
        growing = self._map
        return contradictions(self._refused, growing.graph.poses, growing.keyframes.numbers, self.config)

    def _try(self, candidate: Candidate, index: int, refused: list[Closure] | None = None) -> list[Closure]:
        """Match a candidate unless it was, and return the closures that are accepted for it; take down those refused."""
        i, j, _ = candidate
        if not self._is_new(i, j):
            return []
        poses = self._map.graph.poses
        expected = UncertainPose(se2.between(poses[i], poses[j]), candidate.expected.cov)
        expected = vaguely(expected, self.config)
        prior = expected if is_certain(expected, self.config) else None
        result = self._map.keyframes.match(i, j, prior)
        closure = judged(result, expected, self.config, scan=index, i=i, j=j)
        if prior is not None and not self._is_linked(i, j):
            self._count(j, is_found=closure.is_accepted)
        if closure.outcome is ClosureOutcome.WAITING:
            return self._wait(closure, expected)
        if closure.is_accepted:
            return self._confirm(closure, result)
        if closure.outcome is ClosureOutcome.UNEXPECTED and self._is_linked(i, j):
            self._map.doubt(j, expected.pose, closure.pose)
        if refused is not None and closure.outcome is ClosureOutcome.UNEXPECTED:
            refused.append(closure)
        self._log(closure)
        return []

    def _is_new(self, i: int, j: int) -> bool:
        """Return whether two keyframes have not been matched, and remember that they are now."""
        one, other = (self._map.keyframes[k].number for k in (i, j))
        tried = self._tried.setdefault(one, set())
        if other in tried:
            return False
        tried.add(other)
        self._tried.setdefault(other, set()).add(one)
        return True

    def _wait(self, closure: Closure, expected: UncertainPose) -> list[Closure]:
        """Hold a closure against others that wait, and return those that are accepted now."""
        # agreement means nothing where places look alike
        is_refused = self.n_withdrawals > 0
        is_unknown = bool(expected.cov[0, 0] > UNKNOWN_M**2)
        if is_refused or (is_unknown and not self._is_distinctive(closure.i, closure.j)):
            closure = replace(closure, is_indistinct=True)
            fragments = self._map.fragments
            if is_refused or fragments[closure.i] != fragments[closure.j]:
                self._log(replace(closure, outcome=ClosureOutcome.NOT_DISTINCTIVE))
                return []
        agreed = self._waiting.add(closure, self._map.chain())
        if not agreed:
            self._log(closure)
            return []
        return [self._accept(one) for one in agreed]

    def _confirm(self, closure: Closure, result: MatchResult) -> list[Closure]:
        """Accept a closure that lies where the graph expects it; others of its scans must agree with it."""
        accepted = self._accept(closure)
        # where the guess decided between several poses the match says no more than the graph did
        if not self._is_linked(closure.i, closure.j) and not result.is_guess_decisive:
            self._waiting.confirm(closure)
        return [accepted]

    def _accept(self, closure: Closure) -> Closure:
        """Make a closure an edge of the map, and return its record."""
        self._map.close(closure)
        if closure.outcome is ClosureOutcome.AGREED:
            self.is_urgent = True
        elif closure.distance > self.config.optimizer.surprise:
            self.is_surprised = True
        return self._log(closure)

    def _is_distinctive(self, i: int, j: int) -> bool:
        """Return whether keyframe j looks like the place of i and like no other place of that fragment."""
        poses, rules, keyframes = self._map.graph.poses, self.config.closures, self._map.keyframes
        fragments = self._map.fragments
        likeness = keyframes.index.similarity(keyframes.signature(keyframes.prepared(j)))
        from_i = np.hypot(*(poses[:, :2] - poses[i, :2]).T)
        is_there = from_i < rules.reach
        elsewhere = (from_i > 1.2 * rules.reach) & (np.asarray(fragments) == fragments[i])
        if fragments[i] == fragments[j]:
            elsewhere &= np.hypot(*(poses[:, :2] - poses[j, :2]).T) > 1.2 * rules.reach
        least = float(likeness[is_there].max())
        return float(likeness[elsewhere].max(initial=0.0)) < rules.distinctive * least

    def _is_linked(self, i: int, j: int) -> bool:
        return j - i <= self.config.keyframes.n_linked

    def _count(self, j: int, *, is_found: bool) -> None:
        """Count how keyframe j fares with earlier ones that should show its place; if none does, the graph is in doubt."""
        n_missed = self._missed.get(j, 0)
        self._missed = {j: -1000 if is_found else n_missed + 1}
        if self._missed[j] == self.config.closures.n_missed:
            self._map.widen(j, self.config.noise.doubt)

    def _log(self, closure: Closure) -> Closure:
        """Keep a record of a candidate and return it: by the numbers of its keyframes, which stay when others go, in place of their rows."""
        i, j = (self._map.keyframes[k].number for k in (closure.i, closure.j))
        record = replace(closure, i=i, j=j)
        self.closures.append(record)
        return record

    def forget(self) -> None:
        """Drop the oldest records of candidates."""
        del self.closures[: -self.config.places.n_logged]

    def renumber(self, is_kept: Bools, gone: list[int]) -> None:
        """Count the keyframes anew after some went; `is_kept` says which rows stay, `gone` are the numbers of the others."""
        for one in gone:
            for other in self._tried.pop(one, ()):
                self._tried[other].discard(one)
        row_of = np.where(is_kept, np.cumsum(is_kept) - 1, -1)
        at = row_of.tolist()
        self._queue = deque(Candidate(at[c.i], at[c.j], c.expected) for c in self._queue if at[c.i] >= 0)
        self._missed = {at[j]: n for j, n in self._missed.items() if at[j] >= 0}
        self._waiting.renumber(row_of)

    def withdraw(self) -> Bools:
        """Take back the closures that bend the odometry, and return (m,) which edges of the graph stay."""
        rows = suspects(self.closures, self.config.keyframes.n_linked, all_of_them=self.n_withdrawals > 0)
        self.n_withdrawals += 1
        for row in rows:
            self.closures[row] = replace(self.closures[row], outcome=ClosureOutcome.WITHDRAWN)
        # what was carried over from keyframes that are gone has no record, and is not above suspicion either
        trusted = {(c.i, c.j) for c in self.closures if c.is_accepted}
        graph = self._map.graph
        ends = self._map.keyframes.numbers[graph.ends]
        is_kept = ~graph.is_closure | (ends < self._map.n_loaded).all(axis=1)
        is_kept |= np.array([tuple(pair) in trusted for pair in ends.tolist()])
        self._waiting = Waiting(self.config)
        self._queue.clear()
        return is_kept
