"""How a matcher does on a recorded log: each scan matched with the one before, no guess, laser alone.

A log has no truth. Wheel odometry is good from one scan to the next, and so are the poses of a log that a SLAM system
has corrected: a match that differs from them by more than their errors can explain is wrong. Where there are relations,
checked by hand (see ``relations.py``), the method's odometry of the whole log is measured against them.
"""

import time
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan.engines import RunRecord, run_engine
from curvescan.errors import InvalidArgumentError, require
from curvescan.evaluation.relations import RelationErrors, find_stamps, relation_errors
from curvescan.io.log import Log
from curvescan.io.trajectories.relations import Relations
from curvescan.matchers import match, prepare
from curvescan.matchers.result import Outcome
from curvescan.odometry import Odometry
from curvescan.types import Floats

RIGHT = (0.25, np.radians(3.0))  # a match is right within this of the log's own poses: metres, radians
WRONG = (0.3, np.radians(10.0))  # a match is plainly wrong beyond either of these: metres, radians


@dataclass(frozen=True, eq=False, kw_only=True)
class LogEvaluation:
    """How one method did on the consecutive scans of one log."""

    log: str
    method: str
    n_steps: int  # pairs of consecutive scans
    failures: dict[Outcome, int]  # failed matches by reason, most frequent first
    motion: Floats  # (n_steps, 3): what was found: metres, metres, radians; NaN where the match failed
    # (n_steps, 2): distance and angle between what was found and the log's own poses; None where it has none
    difference: Floats | None
    seconds: Floats  # (n_steps,): time to prepare a scan and to match it
    # the odometry of the whole log by this method, laser alone; None without relations of this log
    run: RunRecord | None = None
    relations: RelationErrors | None = None  # errors of that odometry

    @property
    def n_failed(self) -> int:
        """Number of failed matches."""
        return sum(self.failures.values())

    @property
    def right_share(self) -> float:
        """Share of all steps matched within RIGHT of the log's own poses; NaN without any."""
        if self.difference is None:
            return float("nan")
        return float(np.mean((self.difference < RIGHT).all(axis=1)))

    @property
    def wrong_share(self) -> float:
        """Share of all steps matched, and beyond WRONG of the log's own poses; NaN without any."""
        if self.difference is None:
            return float("nan")
        return float(np.mean((self.difference > WRONG).any(axis=1)))

    @property
    def median_difference(self) -> tuple[float, float]:
        """Median difference of the matched motions from the log's own, metres and radians; NaN without any."""
        known = np.empty((0, 2)) if self.difference is None else self.difference
        known = known[~np.isnan(known[:, 0])]
        if len(known) == 0:
            return float("nan"), float("nan")
        return float(np.median(known[:, 0])), float(np.median(known[:, 1]))

    @property
    def largest_motion(self) -> tuple[float, float]:
        """99th percentile of the motion found, metres and radians: of a sensor that stands, its error."""
        known = self.motion[~np.isnan(self.motion[:, 0])]
        if len(known) == 0:
            return float("nan"), float("nan")
        distance, angle = np.hypot(known[:, 0], known[:, 1]), np.abs(known[:, 2])
        return float(np.percentile(distance, 99.0)), float(np.percentile(angle, 99.0))


def check_logs(logs: Sequence[Log]) -> None:
    """Raise InvalidArgumentError where a log has no two scans to match."""
    for log in logs:
        rule = f"each scan of a log is matched with the one before: {log.name} must have at least 2 scans"
        require(len(log) >= 2, rule, len(log))


def evaluate_log(
    log: Log,
    method: str,
    *,
    relations: Relations | None = None,
    laser_pose: ArrayLike = (0.0, 0.0, 0.0),
    on_step: Callable[[], None] | None = None,
) -> LogEvaluation:
    """Return how a method does on consecutive scans of a log, with its default parameters. laser_pose (3,)."""
    motion: list[Floats] = []
    seconds: list[float] = []
    failures: Counter[Outcome] = Counter()
    prepared = ((time.perf_counter(), prepare(scan, method=method), time.perf_counter()) for scan in log)
    for (_, reference, _), (begun, current, ready) in pairwise(prepared):
        started = time.perf_counter()
        result = match(reference, current, method=method)
        seconds.append(time.perf_counter() - started + ready - begun)
        motion.append(result.pose)
        if not result.ok:
            failures[result.outcome] += 1
        if on_step:
            on_step()
    found = np.array(motion).reshape(-1, 3)
    difference = None
    if log.odometry is not None:
        poses = log.odometry.poses
        off = se2.between(se2.between(poses[:-1], poses[1:]), found)
        difference = np.column_stack([np.hypot(off[:, 0], off[:, 1]), np.abs(off[:, 2])])
    run = errors = None
    if relations is not None:
        run = run_engine(log, Odometry(method))
        errors = relation_errors(run.trajectory, relations, laser_pose)
    return LogEvaluation(
        log=log.name,
        method=method,
        n_steps=len(found),
        failures=dict(failures.most_common()),
        motion=found,
        difference=difference,
        seconds=np.array(seconds),
        run=run,
        relations=errors,
    )


def assign_relations(logs: Sequence[Log], relations: Sequence[Relations]) -> list[Relations | None]:
    """Return for each log the relations between its scans, associated by stamps; None without."""
    stamps = [np.array([scan.stamp for scan in log]) for log in logs] if relations else []
    owned: list[Relations | None] = [None] * len(logs)
    for some in relations:
        found = [np.count_nonzero(find_stamps(own, some.first_stamps) >= 0) for own in stamps]
        if not any(found):
            raise InvalidArgumentError(
                f"{len(some):,} relations from {some.first_stamps.min():.6f} s on join no scans of "
                f"{', '.join(log.name for log in logs) or 'any log: give the log too'}"
            )
        owner = int(np.argmax(found))
        if owned[owner] is not None:
            raise InvalidArgumentError(f"two files of relations belong to {logs[owner].name}: give one a log")
        owned[owner] = some
    return owned
