"""Tracker: one verb for odometry, SLAM and localization, and what a sink gets of each scan."""

import math
import threading
import time
from dataclasses import dataclass
from typing import Self

from curvescan.deskew import middle_of_sweep
from curvescan.engines.engine import Engine, odometry_of, pose_at
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.odometry import Step
from curvescan.scan import LaserScan
from curvescan.slam import Slam
from curvescan.types import Pose


class Pace:
    """When slow work may be done again: at most every `period` seconds, and in at most a `share` of the time."""

    def __init__(self, period: float, share: float = 1.0) -> None:
        self._period, self._share = period, share
        self._started = self._next = -math.inf

    @property
    def is_due(self) -> bool:
        """Whether the work may be done now, in a context of this."""
        return time.monotonic() >= self._next

    def hurry(self) -> None:
        """Let it be done at once."""
        self._next = -math.inf

    def __enter__(self) -> Self:
        self._started = time.monotonic()
        return self

    def __exit__(self, *error: object) -> None:
        took = time.monotonic() - self._started
        self._next = self._started + max(self._period, took / self._share)


@dataclass(frozen=True, eq=False, kw_only=True)
class TrackedScan:
    """A scan and what became of it: all that sinks get."""

    index: int  # number of the scan among those that were tracked, from 0
    scan: LaserScan  # the scan as the source gave it
    step: Step  # what the engine returned for it
    # numbers of the two scans that each loop closure joins which this scan brought
    closures: tuple[tuple[int, int], ...]
    revised: Trajectory | None  # all poses so far, where those of the past have changed; at most once a second
    # whether the engine deskews sweeps by the times of their beams, as a map of them must then do too
    is_deskewed: bool
    seconds: float  # time that it took
    received: float  # when the source gave the scan, by time.monotonic(), seconds
    n_dropped: int  # scans of the source that were dropped before this one because tracking was too slow
    wheels: Pose | None = None  # pose of the sensor by its wheels, in a frame of their own

    @property
    def half_sweep(self) -> float:
        """Time from the scan's stamp to the moment of its pose, seconds: half the sweep where it is deskewed."""
        return middle_of_sweep(self.scan) if self.is_deskewed else 0.0


class Tracker:
    """Drives an engine scan by scan; odometry_poses (n, 3): the sensor by its wheels, of a log that is replayed."""

    def __init__(self, engine: Engine, odometry_poses: Pose | None = None) -> None:
        self.engine = engine
        self.lock = threading.Lock()  # the engine belongs to who holds it
        self._odometry_poses = odometry_poses
        self.has_prior = odometry_poses is not None  # whether the wheels of a replayed log are used
        self._n_scans = 0
        self._is_deskewed = odometry_of(engine).config.deskew
        self._scan_of_keyframe: dict[int, int] = {}
        self._is_revised, self._revisions = False, Pace(1.0, 0.05)

    def add(
        self, scan: LaserScan, *, received: float | None = None, n_dropped: int = 0, odometry_pose: Pose | None = None
    ) -> TrackedScan:
        """Return where the sensor was at this scan.

        received: when it came, by time.monotonic(), seconds, None for now; n_dropped: scans that were dropped so far;
        odometry_pose (3,): pose of the sensor by its wheels, see :meth:`curvescan.Odometry.add`.
        """
        received = time.monotonic() if received is None else received
        started = time.perf_counter()
        if odometry_pose is None:
            odometry_pose = pose_at(self._odometry_poses, self._n_scans)
        with self.lock:
            step = self.engine.add(scan, odometry_pose)
        seconds = time.perf_counter() - started
        scan_of = self._scan_of_keyframe
        scan_of.setdefault(step.keyframe, self._n_scans)
        self._is_revised |= step.is_revised
        tracked = TrackedScan(
            index=self._n_scans,
            scan=scan,
            step=step,
            closures=tuple((scan_of.get(c.i, self._n_scans), scan_of.get(c.j, self._n_scans)) for c in step.closures),
            revised=self._revision(),
            is_deskewed=self._is_deskewed,
            seconds=seconds,
            received=received,
            n_dropped=n_dropped,
            wheels=odometry_pose,
        )
        self._n_scans += 1
        return tracked

    def _revision(self) -> Trajectory | None:
        """Return all poses so far where they have changed and it is time; else None."""
        if not isinstance(self.engine, Slam) or not self._is_revised or not self._revisions.is_due:
            return None
        self._is_revised = False
        with self._revisions:
            return self.engine.trajectory()
