"""Backend: keyframes in, a pose graph that closes its loops out.

The state of SLAM but for the odometry. A keyframe is tied to the ones before it, candidates for loop closures are queued, a few of
them are matched with each scan, and accepted matches become edges; an optimization runs beside.
"""

from __future__ import annotations

from collections import deque
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from curvescan import se2
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose, compose, fuse, identity, inverse
from curvescan.slam.config import SlamConfig
from curvescan.slam.jobs import Job, Problem, Solution, covariances_seen_from
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.loops.agreement import Waiting
from curvescan.slam.loops.belief import Belief
from curvescan.slam.loops.bending import bending, greatest_turn, suspects
from curvescan.slam.loops.candidates import choose_candidates
from curvescan.slam.loops.closures import (
    UNKNOWN_M,
    Closure,
    ClosureOutcome,
    is_certain,
    is_confident,
    judged,
    vaguely,
)
from curvescan.slam.map import SlamMap
from curvescan.slam.pose_graph.components import components
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph
from curvescan.slam.pose_graph.optimization import Edges
from curvescan.slam.pose_graph.removal import remove_poses
from curvescan.slam.thinning import Heirs, thin
from curvescan.types import Bools, Cov, Pose


def difference(one: Pose, other: Pose) -> Pose:
    """Return the second pose minus the first, angles wrapped."""
    off = other - one
    off[2] = se2.wrap(off[2])
    return off


class Candidate(NamedTuple):
    """Two keyframes to be matched, and where the graph expects j in the frame of i."""

    i: int
    j: int
    expected: UncertainPose


class Backend:
    """The graph, its keyframes, and the search for loop closures.

    Parameters
    ----------
    keyframes : Keyframes
        Where keyframes are kept.
    config : SlamConfig
        The rules.
    """

    def __init__(self, keyframes: Keyframes, config: SlamConfig) -> None:
        self.config = config
        self.keyframes = keyframes
        self.graph = PoseGraph()
        self.current = 0
        self.since = identity()  # the current keyframe seen from the one of the belief
        self.closures: list[Closure] = []
        self.n_withdrawals = 0
        self._belief: Belief | None = None
        self._queue: deque[Candidate] = deque()
        self._tried: set[tuple[int, int]] = set()
        self.heirs = Heirs()
        self._waiting = Waiting(config)
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="curvescan-slam")
        self._job: Job | None = None
        self._job_due = 0
        self._is_dirty = self._is_urgent = False
        self._n_scans = 0
        self._fragments: list[int] = []  # of each keyframe
        self._missed: dict[int, int] = {}  # of the keyframe tried last
        self._n_loaded = 0  # keyframes of a map that is continued
        self._motions: list[UncertainPose] = []  # each keyframe seen from the one before

    @property
    def belief(self) -> Belief:
        """What the graph knew after the last optimization."""
        assert self._belief is not None, "there is no keyframe yet"
        return self._belief

    def load(self, slam_map: SlamMap) -> None:
        """Take a map to continue."""
        self._n_loaded = len(slam_map)
        for k in range(len(slam_map)):
            index, session = int(slam_map.indices[k]), int(slam_map.sessions[k])
            self.keyframes.add(slam_map.scans[k], index, session)
            self.graph.add_pose(slam_map.poses[k])
            self._motions.append(identity())
        for k in range(len(slam_map.ends)):
            i, j = slam_map.ends[k].tolist()
            self.graph.add_edge(
                i, j, slam_map.measured[k], slam_map.edge_covariances[k],
                EdgeKind(int(slam_map.kinds[k])), float(slam_map.weights[k]),
            )  # fmt: skip
        self._fragments = components(self.graph.ends, self.graph.n_poses).tolist()

    def start(self, scan: LaserScan, index: int, pose: Pose, session: int = 0) -> int:
        """Begin a fragment: take a keyframe that nothing ties to those before it, and return its number.

        Parameters
        ----------
        scan : LaserScan
            Its scan, deskewed.
        index : int
            Its number in the stream.
        pose : (3,) float64
            Where to draw it until a loop closure says how it lies to the rest.
        session : int
            Number of the session.
        """
        if self._job is not None:
            self._adopt(self._job.result(), self._job)
            self._job = None
        k = self.keyframes.add(scan, index, session)
        self.graph.add_pose(pose)
        self._fragments.append(max(self._fragments, default=-1) + 1)
        self._belief = Belief.at_start(k, self.graph.poses)
        self.current, self.since = k, identity()
        self._motions.append(identity())
        if k > 0:
            self._enqueue(k)
        return k

    def add_keyframe(
        self, scan: LaserScan, index: int, motion: UncertainPose, *, is_measured: bool
    ) -> int:
        """Take the next keyframe and return its number.

        Parameters
        ----------
        scan : LaserScan
            Its scan, deskewed.
        index : int
            Its number in the stream.
        motion : UncertainPose
            Its pose in the frame of the current keyframe by the odometry.
        is_measured : bool
            Whether matches measured all of the motion.
        """
        before = self.current
        k = self.keyframes.add(scan, index, self.keyframes[before].session)
        self._fragments.append(self._fragments[before])
        motion = self._link(before, k, motion, is_measured)
        self._motions.append(motion)
        self.since = compose(self.since, motion)
        self.current = k
        self._enqueue(k)
        return k

    def _link(self, before: int, k: int, motion: UncertainPose, is_measured: bool) -> UncertainPose:
        """Tie a keyframe to the one before it, and return how it lies to that."""
        noise, rules = self.config.noise, self.config.closures
        self.graph.add_pose(se2.compose(self.graph.poses[before], motion.pose))
        x, y, theta = np.abs(motion.pose).tolist()
        vague = UncertainPose(
            motion.pose,
            motion.cov + noise.step * (1.0 + x * x + y * y + theta * theta),
        )
        self.graph.add_edge(before, k, motion.pose, vague.cov, EdgeKind.MOTION)
        result = self.keyframes.match(before, k, None)
        is_clear = result.ok and result.degenerate_direction is None
        if is_clear and is_confident(result, self.config):
            found = UncertainPose(result.pose, noise.edge(result.covariance))
            expected = UncertainPose(motion.pose, noise.drift**2 * motion.cov + 9.0 * noise.floor)
            if fuse(expected, found)[1] < rules.gate:
                self.graph.add_edge(before, k, found.pose, found.cov, EdgeKind.MATCH)
                return found
            off = difference(expected.pose, found.pose)
            motion = UncertainPose(motion.pose, motion.cov + self._doubt_of(off))
        if is_measured:
            by_chain = UncertainPose(motion.pose, motion.cov + noise.doubt)
            self.graph.add_edge(before, k, by_chain.pose, by_chain.cov, EdgeKind.MATCH)
            return by_chain
        return vague

    def add_prior(self, k: int, motion: UncertainPose) -> None:
        """Tie keyframe k to the one before it by a motion that wheels measured: an edge that may lose its weight."""
        self.graph.add_edge(k - 1, k, motion.pose, motion.cov, EdgeKind.PRIOR)

    def _enqueue(self, k: int) -> None:
        """Queue the keyframes that the newest one is to be matched with."""
        linked = [
            i
            for i in range(max(k - self.config.keyframes.n_linked, 0), k - 1)
            if self._fragments[i] == self._fragments[k]
        ]
        for i in linked:
            self._queue.append(Candidate(i, k, self._along(i, k)))
        relative, covariances = self.belief.seen_from_all(
            self.graph.poses[: k + 1], self.since, self.current
        )
        similarity = self.keyframes.index.similarity(
            self.keyframes.signature(self.keyframes.prepared(k))
        )
        chosen = choose_candidates(
            relative, covariances, self.config, self.keyframes, similarity[:k]
        )
        for i in chosen:
            expected = UncertainPose(relative[i], covariances[i])
            self._queue.append(Candidate(i, k, expected))

    def work(self, index: int) -> tuple[tuple[Closure, ...], bool]:
        """Do a bounded share of what waits, and return the closures accepted and whether poses were revised.

        Parameters
        ----------
        index : int
            Number of the scan.
        """
        self._n_scans += 1
        accepted: list[Closure] = []
        for _ in range(min(self.config.closures.matches_per_scan, len(self._queue))):
            accepted += self._try(self._queue.popleft(), index)
        is_revised = False
        if self._job is not None and self._n_scans >= self._job_due:
            self._adopt(self._job.result(), self._job)
            self._job, is_revised = None, True
            self._thin()
        if self._job is None and self._is_due():
            self._begin()
        return tuple(accepted), is_revised

    def _try(self, candidate: Candidate, index: int) -> list[Closure]:
        i, j, _ = candidate
        if (i, j) in self._tried:
            return []
        self._tried.add((i, j))
        expected = UncertainPose(
            se2.between(self.graph.poses[i], self.graph.poses[j]), candidate.expected.cov
        )
        expected = vaguely(expected, self.config)
        guess = expected.pose if is_certain(expected, self.config) else None
        result = self.keyframes.match(i, j, guess)
        closure = judged(result, expected, self.config, scan=index, i=i, j=j)
        if guess is not None and not self._is_linked(i, j):
            self._count(j, is_found=closure.is_accepted)
        is_waiting = closure.outcome is ClosureOutcome.WAITING
        if is_waiting and self.n_withdrawals:  # agreement means nothing where places look alike
            self._log(replace(closure, outcome=ClosureOutcome.NOT_DISTINCTIVE))
            return []
        is_unknown = bool(expected.cov[0, 0] > UNKNOWN_M**2)
        if is_waiting and is_unknown and not self._is_distinctive(i, j):
            self._log(replace(closure, outcome=ClosureOutcome.NOT_DISTINCTIVE))
            return []
        if is_waiting:
            agreed = self._waiting.add(closure, self.graph.poses)
            if not agreed:
                self._log(closure)
                return []
            agreed = [replace(c, outcome=ClosureOutcome.AGREED) for c in agreed]
            for one in agreed:
                self._accept(one)
            return [self._numbered(one) for one in agreed]
        if closure.is_accepted:
            self._accept(closure)
            # where the guess decided between several poses the match says no more than the graph did
            if not self._is_linked(i, j) and not result.is_guess_decisive:
                self._waiting.confirm(closure)
            return [self._numbered(closure)]
        if closure.outcome is ClosureOutcome.UNEXPECTED and self._is_linked(i, j):
            self._doubt(expected, closure)
        self._log(closure)
        return []

    def _is_distinctive(self, i: int, j: int) -> bool:
        """Return whether keyframe j looks like the place of i and like no other place of that fragment."""
        poses, rules = self.graph.poses, self.config.closures
        likeness = self.keyframes.index.similarity(
            self.keyframes.signature(self.keyframes.prepared(j))
        )
        from_i = np.hypot(*(poses[:, :2] - poses[i, :2]).T)
        is_there = from_i < rules.reach
        elsewhere = (from_i > 1.2 * rules.reach) & (
            np.asarray(self._fragments) == self._fragments[i]
        )
        if self._fragments[i] == self._fragments[j]:
            elsewhere &= np.hypot(*(poses[:, :2] - poses[j, :2]).T) > 1.2 * rules.reach
        least = float(likeness[is_there].max())
        return float(likeness[elsewhere].max(initial=0.0)) < rules.distinctive * least

    def _log(self, closure: Closure) -> None:
        """Keep a record of a candidate."""
        self.closures.append(self._numbered(closure))

    def _numbered(self, closure: Closure) -> Closure:
        """Return a closure by the numbers of its keyframes, which stay when others go, in place of their rows."""
        i, j = (self.keyframes[k].number for k in (closure.i, closure.j))
        return replace(closure, i=i, j=j)

    def _is_linked(self, i: int, j: int) -> bool:
        return j - i <= self.config.keyframes.n_linked

    def _doubt(self, expected: UncertainPose, closure: Closure) -> None:
        """Take the way between two keyframes to be as uncertain as two measurements of it differ."""
        off = difference(expected.pose, closure.pose)
        self._widen(closure.j, self._doubt_of(off))

    def _doubt_of(self, off: Pose) -> Cov:
        """Return the covariance of two measurements that differ, no more than that of no measurement."""
        noise = self.config.noise
        length, angle = float(np.hypot(off[0], off[1])), abs(float(off[2]))
        share = min(1.0, noise.step_m / max(length, 1e-9), noise.step_rad / max(angle, 1e-9))
        return share**2 * np.outer(off, off)

    def _widen(self, k: int, more: Cov) -> None:
        """Add to the covariance of the way to a keyframe."""
        self._motions[k] = UncertainPose(self._motions[k].pose, self._motions[k].cov + more)
        if not self.belief.knows(k):
            self.since = UncertainPose(self.since.pose, self.since.cov + more)

    def _count(self, j: int, *, is_found: bool) -> None:
        """Count how keyframe j fares with earlier ones that should show its place; if none does, the graph is in doubt."""
        n_missed = self._missed.get(j, 0)
        self._missed = {j: -1000 if is_found else n_missed + 1}
        if self._missed[j] == self.config.closures.n_missed:
            self._widen(j, self.config.noise.doubt)

    def _accept(self, closure: Closure) -> None:
        """Make a closure an edge, and take the newest keyframe to where it says."""
        self._log(closure)
        i, j = closure.i, closure.j
        if self._fragments[i] != self._fragments[j]:
            self._join(closure)
        self.graph.add_edge(i, j, closure.pose, closure.covariance, EdgeKind.CLOSURE)
        if closure.outcome is ClosureOutcome.AGREED:
            self._is_urgent = True
        elif closure.distance > self.config.optimizer.surprise:
            self._is_dirty = True
        if not self.belief.knows(i) or self.belief.knows(j):
            return
        by_closure = compose(
            inverse(self.belief.last_seen_from(i)), UncertainPose(closure.pose, closure.covariance)
        )
        self.since, _ = fuse(self.since, compose(by_closure, self._along(j, self.current)))
        here = se2.compose(self.graph.poses[self.belief.k], self.since.pose)
        onward = se2.between(self.graph.poses[self.current], self.graph.poses[j:])
        self.graph.poses[j:] = se2.compose(here, onward)

    def _join(self, closure: Closure) -> None:
        """Move the later fragment to where a closure says that it lies in the earlier one."""
        fragments = np.array(self._fragments)
        earlier, later = sorted((fragments[closure.i], fragments[closure.j]))
        poses = self.graph.poses
        if fragments[closure.j] == later:
            wanted, moved = se2.compose(poses[closure.i], closure.pose), closure.j
        else:
            wanted, moved = se2.compose(poses[closure.j], se2.inverse(closure.pose)), closure.i
        shift = se2.compose(wanted, se2.inverse(poses[moved]))
        rows = np.flatnonzero(fragments == later)
        poses[rows] = se2.compose(shift, poses[rows])
        fragments[rows] = earlier
        self._fragments = fragments.tolist()

    def _is_due(self) -> bool:
        rules, n_new = self.config.optimizer, self.graph.n_poses - self.belief.n
        if self._is_urgent:
            return True
        growth = rules.least_growth if self._is_dirty else rules.growth
        return n_new >= max(rules.n_least, growth * self.belief.n)

    def _begin(self) -> None:
        self._is_dirty = self._is_urgent = False
        problem = Problem.of(self.graph, self.current)
        self._job = Job(problem, self.config.optimizer.limit, self._pool)
        self._job_due = self._n_scans + self.config.optimizer.n_adopt

    def _adopt(self, solution: Solution, job: Job) -> None:
        """Take the poses of an optimization; keyframes that came since move along with the one they hang on."""
        n, k = job.n_poses, solution.current
        later = se2.between(self.graph.poses[k], self.graph.poses[n:])
        onward = self._along(k, self.current)
        self.graph.poses[:n] = solution.poses
        self.graph.poses[n:] = se2.compose(solution.poses[k], later)
        self.graph.weights[: job.n_edges] = solution.weights
        self._belief = Belief(k, solution.poses, solution.covariances)
        self.since = onward
        if self.n_withdrawals < 2 and self._is_bent():
            self._withdraw()

    def _thin(self) -> None:
        """Let the oldest keyframes of places that hold too many go."""
        rules = self.config.places
        del self.closures[: -rules.n_logged]
        n_settled = min(self.belief.k, self.belief.n, self.graph.n_poses - rules.n_newest)
        is_kept, gone = thin(self.graph, np.asarray(self._fragments), n_settled, rules)
        if not gone:
            return
        numbers = self.keyframes.numbers.tolist()
        for v, (heir, seen) in gone.items():
            self.heirs.add(numbers[v], numbers[heir], seen)
            self._motions[v + 1] = compose(self._motions[v], self._motions[v + 1])
        remove_poses(self.graph, is_kept)
        self.keyframes.keep(is_kept)
        self._renumber(is_kept)

    def _renumber(self, is_kept: Bools) -> None:
        """Count the keyframes anew after some went."""
        rows = np.flatnonzero(is_kept).tolist()
        row_of = np.where(is_kept, np.cumsum(is_kept) - 1, -1)
        self._fragments = [self._fragments[k] for k in rows]
        self._motions = [self._motions[k] for k in rows]
        self.belief.keep(is_kept[: self.belief.n])
        self.current = int(row_of[self.current])
        at = row_of.tolist()
        self._queue = deque(
            Candidate(at[c.i], at[c.j], c.expected) for c in self._queue if at[c.i] >= 0
        )
        self._tried = {(at[i], at[j]) for i, j in self._tried if at[i] >= 0 and at[j] >= 0}
        self._missed = {at[j]: n for j, n in self._missed.items() if at[j] >= 0}
        self._waiting.renumber(row_of)

    def _is_bent(self) -> bool:
        """Return whether the closures bend the odometry more than it can err."""
        graph, rules = self.graph, self.config.closures
        rows = np.flatnonzero((graph.kinds == EdgeKind.MOTION) | (graph.kinds == EdgeKind.MATCH))
        edges = Edges.of(graph.ends[rows], graph.measured[rows], graph.covariances[rows])
        kinds = graph.kinds[rows]
        if bending(graph.poses, edges, kinds) > rules.max_bend:
            return True
        return greatest_turn(graph.poses, edges, kinds) > rules.max_turn

    def _withdraw(self) -> None:
        """Take back the closures that bend the odometry: the map falls back to it, and is never worse than it."""
        graph = self.graph
        rows = suspects(
            self.closures, self.config.keyframes.n_linked, all_of_them=self.n_withdrawals > 0
        )
        self.n_withdrawals += 1
        for row in rows:
            self.closures[row] = replace(self.closures[row], outcome=ClosureOutcome.WITHDRAWN)
        # what was carried over from keyframes that are gone has no record, and is not above suspicion either
        trusted = {(c.i, c.j) for c in self.closures if c.is_accepted}
        ends = self.keyframes.numbers[graph.ends]
        is_kept = ~graph.is_closure | (ends < self._n_loaded).all(axis=1)
        is_kept |= np.array([tuple(pair) in trusted for pair in ends.tolist()])
        graph.keep_edges(is_kept)
        self._waiting = Waiting(self.config)
        self._queue.clear()
        is_step = np.zeros(graph.n_poses, dtype=np.bool_)
        is_step[graph.ends[graph.kinds == EdgeKind.MOTION, 1]] = True
        ways = se2.between(graph.poses[:-1], graph.poses[1:])
        for k in range(1, graph.n_poses):
            way = self._motions[k].pose if is_step[k] else ways[k - 1]
            graph.poses[k] = se2.compose(graph.poses[k - 1], way)
        graph.weights[:] = 1.0
        self._fragments = components(graph.ends, graph.n_poses).tolist()
        problem = Problem.of(graph, self.current)
        job = Job(problem, self.config.optimizer.limit, self._pool)
        self._adopt(job.result(), job)

    def _along(self, i: int, j: int) -> UncertainPose:
        """Return keyframe j seen from an earlier one along the keyframes between them."""
        way = identity()
        for k in range(i + 1, j + 1):
            way = compose(way, self._motions[k])
        return UncertainPose(se2.between(self.graph.poses[i], self.graph.poses[j]), way.cov)

    def finish(self) -> None:
        """Match what waits, look once more for keyframes that see the same place, and optimize to the end."""
        if self._belief is None:
            return
        if self._job is not None:
            self._adopt(self._job.result(), self._job)
            self._job = None
        while self._queue:
            self._try(self._queue.popleft(), self._n_scans)
        self._settle()
        self._densify()
        self._settle()

    def _settle(self) -> None:
        problem = Problem.of(self.graph, self.current)
        job = Job(problem, self.config.optimizer.limit, self._pool, is_last=True)
        self._adopt(job.result(), job)
        self._is_dirty = self._is_urgent = False

    def _densify(self) -> None:
        """Match each keyframe with the nearest others that it has not been matched with."""
        poses, fragments = self.graph.poses, np.array(self._fragments)
        for k in range(1, self.graph.n_poses):
            relative = se2.between(poses[:k], poses[k])
            relative[fragments[:k] != fragments[k], 0] = np.inf
            cov = np.broadcast_to(4.0 * self.config.noise.floor, (k, 3, 3))
            for i in choose_candidates(relative, cov, self.config, self.keyframes):
                self._try(Candidate(i, k, UncertainPose(relative[i], cov[i])), self._n_scans)

    def current_in_map(self) -> UncertainPose:
        """Return where the current keyframe is in the map."""
        from_first = compose(self.belief.last_seen_from(0), self.since)
        first = self.graph.poses[0]
        in_map = compose(UncertainPose(first, np.zeros((3, 3))), from_first)
        return UncertainPose(self.graph.poses[self.current], in_map.cov)

    def covariances(self) -> Cov:
        """Return (n, 3, 3) covariance of each keyframe in the map, the first one known exactly."""
        graph = self.graph
        if graph.n_poses == 0:
            return np.empty((0, 3, 3))
        edges = Edges.of(graph.ends, graph.measured, graph.covariances)
        return covariances_seen_from(graph.poses, edges, graph.weights, 0)

    def placed(self) -> tuple[Pose, Cov]:
        """Return poses and covariances of all keyframes there ever were, by number."""
        return self.heirs.placed(self.keyframes.numbers, self.graph.poses, self.covariances())

    def map(self) -> SlamMap:
        """Return the map as it is now."""
        graph, keyframes = self.graph, self.keyframes
        return SlamMap(
            scans=tuple(keyframes[k].scan for k in range(len(keyframes))),
            poses=graph.poses.copy(),
            covariances=self.covariances(),
            indices=np.array([keyframes[k].index for k in range(len(keyframes))], dtype=np.int64),
            sessions=np.array(
                [keyframes[k].session for k in range(len(keyframes))], dtype=np.int64
            ),
            ends=graph.ends.copy(),
            measured=graph.measured.copy(),
            edge_covariances=graph.covariances.copy(),
            kinds=graph.kinds.copy(),
            weights=graph.weights.copy(),
        )

    @property
    def n_fragments(self) -> int:
        """Parts of the graph that nothing joins."""
        return len(set(self._fragments))

    def fragment_of(self, k: int) -> int:
        """Return the number of the fragment that a keyframe is in."""
        return self._fragments[k]
