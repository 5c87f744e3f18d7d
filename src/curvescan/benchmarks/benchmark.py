"""All that `curvescan bench` measures: time, success, accuracy and consistency of every method, and its tables."""

import math
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from curvescan.benchmarks.scenarios import OPEN_WORLDS, SCENARIOS, score_open, score_scenario
from curvescan.evaluation.real_logs import check_logs, evaluate_log
from curvescan.io.log import Log
from curvescan.matchers import MATCHERS, match, prepare
from curvescan.paper.experiments import Progress, in_silence
from curvescan.paper.random_transform import CONDITIONS, RandomTransformRuns, check_n_runs, run_random_transforms
from curvescan.paper.tables import log_table
from curvescan.runs.document import ResultTable
from curvescan.simulation import SENSORS, ScanPair, Sensor, simulate_pairs
from curvescan.types import Floats, Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class Speed:
    """Times of one matcher over many pairs of scans."""

    method: str  # name of the matcher
    prepare_seconds: Floats  # (2 m,): time of each preparation of a scan
    match_seconds: Floats  # (m,): time of each match of two prepared scans, without a guess
    guess_seconds: Floats  # (m,): the same with a guess as good as odometry's: 2 cm and 1 degree off


def easy_pairs(sensor: str | Sensor, n_pairs: int, seed: int) -> tuple[list[ScanPair], list[Pose]]:
    """Return pairs of scans at most 0.1 m and 5 deg apart, each of its own office, and a guess as by odometry."""
    turn = np.radians(5.0)
    pairs = simulate_pairs("office", sensor=sensor, n_pairs=n_pairs, translation_max=0.1, rotation_max=turn, seed=seed)
    rng = np.random.default_rng(seed)
    listed = list(pairs)
    return listed, [pair.pose + rng.normal(0.0, [0.02, 0.02, np.radians(1.0)]) for pair in listed]


def measure_speed(
    method: str, *, sensor: str | Sensor = "sick-lms200", n_pairs: int = 200, repeats: int = 5, seed: int = 0
) -> Speed:
    """Return the times of a matcher on simulated pairs, one thread."""
    pairs, guesses = easy_pairs(sensor, n_pairs, seed)
    for pair in pairs[:20]:
        match(pair.reference, pair.current, method=method)  # compiles
    rows = []
    for _ in range(repeats):
        for pair, guess in zip(pairs, guesses, strict=True):
            # a new scan, which has not yet found out which of its readings are valid
            reference, current = replace(pair.reference), replace(pair.current)
            times = [time.perf_counter()]
            prepared_ref = prepare(reference, method=method)
            times.append(time.perf_counter())
            prepared_cur = prepare(current, method=method)
            times.append(time.perf_counter())
            match(prepared_ref, prepared_cur, method=method)
            times.append(time.perf_counter())
            match(prepared_ref, prepared_cur, method=method, guess=guess)
            rows.append(np.diff([*times, time.perf_counter()]))
    seconds = np.array(rows)
    return Speed(
        method=method, prepare_seconds=seconds[:, :2].ravel(), match_seconds=seconds[:, 2], guess_seconds=seconds[:, 3]
    )


def with_beams(n_beams: int) -> Sensor:
    """Return the LMS200 with another number of beams over the same 180 degrees."""
    base = SENSORS["sick-lms200"]
    step = base.angle_increment * (base.n_beams - 1) / (n_beams - 1)
    return replace(base, name=f"{n_beams} beams", n_beams=n_beams, angle_increment=step)


BEAM_COUNTS = (181, 361, 721, 1441, 2881, 4001)  # beams over 180 degrees for which times are taken
EXPERIMENT_1_WORLDS = ("room", "office", "building")  # simulated worlds of experiment 1

EXPERIMENT_1_SENSOR = "sick-lms200"
"""Conditions of experiment 1 with this sensor are run, the one of all other benchmarks: 10 mm of noise."""


def run_benchmark(
    *,
    methods: Sequence[str] = tuple(MATCHERS),
    n_pairs: int = 300,
    n_runs: int = 1000,
    logs: Sequence[Log] = (),
    seed: int = 0,
    progress: Progress = in_silence,
) -> list[ResultTable]:
    """Return tables of time, success, accuracy and consistency of methods on simulated pairs and real logs."""
    check_logs(logs)
    check_n_runs(n_runs)
    n_timed = min(n_pairs, 200)
    tables = [
        _time_table(methods, n_timed, seed, progress),
        _growth_table(methods, min(n_timed, 10), seed, progress),
        _scenario_table(methods, n_pairs, seed + 1, progress),
        _open_world_table(methods, n_pairs, seed + 1, progress),
        _experiment_1_table(n_runs, seed, progress),
    ]
    judged = [
        evaluate_log(log, method, on_step=progress(f"{log.name}, {method}", len(log) - 1))
        for log in logs
        for method in methods
    ]
    return [*tables, log_table(judged)] if judged else tables


def _time_table(methods: Sequence[str], n_pairs: int, seed: int, progress: Progress) -> ResultTable:
    def measured(method: str) -> Speed:
        advance = progress(f"time of {method}", 1)
        speed = measure_speed(method, n_pairs=n_pairs, seed=seed)
        advance()
        return speed

    return ResultTable.of(
        "Time of a scan of 361 beams, one thread: median (99th percentile)",
        map(measured, methods),
        [
            ("method", lambda one: one.method),
            ("prepare a scan", lambda one: _milliseconds(one.prepare_seconds)),
            ("match, no guess", lambda one: _milliseconds(one.match_seconds)),
            ("match, good guess", lambda one: _milliseconds(one.guess_seconds)),
        ],
    )


def _growth_table(methods: Sequence[str], n_pairs: int, seed: int, progress: Progress) -> ResultTable:
    rows = []
    for method in methods:
        advance = progress(f"time of {method} by beams", len(BEAM_COUNTS))
        medians = []
        for n_beams in BEAM_COUNTS:
            speed = measure_speed(method, sensor=with_beams(n_beams), n_pairs=n_pairs, repeats=3, seed=seed)
            medians.append((np.median(speed.prepare_seconds), np.median(speed.match_seconds)))
            advance()
        for what, seconds in zip(("prepare", "match"), zip(*medians, strict=True), strict=True):
            rows.append((f"{method}, {what}", *(f"{1e3 * s:.3f} ms" for s in seconds)))
    return ResultTable(
        title="Growth with the number of beams over 180 deg: median",
        columns=("method", *(f"{n:,} beams" for n in BEAM_COUNTS)),
        rows=rows,
    )


def _scenario_table(methods: Sequence[str], n_pairs: int, seed: int, progress: Progress) -> ResultTable:
    scores = [
        score
        for one in SCENARIOS
        for score in score_scenario(one, methods, n_pairs=n_pairs, seed=seed, on_pair=progress(one.name, n_pairs))
    ]
    return ResultTable.of(
        f"Pairs of scans, {n_pairs:,} a scenario, no guess; success: within 0.1 m and 2 deg",
        scores,
        [
            ("scenario", lambda one: one.scenario),
            ("method", lambda one: one.method),
            ("success", lambda one: f"{100 * one.success:.1f} %"),
            ("false positives", lambda one: f"{100 * one.false_positives:.1f} %"),
            ("without a degenerate direction", lambda one: f"{100 * one.unflagged_false_positives:.1f} %"),
            ("median error", lambda one: f"{1e3 * one.median_error:.2f} mm"),
            ("over the bound", lambda one: f"{one.median_error / one.bound:.2f}"),
            ("NEES", lambda one: _figure(one.nees, ".2f")),
            ("in 95 %", lambda one: _figure(100 * one.inside_95, ".1f", " %")),
        ],
    )


def _open_world_table(methods: Sequence[str], n_pairs: int, seed: int, progress: Progress) -> ResultTable:
    scores = [
        score
        for world in OPEN_WORLDS
        for score in score_open(world, methods, n_pairs=n_pairs, seed=seed, on_pair=progress(world, n_pairs))
    ]
    return ResultTable.of(
        f"Where a direction is unobservable, {n_pairs:,} pairs each",
        scores,
        [
            ("world", lambda one: one.scenario),
            ("method", lambda one: one.method),
            ("ok", lambda one: f"{100 * one.ok:.1f} %"),
            ("names the direction", lambda one: _figure(100 * one.flagged, ".1f", " %")),
            ("NEES, median", lambda one: f"{_figure(one.nees, '.3g')}, {_figure(one.nees_median, '.3g')}"),
            ("in 95 %", lambda one: _figure(100 * one.inside_95, ".1f", " %")),
        ],
    )


def _experiment_1_table(n_runs: int, seed: int, progress: Progress) -> ResultTable:
    rows = []
    for world in EXPERIMENT_1_WORLDS:
        for condition in (one for one in CONDITIONS if one.sensor == EXPERIMENT_1_SENSOR):
            on_run = progress(f"experiment 1, {world}, {condition.title}", n_runs)
            (runs,) = run_random_transforms(condition, n_runs=n_runs, world=world, seed=seed, on_run=on_run)
            rows.append((world, condition.title, *_errors(runs)))
    return ResultTable(
        title=f"Experiment 1, cfsma, {n_runs:,} runs each: median errors of the matches that did not fail",
        columns=("world", "condition", "translation", "rotation", "mean N_t", "failed", "within 0.1 m, 2 deg"),
        rows=rows,
    )


def _errors(runs: RandomTransformRuns) -> tuple[str, ...]:
    found = runs.n_matched > 0
    shares = (f"{100 * runs.failed_share:.1f} %", f"{100 * runs.right_share:.1f} %")
    if not found.any():
        return ("-", "-", "-", *shares)
    return (
        f"{1e3 * np.median(runs.translation_error[found]):.1f} mm",
        f"{np.degrees(np.median(runs.rotation_error[found])):.2f} deg",
        f"{runs.n_matched[found].mean():.0f}",
        *shares,
    )


def _figure(value: float, form: str, unit: str = "") -> str:
    return "-" if math.isnan(value) else f"{value:{form}}{unit}"


def _milliseconds(seconds: Floats) -> str:
    median, p99 = 1e3 * np.percentile(seconds, [50, 99])
    return f"{median:.3f} ms ({p99:.3f} ms)"
