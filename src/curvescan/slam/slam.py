"""Slam: a stream of scans in, a globally consistent trajectory and a map out.

The odometry follows the sensor; every half metre its scan becomes a keyframe of a pose graph, which closes loops and
revises all poses.
"""

from __future__ import annotations

import math
import os
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan.configs import as_config
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.matchers import DEFAULT_METHOD
from curvescan.matchers.registry import MatcherConfig
from curvescan.odometry.deskewing import Deskewer
from curvescan.odometry.odometry import Odometry
from curvescan.odometry.step import Step
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose, compose, identity
from curvescan.slam.backend import Backend
from curvescan.slam.config import SlamConfig
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.loops.audit import Contradiction
from curvescan.slam.loops.closures import Closure
from curvescan.slam.map import SlamMap, as_map
from curvescan.slam.open_drive import OpenDrive
from curvescan.slam.pose_graph.relative import UNMEASURED, between_steps
from curvescan.slam.records import Records
from curvescan.types import Ints, Pose


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
        hint = "the configuration of the matcher is given as matcher="
        self.config = as_config(config, SlamConfig(), hint=hint)
        self.method = method
        self.odometry = Odometry(method, matcher=matcher, config=self.config.odometry)
        keyframes = Keyframes(method, matcher, self.config.keyframes.n_prepared)
        self.backend = Backend(keyframes, self.config)
        self._session = 0
        if map is not None:
            begun = as_map(map)
            self.backend.load(begun)
            self._session = begun.n_sessions
        self._records = Records()
        self._deskewer = Deskewer()
        self._open_drive = OpenDrive()
        self._last: Step | None = None
        self._origin: Step | None = None  # the step of the current keyframe
        self._n_lost = self._n_most_lost = 0  # scans that nothing places, now and since the current keyframe
        self._n_scans = 0
        self._contradictions: tuple[Contradiction, ...] = ()

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
        """Return where the sensor was at a scan that an odometry has placed, as :meth:`add` does.

        Parameters
        ----------
        scan : LaserScan
            The next scan.
        step : Step
            What the odometry says of it.
        """
        self._deskewer = self._deskewer.ticked(scan)
        self._open_drive = self._open_drive.added(step)
        if self._origin is None:
            seen = self._begin_fragment(scan, step, np.zeros(3))
        else:
            is_lost = step.outcome in UNMEASURED and not step.is_driven
            self._n_lost = self._n_lost + 1 if is_lost else 0
            self._n_most_lost = max(self._n_most_lost, self._n_lost)
            seen = self._open_drive.known(between_steps(self._origin, step))
            if self._n_most_lost >= self.config.keyframes.n_lost and not is_lost:
                seen = self._begin_fragment(scan, step, se2.compose(self.backend.current_in_map().pose, seen.pose))
            elif self._is_due(seen) and (step.is_driven or not step.is_unsettled):
                seen = self._make_keyframe(scan, step, seen)
        self._last = step
        self._n_scans += 1
        self._records.add(step.stamp, seen)
        closures, is_revised = self.backend.work(step.index)
        return self._step(step, seen, closures, is_revised)

    def _step(self, step: Step, seen: UncertainPose, closures: tuple[Closure, ...], is_revised: bool) -> Step:
        backend = self.backend
        here = compose(backend.current_in_map(), seen)
        return replace(
            step,
            pose=here.pose,
            covariance=here.cov,
            closures=tuple(c for c in closures if c.is_loop),
            is_revised=is_revised,
            keyframe=backend.keyframes[backend.current].number,
            fragment=backend.fragment_of(backend.current),
        )

    def _is_due(self, seen: UncertainPose) -> bool:
        rules, (x, y, theta) = self.config.keyframes, seen.pose.tolist()
        if math.hypot(x, y) >= rules.distance or abs(theta) >= rules.turn:
            return True
        return float(seen.cov[0, 0] + seen.cov[1, 1]) >= rules.vague**2

    def _make_keyframe(self, scan: LaserScan, step: Step, seen: UncertainPose) -> UncertainPose:
        assert self._last is not None
        deskewed = scan
        if self.config.odometry.deskew:
            deskewed = self._deskewer.deskewed(scan, se2.between(self._last.pose, step.pose))
        return self._hang_on(self.backend.add_keyframe(deskewed, step.index, seen), step, seen)

    def _begin_fragment(self, scan: LaserScan, step: Step, pose: Pose) -> UncertainPose:
        """Begin, or begin anew where a lost sensor sees something again: nothing says how it moved meanwhile."""
        return self._hang_on(self.backend.start(scan, step.index, pose, self._session), step, None)

    def _hang_on(self, k: int, step: Step, way: UncertainPose | None) -> UncertainPose:
        """Let scans hang on keyframe k, made of the scan of a step, and return the step seen from it."""
        self._records.begin(self.backend.keyframes[k].number, way)
        self._origin, self._n_most_lost = step, 0
        self._open_drive = self._open_drive.begun()
        return identity()

    def trajectory(self) -> Trajectory:
        """Return every pose so far, in the map as it is now."""
        return self._records.trajectory(*self.backend.placed())

    def keyframe_scans(self) -> Ints:
        """Return (k, 2) number and scan of each keyframe of this session, also of those that went."""
        return self._records.keyframe_scans()

    @property
    def map(self) -> SlamMap:
        """The map as it is now."""
        return self.backend.map()

    @property
    def closures(self) -> list[Closure]:
        """All loop-closure candidates that were matched, and what became of them."""
        return self.backend.closures

    @property
    def contradictions(self) -> tuple[Contradiction, ...]:
        """Sure matches that agree with each other and contradict the finished map; empty before :meth:`finish`."""
        return self._contradictions

    @property
    def n_fragments(self) -> int:
        """Parts of the map that nothing joins: more than one where a sensor that was lost has not been found again."""
        return self.backend.n_fragments

    def finish(self) -> Trajectory:
        """Match what still waits, optimize to the end, and return every pose."""
        self._contradictions = tuple(self.backend.finish())
        return self.trajectory()

    def __repr__(self) -> str:
        n_closures, n_neighbours = self.backend.count_matches()
        return (
            f"Slam({self.method}: {self._n_scans:,} scans, {len(self.backend.keyframes):,} keyframes, "
            f"{n_closures:,} loop closures, {n_neighbours:,} matches of neighbours)"
        )
