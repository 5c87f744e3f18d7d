"""Odometry: a stream of scans in, a trajectory out, each scan matched with the one before it (eq. 1).

The only place that holds state. Its one verb is ``add(scan)``.
"""

from __future__ import annotations

import time
from array import array
from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from enum import Enum

import numpy as np

from curvescan import se2
from curvescan.errors import InvalidArgumentError
from curvescan.matching import DEFAULT_METHOD, MatchResult, Outcome, PreparedScan, match, prepare
from curvescan.matching.registry import find_matcher
from curvescan.scan import LaserScan
from curvescan.types import Bools, Cov, Floats, Ints, Pose, Trajectory


class StepOutcome(Enum):
    """How a scan got its pose; the value is a sentence for people."""

    STARTED = "First scan: its sensor frame is the frame of the trajectory."
    MATCHED = "Matched with the scan before it."
    PREDICTED = "The match failed: the last motion was repeated."
    HELD = "Matches keep failing: the sensor is taken to stand still."


@dataclass(frozen=True, kw_only=True)
class OdometryConfig:
    """How the odometry goes on where a match fails."""

    prediction_sigma_m: float = 0.1
    """Standard deviation of a repeated motion's translation, metres a step and axis."""
    prediction_sigma_rad: float = 0.1
    """Standard deviation of a repeated motion's rotation, radians a step."""
    max_predictions: int = 5
    """Failures in a row after which the last motion is no longer repeated and the pose is held."""

    def __post_init__(self) -> None:
        for name in ("prediction_sigma_m", "prediction_sigma_rad"):
            if not getattr(self, name) > 0.0:
                raise InvalidArgumentError(f"{name} must be > 0, got {getattr(self, name)}")
        if self.max_predictions < 0:
            raise InvalidArgumentError(f"max_predictions must be >= 0, got {self.max_predictions}")

    @property
    def prediction_covariance(self) -> Cov:
        """(3, 3) covariance of a repeated motion."""
        return np.diag(
            [self.prediction_sigma_m**2, self.prediction_sigma_m**2, self.prediction_sigma_rad**2]
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class OdometryStep:
    """Where the sensor was at one scan.

    Attributes
    ----------
    index : int
        Number of the scan, from 0.
    stamp : float
        Its stamp, seconds.
    pose : (3,) float64
        [x, y, theta] of the sensor in the frame of the first scan: metres, metres, radians.
    covariance : (3, 3) float64
        Covariance of the pose, x, y, theta; zero at the first scan.
    outcome : StepOutcome
        How the pose came about.
    match : MatchResult or None
        The match behind it, also where it failed; None at the first scan.
    reference : int or None
        Number of the scan that `match` was tried with; None at the first scan.
    """

    index: int
    stamp: float
    pose: Pose
    covariance: Cov
    outcome: StepOutcome
    match: MatchResult | None
    reference: int | None


class Odometry:
    """Chain of matches, scan to scan.

    The last motion, repeated, is the guess of the next match: it halves the time of a matcher that takes one, and
    decides between poses that look alike.

    A failed match keeps the prediction of the last motion and says so; the failed scan becomes the next
    reference, so that the chain is never stuck on an old one. Only a scan in which the matcher finds
    nothing at all (a covered sensor) is passed over as a reference: the one before it stays.

    Parameters
    ----------
    method : str
        Name of the matcher.
    matcher_config : object or None
        The matcher's configuration; None for its defaults.
    config : OdometryConfig or None
        None for the defaults.

    Raises
    ------
    InvalidArgumentError
        When the method is unknown or the config is another method's.
    """

    def __init__(
        self,
        method: str = DEFAULT_METHOD,
        *,
        matcher_config: object | None = None,
        config: OdometryConfig | None = None,
    ) -> None:
        self.method = method
        self.matcher_config = matcher_config
        self.config = config or OdometryConfig()
        self.matcher = find_matcher(method, matcher_config)
        self._n_scans = 0
        self._n_failures = 0  # in a row
        self._reference: PreparedScan | None = None
        self._reference_idx = 0
        self._pose_w_ref, self._cov_w_ref = se2.identity(), np.zeros((3, 3))
        self._pose_w_last, self._cov_w_last = se2.identity(), np.zeros((3, 3))
        self._motion = se2.identity()  # pose of the last scan in the one before

    def add(self, scan: LaserScan) -> OdometryStep:
        """Return where the sensor was at this scan, matched with the one before.

        Parameters
        ----------
        scan : LaserScan
            The next scan; its stamp is kept and not used, the order of the calls is the order.

        Returns
        -------
        OdometryStep
            Pose and covariance in the frame of the first scan, and how they came about.

        Raises
        ------
        InvalidArgumentError
            When `scan` is not a LaserScan.
        """
        current = prepare(scan, method=self.method, config=self.matcher_config)
        reference_idx = None
        if self._reference is None:
            result, outcome = None, StepOutcome.STARTED
        else:
            reference_idx = self._reference_idx
            result = match(
                self._reference,
                current,
                method=self.method,
                guess=se2.between(self._pose_w_ref, se2.compose(self._pose_w_last, self._motion)),
                config=self.matcher_config,
            )
            outcome = self._move(result)
        if self._reference is None or current.matcher.can_be_reference(current.features):
            self._reference, self._reference_idx = current, self._n_scans
            self._pose_w_ref, self._cov_w_ref = self._pose_w_last, self._cov_w_last
        step = OdometryStep(
            index=self._n_scans,
            stamp=scan.stamp,
            pose=self._pose_w_last.copy(),
            covariance=self._cov_w_last.copy(),
            outcome=outcome,
            match=result,
            reference=reference_idx,
        )
        self._n_scans += 1
        return step

    def _move(self, result: MatchResult) -> StepOutcome:
        """Set the pose of the new scan from a match, or from the last motion where it failed."""
        if result.ok:
            self._n_failures = 0
            pose = se2.compose(self._pose_w_ref, result.pose)
            self._cov_w_last = se2.compose_covariance(
                self._pose_w_ref, self._cov_w_ref, result.pose, result.covariance
            )
            self._motion = se2.between(self._pose_w_last, pose)
            self._pose_w_last = pose
            return StepOutcome.MATCHED
        self._n_failures += 1
        is_held = self._n_failures > self.config.max_predictions
        if is_held:
            self._motion = se2.identity()
        self._cov_w_last = se2.compose_covariance(
            self._pose_w_last, self._cov_w_last, self._motion, self.config.prediction_covariance
        )
        self._pose_w_last = se2.compose(self._pose_w_last, self._motion)
        return StepOutcome.HELD if is_held else StepOutcome.PREDICTED


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
    n_matched : (n,) int64
        Matched pairs of readings behind each pose; 0 where there was no match.
    seconds : (n,) float64
        Time that ``Odometry.add`` took for each scan.
    is_partial : bool
        Whether the run was interrupted before the end of the log.
    """

    method: str
    trajectory: Trajectory
    outcomes: tuple[StepOutcome, ...]
    failures: dict[Outcome, int]
    n_matched: Ints
    seconds: Floats
    is_partial: bool

    @property
    def is_matched(self) -> Bools:
        """(n,) whether each pose comes from a match with the scan before it; False at the first."""
        return np.array([o is StepOutcome.MATCHED for o in self.outcomes], dtype=np.bool_)

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
    on_step: Callable[[OdometryStep], None] | None = None,
) -> OdometryRun:
    """Return the odometry of a sequence of scans.

    Ctrl-C (KeyboardInterrupt) ends the run and gives what there is so far, marked as partial.

    Parameters
    ----------
    scans : iterable of LaserScan
        A log, or any iterable; one scan is held at a time.
    odometry : Odometry or None
        A fresh one; None for the defaults.
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
    n_matched = array("q")
    failures: Counter[Outcome] = Counter()
    is_partial = False
    try:
        for scan in scans:
            started = time.perf_counter()
            step = odometry.add(scan)
            seconds.append(time.perf_counter() - started)
            stamps.append(step.stamp)
            poses.extend(step.pose)
            covariances.extend(step.covariance.ravel())
            n_matched.append(step.match.n_matched if step.match else 0)
            if step.match and not step.match.ok:
                failures[step.match.outcome] += 1
            outcomes.append(step.outcome)
            if on_step:
                on_step(step)
    except KeyboardInterrupt:
        is_partial = True
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
        n_matched=np.array(n_matched[:n], dtype=np.int64),
        seconds=np.array(seconds[:n]),
        is_partial=is_partial,
    )
