"""The tables of the paper's experiments and of real logs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from curvescan.evaluation.real_logs import LogEvaluation
from curvescan.paper.experiments import ScenarioComparison
from curvescan.paper.random_transform import SUCCESS, Moves, RandomTransformRuns
from curvescan.runs.table import ResultTable


def random_transform_table(
    all_runs: dict[tuple[Moves, float], RandomTransformRuns],
) -> ResultTable:
    """Return a table of experiment 1, beside the paper's figures."""
    rows = []
    for (moves, share), runs in all_runs.items():
        x, y, theta = runs.errors[runs.is_right].mean(axis=0)
        rows.append(
            (
                f"the {moves} moved, {100 * share:.0f} % people",
                f"{len(runs.errors):,}",
                f"{1e3 * x:.1f} mm",
                f"{1e3 * y:.1f} mm",
                f"{np.degrees(theta):.2f} deg",
                f"{1e3 * np.nanmedian(runs.translation_error):.1f} mm",
                f"{runs.n_matched[runs.n_matched > 0].mean():.0f}",
                f"{100 * runs.failed_share:.1f} %",
                f"{100 * runs.right_share:.1f} %",
            )
        )
    rows.append(("paper", "1,000", "12 mm", "22 mm", "lost", "-", "245", "-", "-"))
    return ResultTable(
        title=f"cfsma: mean errors of right matches (within {SUCCESS[0]} m, {np.degrees(SUCCESS[1]):.0f} deg), "
        "median of all that did not fail",
        columns=(
            "scans",
            "runs",
            "mean x",
            "mean y",
            "mean theta",
            "median",
            "mean N_t",
            "failed",
            "right",
        ),
        rows=rows,
    )


def drive_table(drive: ScenarioComparison) -> ResultTable:
    """Return a table of one drive: every method (Tables II to V of the paper)."""
    rows = []
    for method, result in drive.results.items():
        mean = result.variances.mean(axis=0) if len(result.variances) else np.full(3, np.nan)
        largest = result.variances.max(axis=0) if len(result.variances) else np.full(3, np.nan)
        rows.append(
            (
                method,
                f"{1e3 * np.median(result.run.seconds):.2f} ms",
                f"{result.n_failed}",
                f"{result.errors.end_translation:.3f} m, {np.degrees(result.errors.end_rotation):.2f} deg",
                f"{100 * result.errors.drift:.2f} %",
                ", ".join(f"{value:.1e}" for value in mean),
                ", ".join(f"{value:.1e}" for value in largest),
                f"{result.moved.precision:.3f}, {result.moved.recall:.3f}"
                if result.moved.n_true and result.moved.n_said
                else "-",
            )
        )
    return ResultTable(
        title=f"Experiment {drive.experiment.number}: all methods on the same scans, scan to scan",
        columns=(
            "method",
            "time a scan",
            "failed",
            "end pose error",
            "of the path",
            "mean diagonal of C [m², m², rad²]",
            "largest diagonal of C",
            "dynamic readings: precision, recall",
        ),
        rows=rows,
    )


def log_table(judged: Sequence[LogEvaluation]) -> ResultTable:
    """Return a table of how methods did on real logs."""

    def percent(share: float) -> str:
        return "-" if np.isnan(share) else f"{100 * share:.1f} %"

    rows = []
    for one in judged:
        reasons = ", ".join(
            f"{outcome.name.lower()} {100 * count / one.n_steps:.1f} %"
            for outcome, count in one.failures.items()
        )
        distance, angle = one.largest_motion
        off, turned_off = one.median_difference
        rows.append(
            (
                one.log,
                one.method,
                f"{one.n_steps:,}",
                percent(one.right_share),
                percent(one.wrong_share),
                "-" if np.isnan(off) else f"{1e3 * off:.1f} mm, {np.degrees(turned_off):.2f} deg",
                percent(one.n_failed / one.n_steps),
                reasons or "-",
                f"{1e3 * distance:.1f} mm, {np.degrees(angle):.2f} deg",
                f"{1e3 * np.median(one.seconds):.3f} ms",
            )
        )
    return ResultTable(
        title="Consecutive scans of real logs, no guess, laser alone, against the poses in the log",
        columns=(
            "log",
            "method",
            "steps",
            "within 0.25 m, 3 deg",
            "beyond 0.3 m or 10 deg",
            "difference, median",
            "failed",
            "why",
            "motion, 99th percentile",
            "time a scan",
        ),
        rows=rows,
    )


def log_relation_table(judged: Sequence[LogEvaluation]) -> ResultTable:
    """Return the errors of methods against relations, of the logs that have some."""
    rows = []
    for one in judged:
        if one.relations is None or one.run is None:
            continue
        near, far, everything = (one.relations.spreads(w) for w in ("near", "far", "all"))
        rows.append(
            (
                one.log,
                one.method,
                f"{near[0].n:,}, {far[0].n:,}",
                f"{1e3 * near[0].mean:.1f} ± {1e3 * near[0].std:.1f} mm",
                f"{np.degrees(near[1].mean):.3f} ± {np.degrees(near[1].std):.3f} deg",
                f"{everything[0].mean:.3f} ± {everything[0].std:.3f} m",
                f"{np.degrees(everything[1].mean):.2f} ± {np.degrees(everything[1].std):.2f} deg",
                f"{np.count_nonzero(one.run.is_failed):,} of {one.n_steps:,}",
                f"{1e3 * np.median(one.run.seconds):.3f} ms",
            )
        )
    return ResultTable(
        title="Errors of relations, the odometry of each method: key scans for the default matcher, scan to scan for the others",
        columns=(
            "log",
            "method",
            "near, far relations",
            "near: translation",
            "near: rotation",
            "all: translation",
            "all: rotation",
            "failed",
            "time a scan",
        ),
        rows=rows,
    )
