"""Backend: keyframes in, a pose graph that closes its loops out.

The state of SLAM but for the odometry: a map that grows, the search for its loop closures, and the optimization that
runs beside.
"""

from __future__ import annotations

from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam.config import SlamConfig
from curvescan.slam.growing_map import GrowingMap
from curvescan.slam.jobs import Problem, Solution, solve
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.loop_search import LoopSearch
from curvescan.slam.loops.audit import Contradiction
from curvescan.slam.loops.closures import Closure, is_loop
from curvescan.slam.map import SlamMap
from curvescan.types import Cov, Pose

_N_PASSES = 3
"""Looks at the whole map at the end, as long as one opens it again."""


class Backend:
    """The graph, its keyframes, and the search for loop closures."""

    def __init__(self, keyframes: Keyframes, config: SlamConfig) -> None:
        self.config = config
        self.keyframes = keyframes
        self._map = GrowingMap(keyframes, config)
        self._search = LoopSearch(self._map, config)
        self.graph, self.heirs = self._map.graph, self._map.heirs
        self._pool = ThreadPoolExecutor(1, thread_name_prefix="curvescan-slam")
        self._job: Future[Solution] | None = None
        self._job_due = 0
        self._n_scans = 0

    @property
    def current(self) -> int:
        """The newest keyframe."""
        return self._map.current

    @property
    def closures(self) -> list[Closure]:
        """Loop-closure candidates that were matched, and what became of them."""
        return self._search.closures

    def load(self, slam_map: SlamMap) -> None:
        """Take a map to continue."""
        self._map.load(slam_map)

    def start(self, scan: LaserScan, index: int, pose: Pose, session: int = 0) -> int:
        """Begin a fragment: take a keyframe that nothing ties to those before it, and return its row.

        pose (3,).
        """
        self._await()
        k = self._map.start(scan, index, pose, session)
        if k > 0:
            self._search.enqueue(k)
        return k

    def add_keyframe(self, scan: LaserScan, index: int, motion: UncertainPose) -> int:
        """Take the next keyframe and return its row."""
        k = self._map.append(scan, index, motion)
        self._search.enqueue(k)
        return k

    def work(self, index: int) -> tuple[tuple[Closure, ...], bool]:
        """Do a bounded share of what waits, and return the closures accepted and whether poses were revised."""
        self._n_scans += 1
        accepted = self._search.work(index)
        is_revised = self._job is not None and self._n_scans >= self._job_due
        if is_revised:
            self._await()
            self._thin()
        if self._job is None and self._is_due():
            self._begin()
        return tuple(accepted), is_revised

    def _is_due(self) -> bool:
        rules, n_known = self.config.optimizer, self._map.belief.n
        if self._search.is_urgent:
            return True
        return self.graph.n_poses - n_known >= max(rules.n_least, rules.growth * n_known)

    def _begin(self) -> None:
        """Begin an optimization of the graph as it is now."""
        self._search.settle()
        self._job = self._new_job()
        self._job_due = self._n_scans + self.config.optimizer.n_adopt

    def _new_job(self, *, is_last: bool = False) -> Future[Solution]:
        problem = Problem.of(self.graph, self._map.current)
        return self._pool.submit(solve, problem, self.config.noise, is_last)

    def _await(self) -> None:
        """Take the result of the optimization under way, if one is."""
        if self._job is not None:
            self._map.adopt(self._job.result())
            self._job = None

    def _thin(self) -> None:
        """Let the oldest keyframes of places that hold too many go."""
        self._search.forget()
        numbers = self.keyframes.numbers
        is_kept = self._map.thin()
        if is_kept is not None:
            self._search.renumber(is_kept, numbers[~is_kept].tolist())

    def finish(self) -> list[Contradiction]:
        """Match what waits, look once more for keyframes that see the same place, and optimize to the end.

        Return the sure matches that contradict the finished map.
        """
        if not self._map.is_begun:
            return []
        self._await()
        self._search.finish(self._n_scans)
        self._settle()
        for _ in range(_N_PASSES):
            self._search.densify(self._n_scans)
            self._settle()
            audited = self._search.audit()
            if not self._search.reopen(audited):
                return self._search.contradictions(audited)
            self._settle()
        return self._search.contradictions(self._search.audit())

    def _settle(self) -> None:
        self._search.settle()
        self._map.adopt(self._new_job(is_last=True).result())

    def count_matches(self) -> tuple[int, int]:
        """Return how many loop closures the graph follows, and how many matches of other neighbours."""
        graph = self.graph
        is_followed = graph.is_closure & (graph.weights > 0.5)
        numbers = self.keyframes.numbers[graph.ends[is_followed]]
        n_closures = int(np.count_nonzero(is_loop(numbers[:, 0], numbers[:, 1])))
        return n_closures, int(np.count_nonzero(is_followed)) - n_closures

    def current_in_map(self) -> UncertainPose:
        """Return where the newest keyframe is in the map."""
        return self._map.current_in_map()

    def covariances(self) -> Cov:
        """Return (n, 3, 3) covariance of each keyframe in the map, the first one known exactly."""
        return self._map.covariances()

    def placed(self) -> tuple[Pose, Cov]:
        """Return poses and covariances of all keyframes there ever were, by number."""
        return self._map.placed()

    def map(self) -> SlamMap:
        """Return the map as it is now."""
        return self._map.snapshot()

    @property
    def n_fragments(self) -> int:
        """Parts of the graph that nothing joins."""
        return self._map.n_fragments

    def fragment_of(self, k: int) -> int:
        """Return the number of the fragment that a keyframe is in."""
        return self._map.fragments[k]
