"""Localization in a saved map: single scans, first fixes, tracking, and a sensor that is carried away, against reference poses.

Run as ``python bench/localization.py [--floors N]`` on simulated floors, or with ``--log LOG --reference POSES`` on
a log, whose first half makes the map. The map is then read back from its file.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

import localization_single as single
from curvescan.types import Bools
from localization_runs import Checked, carried_away, false_elsewhere, first_fixes, tracked
from localization_tasks import FLOORS, PARTS, SHOWN, LocalizationTask, task_of_floor, task_of_log


def report(
    task: LocalizationTask,
    *,
    n_trials: int,
    n_carried: int,
    n_scans: int,
    seed: int = 0,
    n_single: int = 0,
    is_mapped_only: bool = False,
    picture: Path | None = None,
) -> Iterator[str]:
    """Yield lines on one task; the picture is of its single scans."""
    rng = np.random.default_rng(seed)
    yield f"{task.name}: map of {len(task.slam_map):,} keyframes, {len(task.scans):,} scans"
    wanted = np.flatnonzero(task.is_exact)
    if n_single:
        chosen = rng.choice(wanted, min(n_single, len(wanted)), replace=False)
        scans = first_fixes(task, chosen, n_most=1)
        yield from single.lines(scans)
        if picture is not None:
            single.draw(picture, task, scans)
    if is_mapped_only:
        wanted = np.array([k for k in rng.permutation(wanted) if task.shown(int(k)) >= SHOWN])
    starts = rng.choice(wanted, min(n_trials, len(wanted)), replace=False)
    fixes = first_fixes(task, starts, n_most=60)
    for least, most, where in PARTS:
        chosen_fixes = [f for f in fixes if least <= f.shown[0] < most]
        yield f"  first fix, {where}: {_fixes(task, chosen_fixes)}"
    if n_scans:
        yield f"  followed: {_following(task, tracked(task, n_scans))}"
    yield f"  carried away: {_carried(carried_away(task, rng, n_times=n_carried, n_scans=80))}"


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
        f"{text}; after one scan {np.sum(n == 1)}; scans to the fix: median {np.median(n):.0f}, 90 % "
        f"{np.percentile(n, 90):.0f} "
        f"({np.percentile(seconds, 90):.1f} s); "
        f"{np.median(spent):.0f} ms, 90 % {np.percentile(spent, 90):.0f} ms of processor; "
        f"median error {1e3 * np.median([f.error_m[-1] for f in right]):.0f} mm, "
        f"NEES {np.median([f.nees[-1] for f in right]):.1f} in the median, "
        f"{np.mean([f.nees[-1] for f in right]):.1f} in the mean"
    )


def _following(task: LocalizationTask, steps: Checked) -> str:
    mapped = steps.shown >= SHOWN
    known, right = steps.is_known, steps.is_right
    exact = known & right & mapped & task.is_exact[steps.scan]
    matched = exact & steps.is_matched
    text = (
        f"{_share(known[mapped]):.1%} of the scans in the map have a pose; of all poses "
        f"{_share(right[known]):.1%} are right, of those in the map {_share(right[known & mapped]):.1%}; "
        f"{np.median(steps.milliseconds):.1f} ms a scan"
    )
    if not matched.any():
        return text
    return (
        f"{text}; median error {1e3 * np.median(steps.error_m[exact]):.0f} mm, "
        f"{np.degrees(np.median(steps.error_rad[exact])):.2f} deg; "
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
    parser = argparse.ArgumentParser(prog="python bench/localization.py")
    parser.add_argument("--log", type=Path, help="log whose first half makes the map")
    parser.add_argument("--reference", type=Path, help="poses of its sensor")
    parser.add_argument("--stride", type=int, default=1, help="take every so many scans of the log")
    parser.add_argument("--floors", type=int, default=3, help="simulated floors without a log")
    parser.add_argument("--kinds", default="", help=f"kinds of floors, of {''.join(FLOORS)}")
    parser.add_argument("--first", type=int, default=0, help="seed of the first floor")
    parser.add_argument("--trials", type=int, default=200, help="random starts")
    parser.add_argument("--seed", type=int, default=0, help="of the random starts")
    parser.add_argument("--single", type=int, default=0, help="single scans, each alone")
    parser.add_argument("--mapped", action="store_true", help="start in the map only")
    parser.add_argument("--draw", type=Path, help="the PNG of the single scans to write")
    parser.add_argument("--closed", type=int, default=0, help="doors that are closed by then")
    parser.add_argument("--carried", type=int, default=30, help="times that it is carried away")
    parser.add_argument("--scans", type=int, default=3000, help="scans that it is followed over")
    given = parser.parse_args(arguments)
    if (given.log is None) != (given.reference is None):
        parser.error("a log needs its reference, and a reference its log")
    if given.log is not None:
        tasks: Iterator[LocalizationTask] = iter([task_of_log(given.log, given.reference, stride=given.stride)])
    elif given.kinds:
        tasks = (
            replace(task_of_floor(seed, **FLOORS[kind]), name=f"{kind} {seed}")
            for kind in given.kinds
            for seed in range(given.first, given.first + given.floors)
        )
    else:
        tasks = (
            task_of_floor(seed, n_people=2, moved_share=share, n_closed=given.closed)
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
            n_single=given.single,
            is_mapped_only=given.mapped,
            picture=given.draw,
        ):
            sys.stdout.write(line + "\n")
            sys.stdout.flush()
        if before is not None and not task.name.startswith(before.name):  # not the same floor
            rng = np.random.default_rng(given.seed)
            n_false, n = false_elsewhere(task, before, rng, n_trials=given.trials)
            sys.stdout.write(f"  scans of {before.name}, which it does not show: {n_false} of {n} found\n")
        before = task


if __name__ == "__main__":
    main()
