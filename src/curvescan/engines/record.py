"""The record of a run over a whole log."""

from __future__ import annotations

import math
from array import array
from collections import Counter
from dataclasses import dataclass

import numpy as np

from curvescan.configs import counted
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.matchers import Outcome
from curvescan.odometry.step import MATCHES, Step, StepOutcome
from curvescan.types import Bools, Floats, Ints, with_fields


@dataclass(frozen=True, eq=False, kw_only=True)
class RunRecord:
    """The steps of a run over a log, by odometry, SLAM or localization.

    Attributes
    ----------
    method : str
        Name of the matcher.
    trajectory : Trajectory
        Stamp, pose and covariance at each scan; of SLAM as they are at the end, every pose revised.
    online : Trajectory
        The same as they were reported with each scan.
    odometry : Trajectory
        The poses by the odometry alone, never revised.
    steps : tuple of Step
        What the engine returned for each scan, their matches without `trace`; empty where steps were not to be kept.
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
    confidence : (n,) float64
        Probability that the match of each scan is right; NaN where there was none, or the matcher gives none.
    is_degenerate : (n,) bool
        Whether the match of each scan leaves a direction unobservable, as along a corridor.
    seconds : (n,) float64
        Time that ``add`` took for each scan.
    is_partial : bool
        Whether the run was interrupted before the end of the log.
    has_prior : bool
        Whether wheels or a gyroscope gave a motion prior.
    seconds_to_finish : float
        Time that SLAM took at the end, to optimize once more.
    """

    method: str
    trajectory: Trajectory
    online: Trajectory
    odometry: Trajectory
    outcomes: tuple[StepOutcome, ...]
    failures: dict[Outcome, int]
    n_rejected: int
    n_matched: Ints
    confidence: Floats
    is_degenerate: Bools
    seconds: Floats
    is_partial: bool
    has_prior: bool = False
    n_prior_rejected: int = 0
    steps: tuple[Step, ...] = ()
    seconds_to_finish: float = 0.0

    def __repr__(self) -> str:
        n_failed, partial = int(np.count_nonzero(self.is_failed)), ", interrupted" if self.is_partial else ""
        return f"RunRecord({self.method!r}: {counted(len(self.outcomes), 'scan')}, {n_failed:,} not matched{partial})"

    @property
    def is_matched(self) -> Bools:
        """(n,) whether each pose comes from a match; False at the first, which has none."""
        return np.array([o in MATCHES for o in self.outcomes], dtype=np.bool_)

    @property
    def is_joined(self) -> Bools:
        """(n,) whether each pose is a motion away from the one before; False at the first and where a gap ended."""
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


class Recorder:
    """Gathers the steps of a run in columns, about 200 bytes a scan; with the steps themselves some 2 kB."""

    def __init__(self, *, keeps_steps: bool = False) -> None:
        self._keeps_steps = keeps_steps
        self._stamps, self._poses, self._odom, self._covariances, self._seconds = (array("d") for _ in range(5))
        self._outcomes: list[StepOutcome] = []
        self._steps: list[Step] = []
        self._n_matched, self._confidences, self._is_degenerate = array("q"), array("d"), array("b")
        self._n_rejected = self._n_prior_rejected = 0
        self._failures: Counter[Outcome] = Counter()

    def add(self, step: Step, seconds: float) -> None:
        """Take up a step, and how long it took."""
        match = step.match
        self._seconds.append(seconds)
        self._stamps.append(step.stamp)
        self._poses.extend(step.pose.tolist())
        self._odom.extend(step.pose_odom.tolist())
        self._covariances.extend(step.covariance.ravel().tolist())
        self._n_matched.append(match.n_matched if match else 0)
        self._confidences.append(match.confidence if match else math.nan)
        self._is_degenerate.append(match is not None and match.degenerate_direction is not None)
        if match and not step.is_matched:
            if match.ok:
                self._n_rejected += 1
            else:
                self._failures[match.outcome] += 1
        self._n_prior_rejected += step.is_prior_rejected
        if self._keeps_steps:
            self._steps.append(without_trace(step))
        self._outcomes.append(step.outcome)

    def record(self, method: str, *, is_partial: bool, has_prior: bool = False) -> RunRecord:
        """Return the record of the run, with the poses as they were reported with each step."""
        n = len(self._outcomes)  # a row that an interrupt left half-made is dropped
        stamps = np.array(self._stamps[:n])
        online = Trajectory(
            stamps=stamps,
            poses=np.array(self._poses[: 3 * n]).reshape(n, 3),
            covariances=np.array(self._covariances[: 9 * n]).reshape(n, 3, 3),
        )
        return RunRecord(
            method=method,
            trajectory=online,
            online=online,
            odometry=Trajectory(stamps=stamps, poses=np.array(self._odom[: 3 * n]).reshape(n, 3)),
            outcomes=tuple(self._outcomes),
            failures=dict(self._failures.most_common()),
            n_rejected=self._n_rejected,
            n_matched=np.array(self._n_matched[:n], dtype=np.int64),
            confidence=np.array(self._confidences[:n]),
            is_degenerate=np.array(self._is_degenerate[:n], dtype=np.bool_),
            seconds=np.array(self._seconds[:n]),
            is_partial=is_partial,
            has_prior=has_prior,
            n_prior_rejected=self._n_prior_rejected,
            steps=tuple(self._steps[:n]),
        )


def without_trace(step: Step) -> Step:
    """Return a step without what the matcher did on the way, which is larger than all the rest."""
    if step.match is None:
        return step
    return with_fields(step, match=with_fields(step.match, reference=None, current=None, trace=None))
