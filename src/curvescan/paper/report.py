"""The report of the paper's experiments: tables, figures and what contradicts the paper."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path

import numpy as np

from curvescan import __version__
from curvescan.paper.experiments import Experiments, ScenarioComparison
from curvescan.paper.figures import (
    draw_drive_map,
    draw_errors,
    draw_maps,
    draw_trajectories,
)
from curvescan.paper.scenarios import ScenarioResult
from curvescan.paper.tables import (
    drive_table,
    log_relation_table,
    log_table,
    random_transform_table,
)
from curvescan.runs.document import Part, save_document
from curvescan.runs.evaluation import relation_record
from curvescan.runs.table import ResultTable

PAPER_PARAMETERS = {"cfsma": "7", "idc": "4", "cox": "5", "histogram": "2"}
"""Table VI of the paper."""


def save_experiments(folder: Path, results: Experiments) -> None:
    """Write report.html (self-contained), report.md, results.json and the figures into an existing folder."""
    title = "curvescan: " + ("the paper's experiments" if results.drives else "real logs")
    save_document(folder, title, list(_parts(folder, results)))
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
                "right": None if np.isnan(judged.right_share) else judged.right_share,
                "wrong": None if np.isnan(judged.wrong_share) else judged.wrong_share,
                "motion_p99": judged.largest_motion,
                "median_difference": None
                if judged.difference is None
                else judged.median_difference,
                "milliseconds": float(1e3 * np.median(judged.seconds)),
                "relations": None
                if judged.relations is None
                else relation_record(judged.relations),
            }
            for judged in results.logs
        ],
    }


def _drive_record(result: ScenarioResult) -> dict[str, object]:
    return {
        "path_length": result.errors.path_length,
        "end_translation": result.errors.end_translation,
        "end_rotation": result.errors.end_rotation,
        "failed": result.n_failed,
        "wrong": result.lost.n_wrong,
        "end_without_lost_steps": result.lost.end_without,
        "mean_variance": result.variances.mean(axis=0).tolist() if len(result.variances) else None,
        "largest_variance": result.variances.max(axis=0).tolist()
        if len(result.variances)
        else None,
        "moved_precision": None if np.isnan(result.moved.precision) else result.moved.precision,
        "moved_recall": None if np.isnan(result.moved.recall) else result.moved.recall,
        "milliseconds": float(1e3 * np.median(result.run.seconds)),
    }


def _parts(folder: Path, results: Experiments) -> Iterator[Part]:
    if results.drives:
        yield from _paper_parts(folder, results)
    if results.logs:
        yield from _log_parts(results)
    yield "## Table VI: parameters"
    yield ResultTable(
        title="Parameters of each method, counted from its configuration",
        columns=("method", "parameters", "to be tuned, by the paper"),
        rows=[
            (method, str(n), PAPER_PARAMETERS.get(method, "-"))
            for method, n in results.n_parameters.items()
        ],
    )
    if results.drives:
        yield "## What the paper concludes, and what we find"
        yield from _verdicts(results)


def _paper_parts(folder: Path, results: Experiments) -> Iterator[Part]:
    yield "# The paper's experiments"
    yield (
        "P. Núñez, R. Vázquez-Martín, A. Bandera, F. Sandoval, Robotica 27 (2009) 469-479, section 5, rerun on simulated "
        f"scans by curvescan {__version__}, seed {results.seed}"
        + (", quick: a tenth of the runs and a quarter of the scans." if results.is_quick else ".")
    )
    yield "## Experiment 1: random transform"
    yield random_transform_table(results.random_transforms)
    draw_errors(folder / "errors.png", results.random_transforms)
    yield (
        "errors.png",
        "Errors of the matches that did not fail; the dashed lines bound a right one.",
    )
    for drive in results.drives:
        yield from _drive_parts(folder, drive)


def _log_parts(results: Experiments) -> Iterator[Part]:
    yield (
        "## Real logs"
        if results.drives
        else f"# Every method on real logs (curvescan {__version__})"
    )
    yield log_table(results.logs)
    if any(judged.relations is not None for judged in results.logs):
        yield log_relation_table(results.logs)


def _drive_parts(folder: Path, drive: ScenarioComparison) -> Iterator[Part]:
    number = drive.experiment.number
    length = next(iter(drive.results.values())).errors.path_length
    yield f"## Experiment {number}: {drive.experiment.title}"
    yield (
        f"{len(drive.log):,} scans over {length:.1f} m, {drive.experiment.n_people} people walking; "
        f"{100 * drive.log.is_person.mean():.1f} % of the beams hit people."
    )
    yield drive_table(drive)
    yield from _lost_ways(drive)
    if number == 2:
        yield (
            "The paper's robot ended at about (46, 52) mm by measurement and at about (29, 26) mm, 3.9 deg by its matching "
            "(signs lost)."
        )
    draw_maps(folder / f"maps_{number}.png", drive)
    yield (f"maps_{number}.png", "Maps of all methods at the same scale; truth dashed.")
    draw_trajectories(folder / f"trajectories_{number}.png", drive)
    yield (f"trajectories_{number}.png", "Trajectories of all methods in one figure, truth dashed.")
    method = best_method(drive)
    draw_drive_map(folder / f"map_{number}.png", drive, method)
    if drive.experiment.n_people:
        yield (f"map_{number}.png", f"Map by {method}, discarded dynamic readings in grey.")
    else:
        yield (
            f"map_{number}.png",
            f"Map by {method} (dark) over the map from wheel odometry (light).",
        )


def _lost_ways(drive: ScenarioComparison) -> Iterator[str]:
    """Yield why a method ended more than 1 % of the path away from the truth."""
    for method, result in drive.results.items():
        lost = result.lost
        if result.errors.drift <= 0.01 or lost.n_failed + lost.n_wrong == 0:
            continue
        yield (
            f"{method} ends more than 1 % of the path away: {lost.n_failed} of the matches failed and {lost.n_wrong} were off by more than "
            f"0.1 m or 2 deg. In these steps the robot moved {lost.motion:.2f} m and turned {np.degrees(lost.turn):.1f} deg in the mean, in "
            f"all others {lost.usual_motion:.2f} m and {np.degrees(lost.usual_turn):.1f} deg. With the true motion in their place the end "
            f"would be off by {lost.end_without:.3f} m, {100 * lost.end_without / result.errors.path_length:.2f} % of the path."
        )


def best_method(drive: ScenarioComparison) -> str:
    """Return the method whose steps are the most accurate in the median; an end pose may be near by luck."""
    return min(
        drive.results,
        key=lambda method: float(np.median(drive.results[method].errors.step_translation)),
    )


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
