"""Where the time of a matcher goes, stage by stage: a stage is a file, as everywhere in this project."""

from __future__ import annotations

import cProfile
import pstats
import time
from collections import defaultdict
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import curvescan
from curvescan.benchmarks.benchmark import easy_pairs
from curvescan.matchers import PreparedScan, match, prepare
from curvescan.runs.document import ResultTable
from curvescan.scan import LaserScan
from curvescan.types import Pose

_PACKAGE = Path(curvescan.__file__).parent


REST = "the rest"  # name of all stages that take less than a hundredth, and of time that belongs to none


@dataclass(frozen=True, kw_only=True)
class StageTime:
    """Mean time that a matcher spends in one stage."""

    method: str  # name of the matcher
    # A file of the package, ``matchers/curvescan/features/surfels.py``, or REST. What a kernel calls counts as its own
    stage: str
    # for each scan that is prepared, each match without a guess, and each with one as good as odometry's
    prepare_seconds: float
    match_seconds: float
    guess_seconds: float


def measure_stages(method: str, *, n_pairs: int = 200, seed: int = 0) -> list[StageTime]:
    """Return the stages of a matcher on simulated pairs, those that take most first.

    They are measured by Python's profiler, which makes each function that is not compiled some 0.5 us slower.
    """
    pairs, guesses = easy_pairs("sick-lms200", n_pairs, seed)

    def prepared(reference: LaserScan, current: LaserScan) -> tuple[PreparedScan, PreparedScan]:
        return prepare(reference, method=method), prepare(current, method=method)

    def matched(reference: PreparedScan, current: PreparedScan, guess: Pose | None = None) -> None:
        match(reference, current, method=method, guess=guess)

    # twice: once compiles, and the second time the scans are new again and have not found out which readings are valid
    ready = [prepared(pair.reference, pair.current) for pair in pairs]
    for (reference, current), guess in zip(ready, guesses, strict=True):
        matched(reference, current)
        matched(reference, current, guess)
    scans = [(replace(pair.reference), replace(pair.current)) for pair in pairs]
    times = [
        _by_stage(prepared, scans, 2),
        _by_stage(matched, ready, 1),
        _by_stage(matched, [(*both, guess) for both, guess in zip(ready, guesses, strict=True)], 1),
    ]
    return _stages(method, times)


def _by_stage(function: Callable[..., object], arguments: Sequence[tuple[Any, ...]], n_each: int) -> dict[str, float]:
    """Return the mean seconds that calls of a function spend in each file of the package."""
    profile = cProfile.Profile(time.perf_counter)
    profile.enable()
    for given in arguments:
        function(*given)
    profile.disable()
    seconds: defaultdict[str, float] = defaultdict(float)
    stats: dict[Any, Any] = pstats.Stats(profile).stats  # type: ignore[attr-defined]
    for (file, _, _), (_, _, own, _, callers) in stats.items():
        if _stage(file) is not None or not callers:
            seconds[_stage(file) or REST] += own
            continue
        # NumPy and the standard library work for whoever calls them
        for (caller, _, _), (_, _, for_caller, _) in callers.items():
            seconds[_stage(caller) or REST] += for_caller
    n = n_each * max(len(arguments), 1)
    return {stage: own / n for stage, own in seconds.items()}


def _stage(file: str) -> str | None:
    path = Path(file)
    if not path.is_relative_to(_PACKAGE) or path == Path(__file__):
        return None
    return path.relative_to(_PACKAGE).as_posix()


def _stages(method: str, times: Sequence[dict[str, float]]) -> list[StageTime]:
    totals = [sum(one.values()) for one in times]
    rows: dict[str, list[float]] = {REST: [0.0] * len(times)}
    for stage in sorted({stage for one in times for stage in one}):
        own = [one.get(stage, 0.0) for one in times]
        is_small = all(seconds < 0.01 * total for seconds, total in zip(own, totals, strict=True))
        if is_small or stage == REST:
            rows[REST] = [a + b for a, b in zip(rows[REST], own, strict=True)]
        else:
            rows[stage] = own
    order = sorted(rows, key=lambda stage: (stage == REST, -sum(rows[stage])))
    return [
        StageTime(
            method=method,
            stage=stage,
            prepare_seconds=rows[stage][0],
            match_seconds=rows[stage][1],
            guess_seconds=rows[stage][2],
        )
        for stage in order
    ]


def stage_table(stages: Sequence[StageTime]) -> ResultTable:
    """Return the table of the stages of matchers."""

    def micro(seconds: float) -> str:
        return f"{1e6 * seconds:.1f} us" if seconds else "-"

    return ResultTable.of(
        "Where the time goes, by file: mean, under a profiler that slows what is not compiled",
        stages,
        [
            ("method", lambda one: one.method),
            ("stage", lambda one: one.stage),
            ("prepare a scan", lambda one: micro(one.prepare_seconds)),
            ("match, no guess", lambda one: micro(one.match_seconds)),
            ("match, good guess", lambda one: micro(one.guess_seconds)),
        ],
    )
