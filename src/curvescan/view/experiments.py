"""The report of the paper's experiments: tables, figures and what contradicts the paper."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from curvescan import __version__
from curvescan.evaluation.drives import DriveResult
from curvescan.evaluation.experiments import DriveComparison, Experiments
from curvescan.evaluation.random_transform import SUCCESS, Moves, RandomTransformRuns
from curvescan.view.document import Part, save_document
from curvescan.view.experiment_figures import draw_errors, draw_maps, draw_moved, draw_trajectories
from curvescan.view.table import ResultTable

PAPER_PARAMETERS = {"cfsma": "7", "idc": "4", "cox": "5", "histogram": "2"}
"""Table VI of the paper."""


def save_experiments(folder: Path, results: Experiments) -> None:
    """Write report.html (self-contained), report.md, results.json and the figures into an existing folder."""
    save_document(folder, "curvescan: the paper's experiments", list(_parts(folder, results)))
    record = json.dumps(as_record(results), indent=2)
    (folder / "results.json").write_text(record + "\n", "utf-8")


def as_record(results: Experiments) -> dict[str, object]:
    """Return the results as what results.json holds; the same for the same seed but for the milliseconds."""
    return {
        "curvescan": __version__,
        "seed": results.seed,
        "is_quick": results.is_quick,
        "experiment_1": {
            f"the {moves} moved, {100 * share:.0f} % people": {
                "runs": len(runs.errors),
                "failed": runs.failed_share,
                "right": runs.right_share,
                "mean_error_of_right": runs.errors[runs.is_right].mean(axis=0).tolist(),
                "median_translation": float(np.nanmedian(runs.translation_error)),
                "median_rotation": float(np.nanmedian(runs.rotation_error)),
                "mean_n_t": float(runs.n_matched[runs.n_matched > 0].mean()),
            }
            for (moves, share), runs in results.random_transforms.items()
        },
        "drives": {
            f"experiment_{drive.experiment.number}": {
                "scans": len(drive.log),
                "people": drive.experiment.n_people,
                "methods": {
                    method: _drive_record(result) for method, result in drive.results.items()
                },
            }
            for drive in results.drives
        },
        "parameters": results.n_parameters,
        "logs": [
            {
                "log": judged.log,
                "method": judged.method,
                "steps": judged.n_steps,
                "failures": {k.name.lower(): n for k, n in judged.failures.items()},
                "wrong": judged.n_wrong,
                "milliseconds": judged.median_milliseconds,
            }
            for judged in results.logs
        ],
    }


def _drive_record(result: DriveResult) -> dict[str, object]:
    return {
        "path_length": result.errors.path_length,
        "end_translation": result.errors.end_translation,
        "end_rotation": result.errors.end_rotation,
        "failed": result.n_failed,
        "mean_variance": result.variances.mean(axis=0).tolist() if len(result.variances) else None,
        "largest_variance": result.variances.max(axis=0).tolist()
        if len(result.variances)
        else None,
        "moved_precision": None if np.isnan(result.moved.precision) else result.moved.precision,
        "moved_recall": None if np.isnan(result.moved.recall) else result.moved.recall,
        "milliseconds": float(1e3 * np.median(result.run.seconds)),
    }


def _parts(folder: Path, results: Experiments) -> Iterator[Part]:
    yield "# The paper's experiments"
    yield (
        "P. Núñez, R. Vázquez-Martín, A. Bandera, F. Sandoval, Robotica 27 (2009) 469-479, section 5, rerun on simulated "
        f"scans by curvescan {__version__}, seed {results.seed}"
        + (", quick: a tenth of the runs and a quarter of the scans." if results.is_quick else ".")
    )
    yield "## Experiment 1: random transform"
    yield _random_transform_table(results.random_transforms)
    draw_errors(folder / "errors.png", results.random_transforms)
    yield (
        "errors.png",
        "Errors of the matches that did not fail; the dashed lines bound a right one.",
    )
    for drive in results.drives:
        yield from _drive_parts(folder, drive)
    yield "## Table VI: parameters"
    yield ResultTable(
        title="Parameters of each method, counted from its configuration",
        columns=("method", "parameters", "to be tuned, by the paper"),
        rows=[
            (method, str(n), PAPER_PARAMETERS.get(method, "-"))
            for method, n in results.n_parameters.items()
        ],
    )
    if results.logs:
        yield "## Real logs"
        yield _log_table(results)
    yield "## What the paper concludes, and what we find"
    yield from _verdicts(results)


def _random_transform_table(
    all_runs: dict[tuple[Moves, float], RandomTransformRuns],
) -> ResultTable:
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


def _drive_parts(folder: Path, drive: DriveComparison) -> Iterator[Part]:
    number = drive.experiment.number
    length = next(iter(drive.results.values())).errors.path_length
    yield f"## Experiment {number}: {drive.experiment.title}"
    yield (
        f"{len(drive.log):,} scans over {length:.1f} m, {drive.experiment.n_people} people walking; "
        f"{100 * drive.log.is_person.mean():.1f} % of the beams hit people."
    )
    yield _drive_table(drive)
    if number == 2:
        yield (
            "The paper's robot ended at about (46, 52) mm by measurement and at about (29, 26) mm, 3.9 deg by its matching "
            "(signs lost)."
        )
    draw_maps(folder / f"maps_{number}.png", drive)
    yield (f"maps_{number}.png", "Maps of all methods at the same scale; truth dashed.")
    draw_trajectories(folder / f"trajectories_{number}.png", drive)
    yield (f"trajectories_{number}.png", "Trajectories of all methods in one figure, truth dashed.")
    if drive.experiment.n_people:
        method = best_method(drive)
        draw_moved(folder / f"moved_{number}.png", drive, method)
        yield (f"moved_{number}.png", f"Map by {method}, discarded dynamic readings in grey.")


def _drive_table(drive: DriveComparison) -> ResultTable:
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


def _log_table(results: Experiments) -> ResultTable:
    return ResultTable(
        title="Odometry on real logs, scan to scan, laser alone; wrong: over 0.3 m or 10 deg from wheel odometry",
        columns=("log", "method", "steps", "failed", "matched but wrong", "time a scan"),
        rows=[
            (
                judged.log,
                judged.method,
                f"{judged.n_steps:,}",
                f"{100 * sum(judged.failures.values()) / judged.n_steps:.1f} %",
                "-" if judged.n_wrong is None else f"{100 * judged.n_wrong / judged.n_steps:.1f} %",
                f"{judged.median_milliseconds:.2f} ms",
            )
            for judged in results.logs
        ],
    )


def best_method(drive: DriveComparison) -> str:
    """Return the method whose end pose is nearest to the true one."""
    return min(drive.results, key=lambda method: drive.results[method].errors.end_translation)


def _verdicts(results: Experiments) -> Iterator[str]:
    for drive in results.drives:
        if "cfsma" not in drive.results or len(drive.results) < 2:
            continue
        ours = drive.results["cfsma"]
        rivals = {m: r for m, r in drive.results.items() if m in ("idc", "cox", "histogram")}
        if not rivals:
            continue
        nearer = [
            m for m, r in rivals.items() if r.errors.end_translation < ours.errors.end_translation
        ]
        faster = [
            m for m, r in rivals.items() if np.median(r.run.seconds) < np.median(ours.run.seconds)
        ]
        yield (
            f"Experiment {drive.experiment.number}. The paper: CF-SMA is faster and more accurate than IDC, Cox and Histogram. "
            "Here: "
            + (
                f"more accurate at the end than cfsma are {', '.join(nearer)}, which contradicts the paper"
                if nearer
                else "cfsma is the most accurate of the four, as in the paper"
            )
            + "; "
            + (
                f"faster are {', '.join(faster)}, which contradicts it too."
                if faster
                else "and the fastest, as in the paper."
            )
        )
