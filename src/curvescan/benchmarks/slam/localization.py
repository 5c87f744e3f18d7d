"""Localization in a saved map: first fixes, tracking, and a sensor that is carried away, against reference poses.

Run as ``python -m curvescan.benchmarks.slam.localization [--floors N]`` on simulated floors, or with ``--log LOG --reference POSES`` on
a log, whose first half makes the map. The map is then read back from its file.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from curvescan import se2
from curvescan.benchmarks.slam.localization_tasks import (
    PARTLY_SHOWN,
    SHOWN,
    LocalizationTask,
    task_of_floor,
    task_of_log,
)
from curvescan.slam import Localizer, LocalizerOutcome, LocalizerStep
from curvescan.types import Bools, Floats, Ints

RIGHT_M, RIGHT_RAD = 0.3, np.radians(5.0)
"""A pose in the map is right within this of the reference, metres and radians."""

FAR_M = 5.0
"""A sensor is carried away at least this far, metres."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Checked:
    """Steps of a localizer held against the reference, a row each.

    Attributes
    ----------
    scan : (n,) int64
        Number of the scan in the log.
    outcomes : tuple of LocalizerOutcome
        Of each.
    shown : (n,) float64
        Share of its readings that the map shows.
    error_m, error_rad : (n,) float64
        Distance and angle from the reference, seen from the keyframe that was matched last and fitted to the map; NaN while the sensor is
        searched for.
    nees : (n,) float64
        Squared Mahalanobis distance from the reference seen from that keyframe, as it is.
    milliseconds : (n,) float64
        Processor time.
    is_matched : (n,) bool
        Whether keyframes were matched at this very scan.
    """

    scan: Ints
    outcomes: tuple[LocalizerOutcome, ...]
    shown: Floats
    error_m: Floats
    error_rad: Floats
    nees: Floats
    milliseconds: Floats
    is_matched: Bools

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


def run_steps(
    task: LocalizationTask, localizer: Localizer, numbers: Sequence[int], *, until_found: bool
) -> Checked:
    """Return the steps of a localizer over some scans, one after the other whatever their stamps say.

    Parameters
    ----------
    task : LocalizationTask
        Map and log.
    localizer : Localizer
        As it is; it is not reset.
    numbers : sequence of int
        Scans.
    until_found : bool
        Whether to stop at the first pose.
    """
    steps: list[LocalizerStep] = []
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


def _errors(
    task: LocalizationTask, k: int, step: LocalizerStep, keyframe: int
) -> tuple[float, float, float]:
    """Return distance, angle and squared Mahalanobis distance of a step from where its scan was taken."""
    reference = task.poses[k] if keyframe < 0 else task.seen_from(keyframe, k)
    off = step.pose - reference
    off[2] = se2.wrap(off[2])
    nees = float(off @ np.linalg.solve(step.covariance, off))
    x, y, theta = se2.between(task.fitted(k, reference), step.pose).tolist()
    return float(np.hypot(x, y)), abs(theta), nees


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


def carried_away(
    task: LocalizationTask, rng: np.random.Generator, *, n_times: int, n_scans: int
) -> list[Checked]:
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


def report(
    task: LocalizationTask, *, n_trials: int, n_carried: int, n_scans: int, seed: int = 0
) -> Iterator[str]:
    """Yield lines on one task."""
    rng = np.random.default_rng(seed)
    yield f"{task.name}: map of {len(task.slam_map):,} keyframes, {len(task.scans):,} scans"
    wanted = np.flatnonzero(task.is_exact)
    starts = rng.choice(wanted, min(n_trials, len(wanted)), replace=False)
    fixes = first_fixes(task, starts, n_most=60)
    for least, most, where in (
        (SHOWN, 1.1, "in the map"),
        (PARTLY_SHOWN, SHOWN, "partly in the map"),
        (0.0, PARTLY_SHOWN, "outside"),
    ):
        chosen = [f for f in fixes if least <= f.shown[0] < most]
        yield f"  first fix, {where}: {_fixes(task, chosen)}"
    yield f"  followed: {_following(task, tracked(task, n_scans))}"
    yield f"  carried away: {_carried(carried_away(task, rng, n_times=n_carried, n_scans=80))}"


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


def _fixes(task: LocalizationTask, fixes: list[Checked]) -> str:
    if not fixes:
        return "none tried"
    found = [f for f in fixes if f.is_known[-1]]
    right = [f for f in found if f.is_right[-1]]
    text = f"{len(right)} of {len(fixes)} right, {len(found) - len(right)} false, {len(fixes) - len(found)} not within 60 scans"
    if not right:
        return text
    n = np.array([len(f.scan) for f in right])
    seconds = np.array([task.scans[f.scan[-1]].stamp - task.scans[f.scan[0]].stamp for f in right])
    spent = np.array([f.milliseconds.sum() for f in right])
    return (
        f"{text}; after one scan {np.sum(n == 1)}; scans to the fix: median {np.median(n):.0f}, 90 % {np.percentile(n, 90):.0f} "
        f"({np.percentile(seconds, 90):.1f} s); "
        f"{np.median(spent):.0f} ms, 90 % {np.percentile(spent, 90):.0f} ms of processor; "
        f"median error {1e3 * np.median([f.error_m[-1] for f in right]):.0f} mm, "
        f"NEES {np.median([f.nees[-1] for f in right]):.1f} in the median, {np.mean([f.nees[-1] for f in right]):.1f} in the mean"
    )


def _following(task: LocalizationTask, steps: Checked) -> str:
    mapped = steps.shown >= SHOWN
    known, right = steps.is_known, steps.is_right
    exact = known & right & mapped & task.is_exact[steps.scan]
    matched = exact & steps.is_matched
    text = (
        f"{_share(known[mapped]):.1%} of the scans in the map have a pose; of all poses "
        f"{_share(right[known]):.1%} are right, of those in the map {_share(right[known & mapped]):.1%}; {np.median(steps.milliseconds):.1f} ms a scan"
    )
    if not matched.any():
        return text
    return (
        f"{text}; median error {1e3 * np.median(steps.error_m[exact]):.0f} mm, {np.degrees(np.median(steps.error_rad[exact])):.2f} deg; "
        f"NEES {np.mean(steps.nees[matched]):.1f}, {np.mean(steps.nees[matched] < 7.815):.0%} within 95 %"
    )


def _carried(times: list[Checked]) -> str:
    if not times:
        return "not tried"
    noticed = [_first(~t.is_known | t.is_right) for t in times]
    found = [_first(t.is_right) for t in times]
    again = np.array([k for k in found if k is not None])
    seen = np.array([k for k in noticed if k is not None])
    text = f"{len(times)} times, noticed {len(seen)}, found again {len(again)}; at the end {sum(bool((t.is_known & ~t.is_right)[-1]) for t in times)} false"
    if len(seen) == 0 or len(again) == 0:
        return text
    return (
        f"{text}; scans until it is noticed: median {np.median(seen):.0f}, 90 % {np.percentile(seen, 90):.0f}; "
        f"until it is found: median {np.median(again):.0f}, 90 % {np.percentile(again, 90):.0f}"
    )


def _share(is_so: Bools) -> float:
    return float(np.mean(is_so)) if is_so.size else float("nan")


def _first(is_so: Bools) -> int | None:
    found = np.flatnonzero(is_so)
    return int(found[0]) if found.size else None


def main(arguments: Sequence[str] | None = None) -> None:
    """Print what localization is worth."""
    parser = argparse.ArgumentParser(prog="python -m curvescan.benchmarks.slam.localization")
    parser.add_argument("--log", type=Path, help="log whose first half makes the map")
    parser.add_argument("--reference", type=Path, help="poses of its sensor")
    parser.add_argument("--stride", type=int, default=1, help="take every so many scans of the log")
    parser.add_argument("--floors", type=int, default=3, help="simulated floors without a log")
    parser.add_argument("--first", type=int, default=0, help="seed of the first floor")
    parser.add_argument("--trials", type=int, default=200, help="random starts")
    parser.add_argument("--seed", type=int, default=0, help="of the random starts")
    parser.add_argument("--carried", type=int, default=30, help="times that it is carried away")
    parser.add_argument("--scans", type=int, default=3000, help="scans that it is followed over")
    given = parser.parse_args(arguments)
    if (given.log is None) != (given.reference is None):
        parser.error("a log needs its reference, and a reference its log")
    if given.log is not None:
        tasks: Iterator[LocalizationTask] = iter(
            [task_of_log(given.log, given.reference, stride=given.stride)]
        )
    else:
        tasks = (
            task_of_floor(seed, n_people=2, moved_share=share)
            for share in (0.0, 0.25)
            for seed in range(given.first, given.first + given.floors)
        )
    before: LocalizationTask | None = None
    for task in tasks:
        for line in report(
            task,
            n_trials=given.trials,
            n_carried=given.carried,
            n_scans=given.scans,
            seed=given.seed,
        ):
            sys.stdout.write(line + "\n")
            sys.stdout.flush()
        if before is not None and not task.name.startswith(before.name):  # not the same floor
            rng = np.random.default_rng(given.seed)
            n_false, n = false_elsewhere(task, before, rng, n_trials=given.trials)
            sys.stdout.write(
                f"  scans of {before.name}, which it does not show: {n_false} of {n} found\n"
            )
        before = task


if __name__ == "__main__":
    main()
