"""LoopSearch: which keyframes are matched with each other, and which of the matches become loop closures.

A new keyframe queues the earlier ones that may show its place; a few are matched with each scan. What agrees with where
the graph surely expects it is accepted, what the graph does not know waits for others that agree.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterator
from dataclasses import replace
from itertools import chain, groupby, zip_longest
from typing import Any, NamedTuple, TypeAlias

import numpy as np

from curvescan import se2
from curvescan.matchers.result import WIDE_PRIOR
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam.config import SlamConfig
from curvescan.slam.growing_map import GrowingMap
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.loops.agreement import best_group
from curvescan.slam.loops.audit import N_NEAR, Contradiction, cost_of, is_refused, sets_against
from curvescan.slam.loops.closures import Closure, ClosureOutcome, closure_of, is_certain, is_loop
from curvescan.slam.loops.overlap import predicted_overlap
from curvescan.slam.open_direction import n_through, placed
from curvescan.slam.pose_graph.graph import is_whole
from curvescan.slam.pose_graph.robust import optimized
from curvescan.types import Bools, Cov, Floats, Ints, Pose, with_fields

N_LINKED = 3  # preceding keyframes that a new one is matched with
_SIGMAS = 5.0  # standard deviations that a keyframe may lie from where the graph has it: slips go far
_MIN_SIMILARITY = 0.8  # least similarity by the place index of keyframes of a vague relative pose
_N_LOGGED = 50_000  # pairs of keyframes whose match is kept, the latest
_FARTHEST = 6.0  # keyframes of a known relative pose are matched up to here, metres: opposite views share least nearby
_N_DOUBLED = 8  # keyframes in a row that mostly fail, less those that mostly match: 2 on good maps, 8 on torn ones
_THROUGH = 0.1  # share of their readings that views of different places see through, at least

_N_CERTAIN, _N_UNCERTAIN, _N_BESIDE = 5, 6, 2
"""Most keyframes that one is matched with: of a known relative pose, of an unknown one, beside a closure that waits."""


class Candidate(NamedTuple):
    """Two keyframes to be matched, and how well the graph knows j in the frame of i."""

    i: int
    j: int
    covariance: Cov
    asked: Pose | None = None  # (3,): j in the frame of i by another match, which says nothing for itself
    is_apart: bool = False  # whether the track was lost between the two, and no match has tied them since


Beside: TypeAlias = Callable[..., Callable[[], Any]]
"""Calls a function in another process, where there is one; what it returns gives the result."""


class LoopSearch:
    """The search for loop closures in a map that grows."""

    def __init__(self, growing: GrowingMap) -> None:
        self._map, self.config = growing, growing.config
        self.closures: dict[tuple[int, int], Closure] = {}  # the last match of each two keyframes, by their numbers
        self.is_urgent = False  # whether a loop closed that the graph did not expect: to be optimized at once
        self._queue: deque[Candidate] = deque()
        self._pool: list[Closure] = []  # by row: those that wait, and those accepted, which speak against others

    def enqueue(self, k: int) -> None:
        """Queue the keyframes that the newest one, of row k, is to be matched with."""
        growing, keyframes, profiles = self._map, self._map.keyframes, self._map.keyframes.profiles.array
        fragments, first = growing.fragments, max(k - N_LINKED, 0)
        chosen = [Candidate(i, k, way.covariance) for i, way in enumerate(growing.along(first)[:-2], first)]
        poses, alike = growing.graph.poses, keyframes.index.similarity(keyframes.index.array[k])
        # what is known of a relative pose is costly: not of what lies afar and looks different
        rows = (alike >= _MIN_SIMILARITY) | (np.hypot(*(poses[:, :2] - poses[k, :2]).T) < _FARTHEST)
        rows = np.flatnonzero(rows[:k])
        seen, is_apart = growing.seen_from(rows), np.array([fragments[i] != fragments[k] for i in rows.tolist()], bool)
        chosen += choose_candidates(k, rows, seen, self.config, profiles, alike[rows], is_apart)
        if waiting := [c for c in self._pool if not c.is_accepted and k - c.j <= N_NEAR]:
            asked = self._beside(max(waiting, key=lambda c: c.log_odds + c.expectation), k)
            chosen += [c for c in asked if c.i not in {other.i for other in chosen}]
        self._queue += [c._replace(is_apart=fragments[c.i] != fragments[k]) for c in chosen]

    def _beside(self, waiting: Closure, k: int) -> list[Candidate]:
        """Return keyframes that see what one of row k does if a closure that waits, where nobody looks, is right."""
        growing, poses, rows = self._map, self._map.graph.poses, np.arange(k)
        here = se2.compose(se2.compose(poses[waiting.i], waiting.pose), se2.between(poses[waiting.j], poses[k]))
        if not self.config.keyframes.is_far(se2.between(poses[k], here)):
            return []
        found = self._overlapping(k, rows, se2.between(poses[rows], here))[:_N_BESIDE]
        chosen = np.array(sorted(c.i for c in found), dtype=np.int64)
        covariances, asked = growing.seen_from(chosen)[1], se2.between(poses[chosen], here)
        return [Candidate(i, k, cov, pose) for i, cov, pose in zip(chosen.tolist(), covariances, asked, strict=True)]

    def _overlapping(self, k: int, rows: Ints, relative: Pose) -> list[Candidate]:
        """Return those of some keyframes that see what one of row k does, seen surely from them at relative (n, 3)."""
        cov = np.broadcast_to(self.config.noise.spread, (len(rows), 3, 3))
        return choose_candidates(k, rows, (relative, cov), self.config, self._map.keyframes.profiles.array)

    def work(self, index: int, n_most: int) -> list[Closure]:
        """Match so much of the queue with scan `index`, and return the closures accepted."""
        return [c for _ in range(min(n_most, len(self._queue))) for c in self._try(self._queue.popleft(), index)]

    def densify(self, index: int, beside: Beside) -> None:
        """Match each keyframe with the nearest others that it is not tied to, half of the matches beside.

        Also those that were matched before: where the map is known now, the matches are others. Those that left a way
        open are left out, as they would keep better ones of their keyframes away; of direct neighbours for good.
        """
        from scipy.spatial import cKDTree  # loads for a good part of a second

        graph = self._map.graph
        graph.keep_edges(~graph.is_closure | is_whole(graph.edge_covariances))
        tied, fragments, poses, new = self._tied(), np.array(self._map.fragments), graph.poses, []
        places = cKDTree(poses[:, :2])
        for k in range(1, graph.n_poses):
            rows = np.sort(places.query_ball_point(poses[k, :2], _FARTHEST))
            rows = rows[(rows < k) & (fragments[rows] == fragments[k])]
            chosen = self._overlapping(k, rows, se2.between(poses[rows], poses[k]))
            new += [c for c in chosen if (c.i, c.j) not in tied]
        given = self._map.keyframes, poses, self.config, index  # an optimization was last: none moves another one
        others, found = beside(matched, *given, new[1::2]), matched(*given, new[::2])
        for closure in filter(None, chain.from_iterable(zip_longest(found, others()))):
            if closure.outcome is ClosureOutcome.WAITING:  # no others will come to agree with it
                closure = replace(closure, outcome=ClosureOutcome.UNEXPECTED)
            self._accept(closure) if closure.is_accepted else self._log(closure)

    def audit(self) -> bool:
        """Accept sets of matches that say more against the map than it costs to follow them; return whether any do."""
        graph, tied, alone, is_opened = self._map.graph, self._tied(), None, False
        found = {(c.i, c.j): c for c in self._latest() if c.outcome is not ClosureOutcome.NO_MATCH}
        found = {pair: c for pair, c in found.items() if pair not in tied}
        failing: dict[int, float] = {}
        for said, members in sets_against([*found.values()], graph.poses, self.config):
            if said <= self.config.closures.log_odds:
                break  # nor do the others say more
            alone = alone or optimized(graph, weights=graph.weights)
            failing = failing or {j: 2.0 * len(refused) / n - 1.0 for j, n, refused in self._failing()}
            # what fails where the map has these keyframes speaks against it too
            failed = sum(failing.get(j, 0.0) for j in {c.j for c in members})
            if said + max(failed, 0.0) > cost_of(members, graph, alone.costs):
                alone, is_opened = None, True
                for one in members:
                    self._accept(replace(found[one.i, one.j], outcome=ClosureOutcome.AGREED))
        return is_opened

    def doubled(self) -> tuple[Contradiction, ...]:
        """Return the matches that fail where a map shows places twice; none where most do not for some way."""
        excess, most, run, longest = 0.0, 0.0, list[Closure](), list[Closure]()
        for _, n, refused in self._failing():
            # in alike or round rooms they fail on a right map too, and count for neither
            failed = [c for c in refused if self._is_seen_through(c.i, c.j)]
            excess += (len(failed) + len(refused) - n) / n
            excess, run = (excess, run + failed) if excess > 0.0 else (0.0, [])
            most, longest = (excess, run) if excess > most else (most, longest)
        if most < _N_DOUBLED:
            return ()
        ends, poses = np.array([(c.i, c.j) for c in longest]), self._map.graph.poses
        return (Contradiction(place=poses[ends[:, 1], :2].mean(axis=0), pairs=self._map.keyframes.numbers[ends]),)

    def _failing(self) -> Iterator[tuple[int, int, list[Closure]]]:
        """Yield keyframes that the map shows again, the number of their matches there, and those that fail."""
        poses = self._map.graph.poses
        for j, tried in groupby(sorted(self._latest(), key=lambda c: (c.j, c.i)), key=lambda c: c.j):
            of = {c.i: c for c in tried}
            rows = np.array([*of])
            seen = [of[c.i] for c in self._overlapping(j, rows, se2.between(poses[rows], poses[j]))]
            if seen:
                yield j, len(seen), [c for c in seen if is_refused(c, poses, self.config)]

    def _is_seen_through(self, i: int, j: int) -> bool:
        """Return whether of two keyframes, where the map has them, one sees through what the other one sees."""
        keyframes, poses = self._map.keyframes, self._map.graph.poses
        n = n_through(keyframes[i].scan, keyframes[j].scan, se2.between(poses[[i]], poses[[j]]))
        return bool(n[0] > _THROUGH * min(np.count_nonzero(keyframes[k].scan.valid) for k in (i, j)))

    def _tied(self) -> set[tuple[int, int]]:
        """Return the keyframes, by row, that have an edge."""
        return {(i, j) for i, j in np.sort(self._map.graph.ends).tolist()}

    def _latest(self) -> list[Closure]:
        """Return the last match of each two keyframes of a part of the map that close a loop, by row."""
        row_of = {number: row for row, number in enumerate(self._map.keyframes.numbers.tolist())}
        latest = (c for c in self.closures.values() if c.i in row_of and c.j in row_of)
        by_row = (replace(c, i=row_of[c.i], j=row_of[c.j]) for c in latest)
        return [c for c in by_row if c.is_loop and self._map.fragments[c.i] == self._map.fragments[c.j]]

    def _try(self, candidate: Candidate, index: int) -> list[Closure]:
        """Match a candidate, and return the closures accepted."""
        [closure] = matched(self._map.keyframes, self._map.graph.poses, self.config, index, [candidate])
        is_waiting = closure.outcome is ClosureOutcome.WAITING
        if is_waiting or (closure.is_accepted and is_loop(closure.i, closure.j)):
            # those farther off along the path speak neither for it nor against it
            self._pool = [c for c in self._pool if abs(c.j - closure.j) <= N_NEAR] + [closure]
        if closure.is_accepted:
            return [self._accept(closure)]
        self._log(closure)
        # one that waits brings in those that agree, if their odds exceed those of what they contradict
        members, lead = best_group(self._pool, self._map.chain(), self.config) if is_waiting else ([], 0.0)
        if lead <= self.config.closures.log_odds:
            return []
        waiting = [k for k in members if not self._pool[k].is_accepted]
        for k in waiting:
            self._pool[k] = replace(self._pool[k], outcome=ClosureOutcome.AGREED)
        return [self._accept(self._pool[k]) for k in waiting]

    def _accept(self, closure: Closure) -> Closure:
        """Make a closure an edge of the map, and return its record."""
        pose, cov = closure.place or (closure.pose, closure.covariance)
        self._map.close(replace(closure, pose=pose, covariance=cov))
        self.is_urgent |= closure.outcome is ClosureOutcome.AGREED
        return self._log(closure)

    def _log(self, closure: Closure) -> Closure:
        """Keep a record of a candidate and return it: by the numbers of its keyframes, which stay when others go."""
        i, j = (self._map.keyframes[k].number for k in (closure.i, closure.j))
        record = self.closures[i, j] = replace(closure, i=i, j=j)
        if len(self.closures) > _N_LOGGED:
            del self.closures[next(iter(self.closures))]
        return record

    def renumber(self, is_kept: Bools) -> None:
        """Count the keyframes anew after some went; is_kept: which rows stayed."""
        at = np.where(is_kept, np.cumsum(is_kept) - 1, -1).tolist()
        self._queue = deque(c._replace(i=at[c.i], j=at[c.j]) for c in self._queue if min(at[c.i], at[c.j]) >= 0)
        self._pool = [replace(c, i=at[c.i], j=at[c.j]) for c in self._pool if min(at[c.i], at[c.j]) >= 0]


def matched(keyframes: Keyframes, poses: Pose, config: SlamConfig, index: int, new: list[Candidate]) -> list[Closure]:
    """Return the matches of candidates, by row, and whether each is likely enough alone; poses (n, 3)."""
    found = []
    for i, j, covariance, asked, is_apart in new:
        expected = UncertainPose(se2.between(poses[i], poses[j]), covariance + config.noise.spread)
        # where it went on a guided match lies in any case: that would be no evidence that it did
        known = expected if is_certain(expected, config) and not is_apart else None
        guess = known if asked is None else UncertainPose(asked, WIDE_PRIOR.covariance)
        result = keyframes.match(i, keyframes.prepared(j), guess)
        along = result.degenerate_direction
        if result.is_guess_decisive and along is None and is_loop(i, j):  # several places explain them: it is open
            along = np.array([*np.linalg.eigh(result.covariance[:2, :2])[1][:, 1], 0.0])
            result = with_fields(result, degenerate_direction=along)
        views = keyframes.prepared(i).scan, keyframes.prepared(j).scan
        closure = closure_of(result, expected, config, *views, scan=index, i=i, j=j, is_apart=is_apart)
        if guess and closure.is_accepted and closure.is_loop and along is not None:  # neighbours in a row err alike
            closure = replace(closure, place=placed(UncertainPose(closure.pose, closure.covariance), along, *views))
        found.append(closure)
    return found


def choose_candidates(
    newest: int, rows: Ints, seen: tuple[Pose, Cov], config: SlamConfig, profiles: Floats,
    alike: Floats | None = None, is_apart: Bools | bool = False,
) -> list[Candidate]:  # fmt: skip
    """Return the keyframes to match with the newest one, the most promising first.

    rows (n,) rising: of those that may lie near; seen: (n, 3) and (n, 3, 3), the newest one from them; profiles: of
    all; alike (n,): similarity to the newest one; without it those of a known relative pose alone; is_apart (n,): where
    the track was lost between them.
    """
    rules, (relative, covariances) = config.closures, seen
    sigma = np.sqrt(np.diagonal(covariances + config.noise.spread, axis1=1, axis2=2)[:, :2].max(axis=1))
    distance = np.hypot(relative[:, 0], relative[:, 1])
    is_certain = sigma < rules.certain_m
    is_near = (distance - _SIGMAS * sigma < rules.reach) | (is_certain & (distance < _FARTHEST))
    is_near &= rows < newest - 1 - N_LINKED  # nor the one before those, which sees what they do
    sure = np.flatnonzero(is_near & is_certain)
    overlap = predicted_overlap(profiles, rows[sure], relative[sure], profiles[newest], rules.min_overlap)
    sure, overlap = sure[overlap >= rules.min_overlap], overlap[overlap >= rules.min_overlap]
    chosen = sure[np.argsort(-overlap, kind="stable")][:_N_CERTAIN].tolist()
    if alike is not None:
        vague = np.flatnonzero(((is_near & ~is_certain) | is_apart) & (alike >= _MIN_SIMILARITY))
        chosen += vague[np.argsort(-alike[vague], kind="stable")][:_N_UNCERTAIN].tolist()
    return [Candidate(int(rows[n]), newest, covariances[n]) for n in chosen]
