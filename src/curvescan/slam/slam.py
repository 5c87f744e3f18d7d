"""Slam: a stream of scans in, a globally consistent trajectory and a map out.

The odometry follows the sensor; every half metre its scan becomes a keyframe of a pose graph, which closes loops and
revises all poses. The graph is optimized in a thread beside the stream, and the result taken a fixed number of scans
later: the number of scans, not the clock, says when, so that the same input gives the same bits.
"""

from __future__ import annotations

import os
import sys
from collections.abc import Mapping
from concurrent.futures import Future, ThreadPoolExecutor
from copy import deepcopy
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from curvescan.configs import as_config, counted
from curvescan.deskew import deskew
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.matchers import DEFAULT_METHOD
from curvescan.matchers.registry import MatcherConfig
from curvescan.odometry.config import MATCHER_HINT
from curvescan.odometry.gaps import LOST_COVARIANCE
from curvescan.odometry.odometry import Odometry
from curvescan.odometry.step import Step, StepOutcome, between_steps
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose, compose, identity
from curvescan.slam.config import SlamConfig
from curvescan.slam.growing_map import GrowingMap, solve
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.loop_search import Beside, LoopSearch
from curvescan.slam.loops.audit import Contradiction
from curvescan.slam.loops.closures import Closure, is_loop
from curvescan.slam.map import SlamMap, as_map
from curvescan.slam.pose_graph.graph import PoseGraph
from curvescan.slam.records import Records
from curvescan.types import Cov, with_fields

_VAGUE = 0.3  # a new keyframe is due when the way since the last one is known no better, metres and radians
_N_LEAST, _GROWTH = 10, 0.05  # keyframes between optimizations, and share by which the graph grows, if no loop closes
_N_ADOPT = 60  # scans between the start of an optimization and its result
_N_PASSES = 3  # looks at the whole map at the end, as long as one opens it again


class Slam:
    """Where the sensor is, scan by scan, in a map that closes its loops.

    Parameters
    ----------
    method : str
        Name of the matcher.
    matcher : dataclass, mapping or None
        The matcher's configuration; None for its defaults.
    config : SlamConfig, mapping or None
        None for the defaults.
    map : SlamMap, path or None
        A map to continue, from anywhere in it; None to begin one.
    """

    def __init__(
        self,
        method: str = DEFAULT_METHOD,
        *,
        matcher: MatcherConfig | None = None,
        config: SlamConfig | Mapping[str, Any] | None = None,
        map: SlamMap | str | os.PathLike[str] | None = None,  # noqa: A002 - what it is
    ) -> None:
        self.config = as_config(config, SlamConfig(), hint=MATCHER_HINT)
        self.method = method
        self.odometry = Odometry(method, matcher=matcher, config=self.config.odometry)
        self.keyframes = Keyframes(self.odometry.matcher)
        self._map = GrowingMap(self.keyframes, self.config)
        self._search = LoopSearch(self._map)
        if map is not None:
            self._map.load(as_map(map))
        self.records = Records()
        self._origin: Step | None = None  # the step of the current keyframe
        self._n_unsettled = 0  # of an open gap of the odometry
        self._n_scans = 0
        self._beside = ThreadPoolExecutor(1, thread_name_prefix="curvescan-slam")
        self._job: Future[tuple[PoseGraph, Cov]] | None = None
        self._job_due = 0
        self.contradictions: tuple[Contradiction, ...] = ()
        """Matches that fail in a row where the finished map shows places twice; empty before :meth:`finish`."""

    def add(self, scan: LaserScan, odometry_pose: ArrayLike | None = None) -> Step:
        """Return where the sensor was at this scan.

        Parameters
        ----------
        scan : LaserScan
            The next scan; the order of the calls is the order.
        odometry_pose : (3,) array_like or None
            Pose of the sensor at this scan by its wheels; see :meth:`Odometry.add`.

        Returns
        -------
        Step
            Pose and covariance in the map as it is now, the pose in ``odom``, and the loop closures that were accepted.

        Raises
        ------
        InvalidArgumentError
            As :meth:`Odometry.add` does.
        """
        return self.add_placed(scan, self.odometry.add(scan, odometry_pose))

    def add_placed(self, scan: LaserScan, step: Step) -> Step:
        """Return where the sensor was at a scan that an odometry has placed, as :meth:`add` does."""
        if self._origin is None:
            seen = self._hang_on(self._map.start(scan, step.index), step, None)
        else:
            is_lost = step.outcome is StepOutcome.LOST
            went_on = with_fields(step, covariance=step.covariance - LOST_COVARIANCE) if is_lost else step
            seen = between_steps(self._origin, went_on)
            if step.is_driven or not step.is_unsettled:
                is_vague = sum(seen.covariance.diagonal().tolist()) >= _VAGUE**2
                if is_lost or is_vague or self.config.keyframes.is_far(seen.pose):
                    scan = deskew(scan, step.velocity) if self.config.odometry.deskew else scan
                    seen = self._hang_on(self._map.append(scan, step, seen), step, seen)
        self._n_scans += 1
        self._n_unsettled = self._n_unsettled + 1 if step.is_unsettled else 0
        self.records.add(step.stamp, seen)
        closures = self._search.work(step.index, self.config.closures.matches_per_scan)
        self._optimize_beside()
        is_revised, self._map.is_revised = self._map.is_revised, False
        here = compose(self._map.current_in_map(), seen)
        return with_fields(
            step,
            pose=here.pose,
            covariance=here.covariance,
            closures=tuple(c for c in closures if c.is_loop),
            is_revised=is_revised,
            keyframe=self.keyframes[-1].number,
            fragment=self._map.fragments[-1],
        )

    def _hang_on(self, k: int, step: Step, way: UncertainPose | None) -> UncertainPose:
        """Let scans hang on keyframe k, made of the scan of a step, look for it, and return the step seen from it."""
        self._search.enqueue(k)
        n_lost = self._n_unsettled if step.outcome is StepOutcome.LOST else 0
        self.records.begin(self.keyframes[k].number, None if way is None else way.pose, n_lost)
        self._origin, self._n_unsettled = step, 0
        return identity()

    def _optimize_beside(self) -> None:
        """Take the result of an optimization that is due, and begin the next one."""
        if self._job is not None and self._n_scans >= self._job_due:
            self._adopt()
            self._search.renumber(self._map.thin())
        if self._job is None:
            n_known = self._map.marginals.n
            is_grown = self.graph.n_poses - n_known >= max(_N_LEAST, _GROWTH * n_known)
            if self._search.is_urgent or is_grown:
                self._job, self._job_due = self._begin_job(), self._n_scans + _N_ADOPT

    def _begin_job(self, *, is_last: bool = False) -> Future[tuple[PoseGraph, Cov]]:
        self._search.is_urgent = False
        return self._beside.submit(solve, deepcopy(self.graph), self.config.noise, is_last)

    def _adopt(self) -> None:
        """Take the result of the optimization under way, if one is."""
        if self._job is not None:
            self._map.adopt(*self._job.result())
            self._job = None

    def finish(self, beside: Beside = partial) -> Trajectory:
        """Match what still waits, half of it beside, optimize to the end, and return every pose."""
        if self._origin is not None:
            self._adopt()
            self._search.work(self._n_scans, sys.maxsize)
            self._settle()
            for _ in range(_N_PASSES):
                self._search.densify(self._n_scans, beside)
                self._settle()
                if not self._search.audit():
                    break
                self._settle()
            self.contradictions = self._search.doubled()
        return self.trajectory()

    def _settle(self) -> None:
        self._map.adopt(*self._begin_job(is_last=True).result())

    def trajectory(self) -> Trajectory:
        """Return every pose so far, in the map as it is now."""
        return self.records.trajectory(*self._map.placed())

    @property
    def map(self) -> SlamMap:
        """The map as it is now."""
        return self._map.snapshot()

    @property
    def graph(self) -> PoseGraph:
        """Poses of the keyframes, and the edges between them."""
        return self._map.graph

    @property
    def closures(self) -> list[Closure]:
        """Each two keyframes that were matched beside the drive, and what became of their last match."""
        return list(self._search.closures.values())

    @property
    def n_fragments(self) -> int:
        """Parts of the map that nothing joins: more than one where a sensor that was lost has not been found again."""
        return len(set(self._map.fragments))

    def count_matches(self) -> tuple[int, int]:
        """Return how many loop closures the graph follows, and how many matches of other neighbours."""
        is_followed = self.graph.is_closure & self.graph.is_followed
        numbers = self.keyframes.numbers[self.graph.ends[is_followed]]
        n_closures = int(np.count_nonzero(is_loop(numbers[:, 0], numbers[:, 1])))
        return n_closures, int(np.count_nonzero(is_followed)) - n_closures

    def __repr__(self) -> str:
        n_closures, n_neighbours = self.count_matches()
        found = f"{counted(len(self.keyframes), 'keyframe')}, {counted(n_closures, 'loop closure')}"
        return f"Slam({self.method}: {counted(self._n_scans, 'scan')}, {found}, {n_neighbours:,} matches of neighbours)"
