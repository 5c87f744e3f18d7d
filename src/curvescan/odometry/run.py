"""The odometry of a whole log."""

from __future__ import annotations

import math
import time
from array import array
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np

from curvescan._interrupts import stoppable
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.matchers import MatchResult, Outcome
from curvescan.odometry.odometry import Odometry
from curvescan.odometry.step import MATCHES, OdometryStep, StepOutcome
from curvescan.scan import LaserScan
from curvescan.types import Bools, Cov, Floats, Ints, Pose


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


class _Step(Protocol):
    """What a recorder takes of a step, of the odometry or of SLAM."""

    @property
    def stamp(self) -> float: ...
    @property
    def pose(self) -> Pose: ...
    @property
    def covariance(self) -> Cov: ...
    @property
    def outcome(self) -> StepOutcome: ...
    @property
    def match(self) -> MatchResult | None: ...


class RunRecorder:
    """Gathers the steps of a run in columns."""

    def __init__(self) -> None:
        self._stamps, self._poses, self._covariances, self._seconds = (array("d") for _ in range(4))
        self._outcomes: list[StepOutcome] = []
        self._n_matched, self._is_degenerate = array("q"), array("b")
        self._n_rejected = self._n_prior_rejected = 0
        self._failures: Counter[Outcome] = Counter()

    def add(self, step: _Step, seconds: float, *, is_prior_rejected: bool = False) -> None:
        """Take up a step, and how long it took."""
        match = step.match
        self._seconds.append(seconds)
        self._stamps.append(step.stamp)
        self._poses.extend(step.pose)
        self._covariances.extend(step.covariance.ravel())
        self._n_matched.append(match.n_matched if match else 0)
        self._is_degenerate.append(match is not None and match.degenerate_direction is not None)
        if match and step.outcome not in MATCHES:
            if match.ok:
                self._n_rejected += 1
            else:
                self._failures[match.outcome] += 1
        self._n_prior_rejected += is_prior_rejected
        self._outcomes.append(step.outcome)

    def run(self, method: str, *, is_partial: bool, has_prior: bool) -> OdometryRun:
        """Return the record of the run, with the poses as they were reported with each step."""
        n = len(self._outcomes)  # a row that an interrupt left half-made is dropped
        return OdometryRun(
            method=method,
            trajectory=Trajectory(
                stamps=np.array(self._stamps[:n]),
                poses=np.array(self._poses[: 3 * n]).reshape(n, 3),
                covariances=np.array(self._covariances[: 9 * n]).reshape(n, 3, 3),
            ),
            outcomes=tuple(self._outcomes),
            failures=dict(self._failures.most_common()),
            n_rejected=self._n_rejected,
            n_matched=np.array(self._n_matched[:n], dtype=np.int64),
            is_degenerate=np.array(self._is_degenerate[:n], dtype=np.bool_),
            seconds=np.array(self._seconds[:n]),
            is_partial=is_partial,
            has_prior=has_prior,
            n_prior_rejected=self._n_prior_rejected,
        )


class PlacedScan(NamedTuple):
    """A scan, where the odometry has it, and the seconds that took."""

    scan: LaserScan
    step: OdometryStep
    seconds: float


class OdometryInTurn:
    """The odometry of scans, each when it is wanted; iterate over it once.

    odometry_poses (n, 3).
    """

    def __init__(self, odometry: Odometry, scans: Iterable[LaserScan], odometry_poses: Pose | None) -> None:
        self.odometry = odometry
        self._scans, self._odometry_poses = scans, odometry_poses

    def __iter__(self) -> Iterator[PlacedScan]:
        for k, scan in enumerate(self._scans):
            yield placed(self.odometry, scan, pose_at(self._odometry_poses, k))


def placed(odometry: Odometry, scan: LaserScan, odometry_pose: Pose | None) -> PlacedScan:
    """Add a scan to an odometry, and return it with its step."""
    started = time.perf_counter()
    step = odometry.add(scan, odometry_pose)
    return PlacedScan(scan, step, time.perf_counter() - started)


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
    recorder = RunRecorder()
    with stoppable() as stop:
        for _, step, seconds in OdometryInTurn(odometry, scans, odometry_poses):
            recorder.add(step, seconds, is_prior_rejected=step.is_prior_rejected)
            if on_step:
                on_step(step)
            if stop.is_asked:
                break
    return recorder.run(odometry.method, is_partial=stop.is_asked, has_prior=odometry_poses is not None)


def pose_at(odometry_poses: Pose | None, k: int) -> Pose | None:
    """Return the pose of the sensor at scan k by its wheels; NaN beyond the last, as of a log that grows while it is read."""
    if odometry_poses is None:
        return None
    return odometry_poses[k] if k < len(odometry_poses) else np.full(3, np.nan)
