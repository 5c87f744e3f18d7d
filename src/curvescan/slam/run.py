"""SLAM over a whole log."""

from __future__ import annotations

import time
from array import array
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from curvescan._interrupts import stoppable
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.odometry import Odometry, OdometryRun
from curvescan.odometry.run import OdometryInTurn, PlacedScan, RunRecorder
from curvescan.scan import LaserScan
from curvescan.slam.slam import Slam
from curvescan.slam.step import SlamStep
from curvescan.types import Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class SlamRun:
    """SLAM over a whole log.

    Attributes
    ----------
    slam : Slam
        As it was at the end, its graph and its closures.
    revised : OdometryRun
        The record of the odometry in front, with every pose revised at the end.
    online : Trajectory
        The poses as they were reported with each scan.
    odometry : Trajectory
        The poses in ``odom``, never revised.
    seconds_to_finish : float
        Time that :meth:`Slam.finish` took.
    """

    slam: Slam
    revised: OdometryRun
    online: Trajectory
    odometry: Trajectory
    seconds_to_finish: float


class OdometryAhead(Protocol):
    """The odometry of a log, made elsewhere: ``curvescan.runs.odometry_process``.

    Attributes
    ----------
    odometry : Odometry
        At the end of the iteration the one that has placed all scans.
    """

    odometry: Odometry

    def __iter__(self) -> Iterator[PlacedScan]:
        """Yield the scans of the log with their steps, in order."""
        ...


def run_slam(
    scans: Iterable[LaserScan],
    slam: Slam | None = None,
    *,
    odometry_poses: Pose | None = None,
    on_step: Callable[[SlamStep], None] | None = None,
    ahead: OdometryAhead | None = None,
) -> SlamRun:
    """Return SLAM over a sequence of scans.

    Ctrl-C ends the run and gives what there is so far, marked as partial.

    Parameters
    ----------
    scans : iterable of LaserScan
        A log, or any iterable; one scan is held at a time.
    slam : Slam or None
        A fresh one, or one that continues a map; None for the defaults.
    odometry_poses : (n, 3) float64 or None
        Pose of the sensor at each scan by its wheels, as ``log.odometry.poses``; see :meth:`Slam.add`.
    on_step : callable or None
        Called after each scan, for a progress bar say.
    ahead : OdometryAhead or None
        The odometry of these scans, begun with ``slam.odometry`` and made elsewhere; None to make it here.
    """
    slam = slam or Slam()
    source = ahead or OdometryInTurn(slam.odometry, scans, odometry_poses)
    recorder, odom = RunRecorder(), array("d")
    with stoppable() as stop:
        for placed in source:
            started = time.perf_counter()
            step = slam.add_placed(placed.scan, placed.step)
            seconds = placed.seconds + time.perf_counter() - started
            odom.extend(step.pose_odom)
            recorder.add(step, seconds)
            if on_step:
                on_step(step)
            if stop.is_asked:
                break
    slam.odometry = source.odometry
    record = recorder.run(slam.method, is_partial=stop.is_asked, has_prior=odometry_poses is not None)
    n, online = len(record.outcomes), record.trajectory
    started = time.perf_counter()
    revised = (slam.finish() if n else slam.trajectory())[:n]
    seconds_to_finish = time.perf_counter() - started
    return SlamRun(
        slam=slam,
        revised=replace(record, trajectory=replace(revised, stamps=online.stamps)),
        online=online,
        odometry=Trajectory(stamps=online.stamps, poses=np.array(odom[: 3 * n]).reshape(n, 3)),
        seconds_to_finish=seconds_to_finish,
    )
