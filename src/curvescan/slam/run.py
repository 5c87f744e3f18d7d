"""SLAM over a whole log."""

from __future__ import annotations

import time
from array import array
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from curvescan._interrupts import stoppable
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.matchers import Outcome
from curvescan.odometry import OdometryRun, StepOutcome
from curvescan.odometry.run import pose_at
from curvescan.odometry.step import MATCHES
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


def run_slam(
    scans: Iterable[LaserScan],
    slam: Slam | None = None,
    *,
    odometry_poses: Pose | None = None,
    on_step: Callable[[SlamStep], None] | None = None,
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
    """
    slam = slam or Slam()
    stamps, poses, odom, covariances, seconds = (array("d") for _ in range(5))
    n_matched = array("q")
    outcomes: list[StepOutcome] = []
    failures: Counter[Outcome] = Counter()
    is_degenerate = array("b")
    n_rejected = 0
    with stoppable() as stop:
        for k, scan in enumerate(scans):
            started = time.perf_counter()
            step = slam.add(scan, pose_at(odometry_poses, k))
            seconds.append(time.perf_counter() - started)
            stamps.append(step.stamp)
            poses.extend(step.pose)
            odom.extend(step.pose_odom)
            covariances.extend(step.covariance.ravel())
            n_matched.append(step.match.n_matched if step.match else 0)
            is_degenerate.append(
                step.match is not None and step.match.degenerate_direction is not None
            )
            if step.match and not step.match.ok:
                failures[step.match.outcome] += 1
            elif step.match and step.outcome not in MATCHES:
                n_rejected += 1
            outcomes.append(step.outcome)
            if on_step:
                on_step(step)
            if stop.is_asked:
                break
    n = len(outcomes)
    started = time.perf_counter()
    trajectory = slam.finish() if n else slam.trajectory()
    seconds_to_finish = time.perf_counter() - started
    times = np.array(stamps[:n])
    return SlamRun(
        slam=slam,
        revised=OdometryRun(
            method=slam.method,
            trajectory=Trajectory(
                stamps=times,
                poses=trajectory.poses[:n],
                covariances=None if trajectory.covariances is None else trajectory.covariances[:n],
            ),
            outcomes=tuple(outcomes),
            failures=dict(failures.most_common()),
            n_rejected=n_rejected,
            n_matched=np.array(n_matched[:n], dtype=np.int64),
            is_degenerate=np.array(is_degenerate[:n], dtype=np.bool_),
            seconds=np.array(seconds[:n]),
            is_partial=stop.is_asked,
            has_prior=odometry_poses is not None,
        ),
        online=Trajectory(
            stamps=times,
            poses=np.array(poses[: 3 * n]).reshape(n, 3),
            covariances=np.array(covariances[: 9 * n]).reshape(n, 3, 3),
        ),
        odometry=Trajectory(stamps=times, poses=np.array(odom[: 3 * n]).reshape(n, 3)),
        seconds_to_finish=seconds_to_finish,
    )
