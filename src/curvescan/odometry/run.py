"""The odometry of a whole log."""

from __future__ import annotations

import math
import time
from array import array
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass

import numpy as np

from curvescan._interrupts import stoppable
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.matchers import Outcome
from curvescan.odometry.odometry import Odometry
from curvescan.odometry.step import MATCHES, OdometryStep, StepOutcome
from curvescan.scan import LaserScan
from curvescan.types import Bools, Floats, Ints, Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class OdometryRun:
    """The odometry of a whole log.

    Attributes
    ----------
    method : str
        Name of the matcher.
    trajectory : Trajectory
        Stamp, pose and covariance at each scan, in the frame of the first.
    outcomes : tuple of StepOutcome
        How each pose came about.
    failures : dict of Outcome to int
        Failed matches by reason, most frequent first.
    n_rejected : int
        Scans that a match did not place though the matcher gave a pose: too far from what was expected, or with nothing
        known before the track was lost. With `failures` they add up to the scans that are not matched.
    n_prior_rejected : int
        Scans at which wheels or a gyroscope contradicted a match that the last motion supports, and were left out.
    n_matched : (n,) int64
        Matched pairs of readings behind each pose; 0 where there was no match.
    is_degenerate : (n,) bool
        Whether the match of each scan leaves a direction unobservable, as along a corridor.
    seconds : (n,) float64
        Time that ``Odometry.add`` took for each scan.
    is_partial : bool
        Whether the run was interrupted before the end of the log.
    has_prior : bool
        Whether wheels or a gyroscope gave a motion prior.
    """

    method: str
    trajectory: Trajectory
    outcomes: tuple[StepOutcome, ...]
    failures: dict[Outcome, int]
    n_rejected: int
    n_matched: Ints
    is_degenerate: Bools
    seconds: Floats
    is_partial: bool
    has_prior: bool = False
    n_prior_rejected: int = 0

    def __repr__(self) -> str:
        n = len(self.outcomes)
        n_failed = int(np.count_nonzero(self.is_failed))
        partial = ", interrupted" if self.is_partial else ""
        return f"OdometryRun({self.method!r}: {n:,} scans, {n_failed:,} not matched{partial})"

    @property
    def is_matched(self) -> Bools:
        """(n,) whether each pose comes from a match; False at the first, which has none."""
        return np.array([o in MATCHES for o in self.outcomes], dtype=np.bool_)

    @property
    def is_joined(self) -> Bools:
        """(n,) whether each pose is a motion away from the one before; False at the first and where it leapt.

        A pose leaps where an earlier keyframe puts the drift since then right.
        """
        joined = (StepOutcome.MATCHED, StepOutcome.CHAINED)
        return np.array([o in joined for o in self.outcomes], dtype=np.bool_)

    @property
    def scan_period(self) -> float:
        """Median time between scans by their stamps, seconds; NaN with fewer than two, or where stamps don't tell."""
        steps = np.diff(self.trajectory.stamps)
        steps = steps[np.isfinite(steps) & (steps > 0.0)]
        return float(np.median(steps)) if steps.size else math.nan

    @property
    def is_failed(self) -> Bools:
        """(n,) whether the match of each scan failed; False at the first, which has none."""
        failed = ~self.is_matched
        failed[:1] = False
        return failed


def run_odometry(
    scans: Iterable[LaserScan],
    odometry: Odometry | None = None,
    *,
    odometry_poses: Pose | None = None,
    on_step: Callable[[OdometryStep], None] | None = None,
) -> OdometryRun:
    """Return the odometry of a sequence of scans.

    Ctrl-C ends the run and gives what there is so far, marked as partial.

    Parameters
    ----------
    scans : iterable of LaserScan
        A log, or any iterable; one scan is held at a time.
    odometry : Odometry or None
        A fresh one; None for the defaults.
    odometry_poses : (n, 3) float64 or None
        Pose of the sensor at each scan by its wheels, as ``log.odometry.poses``; see :meth:`Odometry.add`.
    on_step : callable or None
        Called after each scan, for a progress bar say.

    Returns
    -------
    OdometryRun
        Of length 0 when there are no scans.
    """
    odometry = odometry or Odometry()
    stamps, poses, covariances, seconds = (array("d") for _ in range(4))
    outcomes: list[StepOutcome] = []
    n_matched, is_degenerate = array("q"), array("b")
    n_rejected = n_prior_rejected = 0
    failures: Counter[Outcome] = Counter()
    with stoppable() as stop:
        for k, scan in enumerate(scans):
            started = time.perf_counter()
            step = odometry.add(scan, pose_at(odometry_poses, k))
            seconds.append(time.perf_counter() - started)
            stamps.append(step.stamp)
            poses.extend(step.pose)
            covariances.extend(step.covariance.ravel())
            n_matched.append(step.match.n_matched if step.match else 0)
            is_degenerate.append(
                step.match is not None and step.match.degenerate_direction is not None
            )
            if step.match and step.outcome not in MATCHES:
                if step.match.ok:
                    n_rejected += 1
                else:
                    failures[step.match.outcome] += 1
            n_prior_rejected += step.is_prior_rejected
            outcomes.append(step.outcome)
            if on_step:
                on_step(step)
            if stop.is_asked:
                break
    n = len(outcomes)  # a row that an interrupt left half-made is dropped
    return OdometryRun(
        method=odometry.method,
        trajectory=Trajectory(
            stamps=np.array(stamps[:n]),
            poses=np.array(poses[: 3 * n]).reshape(n, 3),
            covariances=np.array(covariances[: 9 * n]).reshape(n, 3, 3),
        ),
        outcomes=tuple(outcomes),
        failures=dict(failures.most_common()),
        n_rejected=n_rejected,
        n_matched=np.array(n_matched[:n], dtype=np.int64),
        is_degenerate=np.array(is_degenerate[:n], dtype=np.bool_),
        seconds=np.array(seconds[:n]),
        is_partial=stop.is_asked,
        has_prior=odometry_poses is not None,
        n_prior_rejected=n_prior_rejected,
    )


def pose_at(odometry_poses: Pose | None, k: int) -> Pose | None:
    """Return the pose of the sensor at scan k by its wheels; NaN beyond the last, as of a log that grows while it is read."""
    if odometry_poses is None:
        return None
    return odometry_poses[k] if k < len(odometry_poses) else np.full(3, np.nan)
