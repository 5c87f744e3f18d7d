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
    tables = [
        _speed(results),
        many_table(results.many),
        _stages(results),
        _growth(results),
        _scenarios(results),
        _open_worlds(results),
    ]
    tables.append(_experiment_1(results))
    if results.logs:
        tables.append(log_table(results.logs))
    return [*tables, reading_table(results.reading)]


def reading_table(speeds: Sequence[ReadingSpeed]) -> ResultTable:
    """Return the table of the times that reading takes, one row a format."""
    sizes = {(speed.n_scans, speed.n_beams) for speed in speeds}
    n_scans, n_beams = max(sizes)
    return ResultTable(
        title=f"Reading a log of {n_scans:,} scans of {n_beams:,} beams, one thread",
        columns=("format", "scans a second", "opening and counting", "bytes a scan"),
        rows=[
            (
                speed.format,
                f"{speed.scans_per_second:,.0f}",
                f"{1e3 * speed.open_seconds:,.0f} ms",
                f"{speed.bytes_per_scan:,.0f}",
            )
            for speed in speeds
        ],
    )


def _speed(results: Benchmark) -> ResultTable:
    return ResultTable(
        title="Time of a scan of 361 beams, one thread: median (99th percentile)",
        columns=("method", "prepare a scan", "match, no guess", "match, good guess"),
        rows=[
            (
                speed.method,
                _milliseconds(speed.prepare_seconds),
                _milliseconds(speed.match_seconds),
                _milliseconds(speed.guess_seconds),
            )
            for speed in results.speeds
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
    return ResultTable(
        title="Where the time goes, by file: mean, under a profiler that slows what is not compiled",
        columns=("method", "stage", "prepare a scan", "match, no guess", "match, good guess"),
        rows=[
            (
                one.method,
                one.stage,
                *(
                    f"{1e6 * seconds:.1f} us" if seconds else "-"
                    for seconds in (one.prepare_seconds, one.match_seconds, one.guess_seconds)
                ),
            )
            for one in results.stages
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
    return ResultTable(
        title=f"Pairs of scans, {results.n_pairs:,} a scenario, no guess; success: within 0.1 m and 2 deg",
        columns=(
            "scenario",
            "method",
            "success",
            "false positives",
            "without a degenerate direction",
            "median error",
            "over the bound",
            "NEES",
            "in 95 %",
        ),
        rows=[
            (
                score.scenario,
                score.method,
                f"{100 * score.success:.1f} %",
                f"{100 * score.false_positives:.1f} %",
                f"{100 * score.unflagged_false_positives:.1f} %",
                f"{1e3 * score.median_error:.2f} mm",
                f"{score.median_error / score.bound:.2f}",
                _figure(score.nees, ".2f"),
                _figure(100 * score.inside_95, ".1f", " %"),
            )
            for score in results.scenarios
        ],
    )


def _open_worlds(results: Benchmark) -> ResultTable:
    return ResultTable(
        title=f"Where a direction is unobservable, {results.n_pairs:,} pairs each",
        columns=("world", "method", "ok", "names the direction", "NEES, median", "in 95 %"),
        rows=[
            (
                score.world,
                score.method,
                f"{100 * score.ok:.1f} %",
                _figure(100 * score.flagged, ".1f", " %"),
                f"{_figure(score.nees, '.3g')}, {_figure(score.nees_median, '.3g')}",
                _figure(100 * score.inside_95, ".1f", " %"),
            )
            for score in results.open_worlds
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
