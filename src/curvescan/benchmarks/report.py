"""The tables of a benchmark."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path

import numpy as np

from curvescan.benchmarks.benchmark import BEAM_COUNTS, Benchmark
from curvescan.benchmarks.io_speed import ReadingSpeed
from curvescan.paper.random_transform import RandomTransformRuns
from curvescan.paper.tables import log_table
from curvescan.runs.table import ResultTable
from curvescan.types import Floats


def save_benchmark(folder: Path, results: Benchmark) -> None:
    """Write bench.md into an existing folder."""
    text = "\n".join(table.markdown() for table in benchmark_tables(results))
    (folder / "bench.md").write_text(text, encoding="utf-8", newline="\n")


def benchmark_tables(results: Benchmark) -> list[ResultTable]:
    """Return the tables of a benchmark, in the order in which it was measured."""
    parts = (_speed, _stages, _growth, _scenarios, _open_worlds, _experiment_1)
    speed, *others = (part(results) for part in parts)
    logs = [log_table(results.logs)] if results.logs else []
    return [speed, many_table(results.many), *others, *logs, reading_table(results.reading)]


def reading_table(speeds: Sequence[ReadingSpeed]) -> ResultTable:
    """Return the table of the times that reading takes, one row a format."""
    sizes = {(speed.n_scans, speed.n_beams) for speed in speeds}
    n_scans, n_beams = max(sizes)
    return ResultTable.of(
        f"Reading a log of {n_scans:,} scans of {n_beams:,} beams, one thread",
        speeds,
        [
            ("format", lambda one: one.format),
            ("scans a second", lambda one: f"{one.scans_per_second:,.0f}"),
            ("opening and counting", lambda one: f"{1e3 * one.open_seconds:,.0f} ms"),
            ("bytes a scan", lambda one: f"{one.bytes_per_scan:,.0f}"),
        ],
    )


def _speed(results: Benchmark) -> ResultTable:
    return ResultTable.of(
        "Time of a scan of 361 beams, one thread: median (99th percentile)",
        results.speeds,
        [
            ("method", lambda one: one.method),
            ("prepare a scan", lambda one: _milliseconds(one.prepare_seconds)),
            ("match, no guess", lambda one: _milliseconds(one.match_seconds)),
            ("match, good guess", lambda one: _milliseconds(one.guess_seconds)),
        ],
    )


def many_table(seconds: Mapping[str, float]) -> ResultTable:
    """Return the table of the times of many matches, one row a way to call them."""
    return ResultTable(
        title="Many matches of prepared scans, curvescan, good guesses: mean",
        columns=("call", "a match"),
        rows=[(call, f"{1000 * one:.3f} ms") for call, one in seconds.items()],
    )


def _stages(results: Benchmark) -> ResultTable:
    def micro(seconds: float) -> str:
        return f"{1e6 * seconds:.1f} us" if seconds else "-"

    return ResultTable.of(
        "Where the time goes, by file: mean, under a profiler that slows what is not compiled",
        results.stages,
        [
            ("method", lambda one: one.method),
            ("stage", lambda one: one.stage),
            ("prepare a scan", lambda one: micro(one.prepare_seconds)),
            ("match, no guess", lambda one: micro(one.match_seconds)),
            ("match, good guess", lambda one: micro(one.guess_seconds)),
        ],
    )


def _growth(results: Benchmark) -> ResultTable:
    rows = []
    for method, speeds in results.growth.items():
        for what, seconds in (
            ("prepare", [speed.prepare_seconds for speed in speeds]),
            ("match", [speed.match_seconds for speed in speeds]),
        ):
            rows.append((f"{method}, {what}", *(f"{1e3 * np.median(s):.3f} ms" for s in seconds)))
    return ResultTable(
        title="Growth with the number of beams over 180 deg: median",
        columns=("method", *(f"{n:,} beams" for n in BEAM_COUNTS)),
        rows=rows,
    )


def _scenarios(results: Benchmark) -> ResultTable:
    return ResultTable.of(
        f"Pairs of scans, {results.n_pairs:,} a scenario, no guess; success: within 0.1 m and 2 deg",
        results.scenarios,
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


def _open_worlds(results: Benchmark) -> ResultTable:
    return ResultTable.of(
        f"Where a direction is unobservable, {results.n_pairs:,} pairs each",
        results.open_worlds,
        [
            ("world", lambda one: one.world),
            ("method", lambda one: one.method),
            ("ok", lambda one: f"{100 * one.ok:.1f} %"),
            ("names the direction", lambda one: _figure(100 * one.flagged, ".1f", " %")),
            ("NEES, median", lambda one: f"{_figure(one.nees, '.3g')}, {_figure(one.nees_median, '.3g')}"),
            ("in 95 %", lambda one: _figure(100 * one.inside_95, ".1f", " %")),
        ],
    )


def _experiment_1(results: Benchmark) -> ResultTable:
    return ResultTable(
        title=f"Experiment 1, cfsma, {results.n_runs:,} runs each: median errors of the matches that did not fail",
        columns=("world", "condition", "translation", "rotation", "mean N_t", "failed", "within 0.1 m, 2 deg"),
        rows=[(world, condition.title, *_errors(runs)) for (world, condition), runs in results.experiment_1.items()],
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
