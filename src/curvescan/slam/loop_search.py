"""LoopSearch: which keyframes are matched with each other, and which of the matches become loop closures.

A new keyframe queues the earlier ones that may show its place; a few are matched with each scan. What agrees with where
the graph surely expects it is accepted, what the graph does not know waits for others that agree.
"""

from __future__ import annotations

from collections import deque
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam.config import SlamConfig
from curvescan.slam.growing_map import GrowingMap
from curvescan.slam.loops.agreement import best_group, log_odds_of
from curvescan.slam.loops.audit import N_NEAR, Contradiction, contradictions, groups_against
from curvescan.slam.loops.candidates import choose_candidates
from curvescan.slam.loops.closures import Closure, ClosureOutcome, closure_of, is_certain, is_loop, is_near
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
    is_urgent : bool
        Whether the graph is to be optimized at once, for the closures since :meth:`settle`.
    """

    def __init__(self, growing: GrowingMap, config: SlamConfig) -> None:
        self.config = config
        self.closures: list[Closure] = []
        self.is_urgent = False
        self._map = growing
        self._queue: deque[Candidate] = deque()
        self._tried: dict[int, set[int]] = {}  # by the number of each keyframe those of others
        self._pool: list[Closure] = []  # by row: those that wait, and those accepted, which speak against others

    def settle(self) -> None:
        """Forget that the graph is to be optimized: it is under way."""
        self.is_urgent = False

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
        """Match all that is queued: no further view will come."""
        while self._queue:
            self._try(self._queue.popleft(), index)

    def densify(self, index: int) -> None:
        """Match each keyframe with the nearest others that it is not tied to."""
        graph, fragments = self._map.graph, np.array(self._map.fragments)
        self._forget_untied()
        poses = graph.poses
        for k in range(1, graph.n_poses):
            relative = se2.between(poses[:k], poses[k])
            relative[fragments[:k] != fragments[k], 0] = np.inf
            cov = np.broadcast_to(self.config.noise.spread, (k, 3, 3))
            for i in choose_candidates(relative, cov, self.config, self._map.keyframes):
                self._try(Candidate(i, k, UncertainPose(relative[i], cov[i])), index, is_known=True)

    def _forget_untied(self) -> None:
        """Forget matches of keyframes that no edge ties: where the map is known now, the match is another one."""
        numbers, graph = self._map.keyframes.numbers, self._map.graph
        self._tried = {number: set() for number in numbers.tolist()}
        for one, other in numbers[graph.ends].tolist():
            self._tried[one].add(other)
            self._tried[other].add(one)

    def audit(self) -> list[tuple[list[Closure], float]]:
        """Return groups of matches against the map, by row, and the odds of each less those of what it contradicts."""
        growing, chain, followed = self._map, self._map.chain(), self._edges(is_followed=True)
        tried = {(c.i, c.j): c for c in self._by_row() if c.is_loop}  # the latest of each pair
        known = [c for pair, c in tried.items() if pair in followed]
        refused = [
            c
            for pair, c in tried.items()
            if pair not in followed and c.is_whole and is_near(UncertainPose(c.pose, c.covariance), self.config)
        ]
        found = []
        for group in groups_against(refused, growing.graph.poses, self.config):
            near = [c for c in known if min(max(abs(c.i - one.i), abs(c.j - one.j)) for one in group) <= N_NEAR]
            found.append((group, log_odds_of(group, near, chain, self.config)))
        return found

    def _edges(self, *, is_followed: bool) -> set[tuple[int, int]]:
        """Return the ends of loop closures in the graph; is_followed: of those alone that have their weight."""
        graph = self._map.graph
        chosen = graph.is_closure & ((graph.weights > 0.5) | (not is_followed))
        return set(map(tuple, graph.ends[chosen].tolist()))

    def reopen(self, audited: list[tuple[list[Closure], float]]) -> bool:
        """Accept what contradicts the map and is likelier than what it contradicts; return whether any of it is new."""
        tied = self._edges(is_followed=False)
        new = [one for group, log_odds in audited if log_odds > 0.0 for one in group if (one.i, one.j) not in tied]
        for one in new:
            self._accept(replace(one, outcome=ClosureOutcome.AGREED))
        return len(new) > 0

    def contradictions(self, audited: list[tuple[list[Closure], float]]) -> list[Contradiction]:
        """Return what contradicts the map as it was audited, of what is likelier than the closures against it."""
        likely = [group for group, log_odds in audited if log_odds > 0.0]
        return contradictions(likely, self._map.graph.poses, self._map.keyframes.numbers)

    def _by_row(self) -> list[Closure]:
        """Return the records of keyframes that are still there, by row."""
        row_of = {number: row for row, number in enumerate(self._map.keyframes.numbers.tolist())}
        return [replace(c, i=row_of[c.i], j=row_of[c.j]) for c in self.closures if c.i in row_of and c.j in row_of]

    def _try(self, candidate: Candidate, index: int, *, is_known: bool = False) -> list[Closure]:
        """Match a candidate unless it was, and return the closures accepted; is_known: no others will come to agree."""
        i, j, _ = candidate
        if not self._is_new(i, j):
            return []
        poses = self._map.graph.poses
        cov = candidate.expected.cov + self.config.noise.spread
        expected = UncertainPose(se2.between(poses[i], poses[j]), cov)
        prior = expected if is_certain(expected, self.config) else None
        result = self._map.keyframes.match(i, j, prior)
        closure = closure_of(result, expected, self.config, scan=index, i=i, j=j)
        if closure.is_accepted:
            # where the guess decided between several poses the match says no more than the graph did
            if is_loop(i, j) and not result.is_guess_decisive and result.degenerate_direction is None:
                self._remember(closure)
            return [self._accept(closure)]
        if closure.outcome is ClosureOutcome.WAITING:
            if is_known or not is_near(expected, self.config):
                closure = replace(closure, outcome=ClosureOutcome.UNEXPECTED)
            else:
                return self._wait(closure)
        self._log(closure)
        return []

    def _remember(self, closure: Closure) -> None:
        self._pool.append(closure)
        del self._pool[: -self.config.closures.n_waiting]

    def _wait(self, closure: Closure) -> list[Closure]:
        """Hold a closure against others, and return those whose odds now exceed those of what they contradict."""
        self._remember(closure)
        pool = [c for c in self._pool if abs(c.j - closure.j) <= N_NEAR and c is not closure] + [closure]
        rules = self.config.closures
        group, against = best_group(pool, self._map.chain(), self.config, rules.certain_m)
        if group.log_odds - max(against, 0.0) <= rules.log_odds:
            self._log(closure)
            return []
        agreed = [replace(pool[k], outcome=ClosureOutcome.AGREED) for k in group.members if not pool[k].is_accepted]
        pairs = {(c.i, c.j) for c in agreed}
        self._pool = [c for c in self._pool if (c.i, c.j) not in pairs] + agreed
        return [self._accept(one) for one in agreed]

    def _is_new(self, i: int, j: int) -> bool:
        """Return whether two keyframes have not been matched, and remember that they are now."""
        one, other = (self._map.keyframes[k].number for k in (i, j))
        tried = self._tried.setdefault(one, set())
        if other in tried:
            return False
        tried.add(other)
        self._tried.setdefault(other, set()).add(one)
        return True

    def _accept(self, closure: Closure) -> Closure:
        """Make a closure an edge of the map, and return its record."""
        self._map.close(closure)
        if closure.outcome is ClosureOutcome.AGREED:
            self.is_urgent = True
        return self._log(closure)

    def _log(self, closure: Closure) -> Closure:
        """Keep a record of a candidate and return it: by the numbers of its keyframes, which stay when others go."""
        i, j = (self._map.keyframes[k].number for k in (closure.i, closure.j))
        record = replace(closure, i=i, j=j)
        self.closures.append(record)
        return record

    def forget(self) -> None:
        """Drop the oldest records of candidates."""
        del self.closures[: -self.config.places.n_logged]

    def renumber(self, is_kept: Bools, gone: list[int]) -> None:
        """Count the keyframes anew after some went; is_kept: which rows stay; gone: numbers of the others."""
        for one in gone:
            for other in self._tried.pop(one, ()):
                self._tried[other].discard(one)
        row_of = np.where(is_kept, np.cumsum(is_kept) - 1, -1)
        at = row_of.tolist()
        self._queue = deque(Candidate(at[c.i], at[c.j], c.expected) for c in self._queue if at[c.i] >= 0)
        self._pool = [replace(c, i=at[c.i], j=at[c.j]) for c in self._pool if at[c.i] >= 0 and at[c.j] >= 0]
