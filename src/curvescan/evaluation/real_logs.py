"""How a matcher does on a recorded log: how often it fails and why, and how often it is plainly wrong.

A log has no truth, but wheel odometry is good from one scan to the next: a step that differs from it by more than
its errors can explain is wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan.io.log import Log
from curvescan.matching.result import Outcome
from curvescan.odometry import Odometry, OdometryStep, run_odometry

WRONG_M, WRONG_RAD = 0.3, np.radians(10.0)
"""A matched step this far from wheel odometry is wrong: metres or radians."""


@dataclass(frozen=True, kw_only=True)
class LogJudgement:
    """How one method did on one log, scan to scan.

    Attributes
    ----------
    log, method : str
        Names.
    n_steps : int
        Steps from a scan to the next.
    failures : dict of Outcome to int
        Failed matches by reason, most frequent first.
    n_wrong : int or None
        Matched steps that differ from wheel odometry by more than 0.3 m or 10 degrees; None without odometry.
    median_milliseconds : float
        Time a scan, preparing and matching.
    """

    log: str
    method: str
    n_steps: int
    failures: dict[Outcome, int]
    n_wrong: int | None
    median_milliseconds: float


def judge_log(
    log: Log, method: str, *, on_step: Callable[[OdometryStep], None] | None = None
) -> LogJudgement:
    """Return how a method does on a log with its default parameters.

    Parameters
    ----------
    log : Log
        At least two scans.
    method : str
        Name of a matcher.
    on_step : callable or None
        Called after each scan.
    """
    run = run_odometry(log, Odometry(method), on_step=on_step)
    n_wrong = None
    if log.odometry is not None:
        poses, wheels = run.trajectory.poses, log.odometry.poses
        difference = se2.between(
            se2.between(wheels[:-1], wheels[1:]), se2.between(poses[:-1], poses[1:])
        )
        is_far = np.hypot(difference[:, 0], difference[:, 1]) > WRONG_M
        is_far |= np.abs(difference[:, 2]) > WRONG_RAD
        n_wrong = int(np.count_nonzero(is_far & run.is_matched[1:]))
    return LogJudgement(
        log=log.name,
        method=method,
        n_steps=len(run.outcomes) - 1,
        failures=run.failures,
        n_wrong=n_wrong,
        median_milliseconds=float(1e3 * np.median(run.seconds)),
    )
