"""The tables of the paper's experiments and of real logs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from curvescan.evaluation.real_logs import LogEvaluation
from curvescan.paper.experiments import ScenarioComparison
from curvescan.paper.random_transform import SUCCESS, RandomTransformCondition, TransformResult
from curvescan.runs.table import ResultTable
from curvescan.types import Floats


def random_transform_table(all_runs: dict[RandomTransformCondition, TransformResult]) -> ResultTable:
    """Return a table of experiment 1, beside the paper's figures."""
    rows = [
        (
            condition.title,
            f"{len(runs.errors):,}",
            f"{100 * runs.right_share:.1f} ± {100 * runs.right_spread:.1f} %",
            f"{100 * runs.failed_share:.1f} %",
            _mean_errors(runs.mean_of_right),
            _mean_errors(runs.mean_of_all),
            f"{1e3 * np.nanmedian(runs.translation_error):.1f} mm",
            _integer(runs.mean_n_matched),
            f"{100 * consistent.right_share:.1f} ± {100 * consistent.right_spread:.1f} %",
            _mean_errors(consistent.mean_of_all),
        )
        for condition, (runs, consistent) in all_runs.items()
    ]
    paper = ("12 mm, 22 mm, lost", "-", "245", "-", "-")
    rows.append(("paper", "1,000", "-", "-", "-", *paper))
    return ResultTable(
        title=f"cfsma: errors of x, y, theta; right is within {SUCCESS[0]} m, {np.degrees(SUCCESS[1]):.0f} deg; "
        "± is the standard deviation from seed to seed",
        columns=(
            "scans",
            "runs",
            "right",
            "failed",
            "mean errors of right",
            "mean errors of all",
            "median of all",
            "mean N_t",
            "right, with consistency",
            "mean errors of all, with consistency",
        ),
        rows=rows,
    )


def _mean_errors(mean: Floats) -> str:
    x, y, theta = mean
    if np.isnan(x):
        return "-"
    return f"{1e3 * x:.1f} mm, {1e3 * y:.1f} mm, {np.degrees(theta):.2f} deg"


def _integer(value: float) -> str:
    return "-" if np.isnan(value) else f"{value:.0f}"


def drive_table(drive: ScenarioComparison) -> ResultTable:
    """Return a table of one experiment: accuracy of every method (Tables II and IV of the paper), seed by seed."""
    rows: list[tuple[str, ...]] = []
    for method, results in drive.results.items():
        rows.append(
            (
                method,
                f"{1e3 * np.median(np.concatenate([r.run.seconds for r in results])):.2f} ms",
                _by_seed([100 * r.right_share for r in results], ".1f", "%"),
                _by_seed([r.n_failed for r in results], ".0f", ""),
                _by_seed([r.errors.end_translation for r in results], ".2f", "m"),
                _by_seed([float(np.degrees(r.errors.end_rotation)) for r in results], ".1f", "deg"),
                _by_seed([100 * r.errors.drift for r in results], ".1f", "%"),
                _by_seed([r.end_unrefused for r in results], ".2f", "m"),
            )
        )
    rows.append(("paper", *(["entries lost in our copy"] * 7)))
    return ResultTable(
        title=f"Experiment {drive.experiment.number}, {drive.experiment.condition} conditions: all methods on the same "
        "scans, scan to scan; one figure a seed",
        columns=(
            "method",
            "time a scan",
            "steps right",
            "failed",
            "end pose error",
            "in angle",
            "of the path",
            "end pose error without refusals",
        ),
        rows=rows,
    )


def covariance_table(drive: ScenarioComparison) -> ResultTable:
    """Return the covariances of one experiment, all seeds (Tables III and V of the paper)."""

    def diagonal(values: Floats) -> str:
        return ", ".join(f"{value:.1e}" for value in values)

    rows: list[tuple[str, ...]] = []
    for method, results in drive.results.items():
        own = np.concatenate([r.variances for r in results])
        shared = np.concatenate([r.lu_milios for r in results])
        if len(own):
            rows.append(
                (
                    method,
                    diagonal(shared.mean(axis=0)),
                    diagonal(shared.max(axis=0)),
                    diagonal(own.mean(axis=0)),
                    diagonal(own.max(axis=0)),
                )
            )
    rows.append(("paper", *["entries lost in our copy"] * 2, "-", "-"))
    return ResultTable(
        title=f"Experiment {drive.experiment.number}, {drive.experiment.condition} conditions: diagonal of the "
        f"covariance "
        "[m², m², rad²]",
        columns=("method", "by Lu and Milios for all, mean", "largest", "the method's own, mean", "largest"),
        rows=rows,
    )


def dynamic_table(drive: ScenarioComparison) -> ResultTable:
    """Return what became of the readings of people, all seeds."""
    rows: list[tuple[str, ...]] = []
    for method, results in drive.results.items():
        matched, all_people, kept, all_static, right, said, true = np.sum(
            [
                (
                    r.discarded.n_people_matched,
                    r.discarded.n_people,
                    r.discarded.n_static_matched,
                    r.discarded.n_static,
                    r.moved.n_right,
                    r.moved.n_said,
                    r.moved.n_true,
                )
                for r in results
            ],
            axis=0,
        )
        rows.append(
            (
                method,
                f"{100 * matched / max(all_people, 1):.1f} %",
                f"{100 * kept / max(all_static, 1):.1f} %",
                f"{right / max(said, 1):.3f}, {right / max(true, 1):.3f}",
            )
        )
    return ResultTable(
        title=f"Experiment {drive.experiment.number}, {drive.experiment.condition} conditions: readings of people",
        columns=(
            "method",
            "matched readings that are people, of all readings that are",
            "matched readings of all others, of these",
            "dynamic by free-space violation: precision, recall",
        ),
        rows=rows,
    )


def _by_seed(values: Sequence[float], form: str, unit: str) -> str:
    return f"{', '.join(f'{value:{form}}' for value in values)} {unit}".strip()


def log_table(judged: Sequence[LogEvaluation]) -> ResultTable:
    """Return a table of how methods did on real logs."""

    def percent(share: float) -> str:
        return "-" if np.isnan(share) else f"{100 * share:.1f} %"

    rows = []
    for one in judged:
        reasons = ", ".join(
            f"{outcome.name.lower()} {100 * count / one.n_steps:.1f} %" for outcome, count in one.failures.items()
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
        keys=2,
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
        title="Errors of relations, the odometry of each method: keyframes for the default matcher, scan to scan for "
        "the others",
        keys=2,
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
