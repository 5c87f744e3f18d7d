"""Runs of a localizer held against reference poses: first fixes, tracking, and a sensor that is carried away."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan.odometry import Step, StepOutcome
from curvescan.slam import Localizer
from curvescan.types import Bools, Floats, Ints
from localization_tasks import SHOWN, LocalizationTask

RIGHT_M, RIGHT_RAD = 0.3, np.radians(5.0)
"""A pose in the map is right within this of the reference, metres and radians."""

FAR_M = 5.0
"""A sensor is carried away at least this far, metres."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Checked:
    """Steps of a localizer held against the reference, a row each."""

    scan: Ints  # (n,): number of the scan in the log
    outcomes: tuple[StepOutcome, ...]  # of each
    shown: Floats  # (n,): share of its readings that the map shows
    # (n,): distance and angle from the reference, seen from the keyframe that was matched last, as it is or fitted to
    # the map; NaN while the sensor is searched for
    error_m: Floats
    error_rad: Floats
    nees: Floats  # (n,): squared Mahalanobis distance from the reference seen from that keyframe, as it is
    milliseconds: Floats  # (n,): processor time
    is_matched: Bools  # (n,): whether keyframes were matched at this very scan

    @property
    def is_known(self) -> Bools:
        """Whether a pose was given."""
        known: Bools = np.isfinite(self.error_m)
        return known

    @property
    def is_right(self) -> Bools:
        """Whether the pose given is right."""
        right: Bools = (self.error_m < RIGHT_M) & (self.error_rad < RIGHT_RAD)
        return right


def run_steps(task: LocalizationTask, localizer: Localizer, numbers: Sequence[int], *, until_found: bool) -> Checked:
    """Return the steps of a localizer over some scans, one after the other whatever their stamps say."""
    steps: list[Step] = []
    spent = []
    for k in numbers:
        started = time.process_time()
        steps.append(localizer.add(task.scans[k]))
        spent.append(1e3 * (time.process_time() - started))
        if until_found and steps[-1].ok:
            break
    taken = np.asarray(numbers[: len(steps)], dtype=np.int64)
    errors, keyframe = np.full((len(steps), 3), np.nan), -1
    for n, step in enumerate(steps):
        keyframe = step.keyframe if step.keyframe >= 0 else keyframe
        if step.ok:
            errors[n] = _errors(task, int(taken[n]), step, keyframe)
    return Checked(
        scan=taken,
        outcomes=tuple(s.outcome for s in steps),
        shown=np.array([task.shown(int(k)) for k in taken]),
        error_m=errors[:, 0],
        error_rad=errors[:, 1],
        nees=errors[:, 2],
        milliseconds=np.array(spent),
        is_matched=np.array([s.keyframe >= 0 for s in steps], dtype=np.bool_),
    )


def _errors(task: LocalizationTask, k: int, step: Step, keyframe: int) -> tuple[float, float, float]:
    """Return distance, angle and squared Mahalanobis distance of a step from where its scan was taken.

    Where the map has a wall twice, a little apart, the reference may be fitted to the other one than the keyframe's:
    the nearer of the two counts.
    """
    reference = task.poses[k] if keyframe < 0 else task.seen_from(keyframe, k)
    off = step.pose - reference
    off[2] = se2.wrap(off[2])
    nees = float(off @ np.linalg.solve(step.covariance, off))
    both = np.array([reference, task.fitted(k, reference)])
    x, y, theta = se2.between(both, step.pose).T
    distance = np.hypot(x, y)
    nearer = int(np.argmin(distance))
    return float(distance[nearer]), float(abs(theta[nearer])), nees


def first_fixes(
    task: LocalizationTask, starts: Ints, *, n_most: int, localizer: Localizer | None = None
) -> list[Checked]:
    """Return for each start the steps up to the first pose, at most `n_most`, of a localizer that knows nothing."""
    localizer = localizer or Localizer(task.slam_map)
    found = []
    for start in starts.tolist():
        localizer.reset()
        numbers = range(start, min(start + n_most, len(task.scans)))
        found.append(run_steps(task, localizer, numbers, until_found=True))
    return found


def tracked(task: LocalizationTask, n_scans: int) -> Checked:
    """Return one pass over the log, from its first scan on."""
    numbers = range(min(n_scans, len(task.scans)))
    return run_steps(task, Localizer(task.slam_map), numbers, until_found=False)


def carried_away(task: LocalizationTask, rng: np.random.Generator, *, n_times: int, n_scans: int) -> list[Checked]:
    """Return for each time that the sensor was carried away the steps since; before each its pose was known and right."""
    usable = np.arange(max(len(task.scans) - n_scans, 0))
    usable = rng.permutation(usable)[: 50 * n_times]
    usable = usable[[task.shown(int(k)) >= SHOWN for k in usable]]
    if len(usable) == 0:
        return []
    localizer = Localizer(task.slam_map)
    here, is_ready = int(rng.choice(usable)), False
    found = []
    for _ in range(2 * n_times + 1):
        steps = run_steps(task, localizer, range(here, here + n_scans), until_found=False)
        if is_ready:
            found.append(steps)
        is_ready = bool(steps.is_right[-1])
        if not is_ready:
            localizer.reset()
        last = task.poses[steps.scan[-1], :2]
        far = usable[np.hypot(*(task.poses[usable, :2] - last).T) > FAR_M]
        if len(found) == n_times or len(far) == 0:
            break
        here = int(rng.choice(far))
    return found


def false_elsewhere(
    task: LocalizationTask, other: LocalizationTask, rng: np.random.Generator, *, n_trials: int
) -> tuple[int, int]:
    """Return in how many of how many starts a sensor on another floor is found in a map that does not show it, within 30 scans."""
    localizer = Localizer(task.slam_map)
    starts = rng.choice(len(other.scans) - 30, min(n_trials, len(other.scans) - 30), replace=False)
    n_false = 0
    for start in starts.tolist():
        localizer.reset()
        n_false += any(localizer.add(other.scans[k]).ok for k in range(start, start + 30))
    return n_false, len(starts)
