"""The report of the paper's experiments: tables, figures and what contradicts the paper."""

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from curvescan._version import __version__
from curvescan.configs import shipped_table
from curvescan.paper import tables
from curvescan.paper.experiments import CONSISTENT, Experiments, ScenarioComparison
from curvescan.paper.random_transform import N_PAPER_CONDITIONS, RandomTransformRuns
from curvescan.paper.scenarios import ScenarioResult
from curvescan.runs.document import Part, ResultTable, save_document
from curvescan.runs.evaluation import relation_record
from curvescan.runs.results import write_record

_TEXT = shipped_table(__package__, "report.toml")
PAPER_PARAMETERS = {"cfsma": "7", "idc": "4", "cox": "5", "histogram": "2"}  # table VI of the paper


def save_experiments(folder: Path, results: Experiments) -> None:
    """Write report.html (self-contained), report.md, results.json and the figures into an existing folder."""
    title = "curvescan: " + ("the paper's experiments" if results.drives else "real logs")
    save_document(folder, title, list(_parts(folder, results)))
    write_record(folder, as_record(results), "results.json")


def as_record(results: Experiments) -> dict[str, object]:
    """Return what results.json holds, with NaN for its null; one seed gives the same but for the milliseconds."""
    return {
        "curvescan": __version__,
        "seed": results.seed,
        "is_quick": results.is_quick,
        "experiment_1": {
            condition.title: {"cfsma": _transform_record(runs), CONSISTENT: _transform_record(consistent)}
            for condition, (runs, consistent) in results.random_transforms.items()
        },
        "drives": {
            f"experiment_{drive.experiment.name}": {
                "scans": len(drive.log),
                "people": drive.experiment.n_people,
                "methods": {
                    method: [_drive_record(result) for result in by_seed] for method, by_seed in drive.results.items()
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
                "right": judged.right_share,
                "wrong": judged.wrong_share,
                "motion_p99": judged.largest_motion,
                "median_difference": None if judged.difference is None else judged.median_difference,
                "milliseconds": float(1e3 * np.median(judged.seconds)),
                "relations": None if judged.relations is None else relation_record(judged.relations),
            }
            for judged in results.logs
        ],
    }


def _transform_record(runs: RandomTransformRuns) -> dict[str, object]:
    return {
        "runs": len(runs.errors),
        "failed": runs.failed_share,
        "right": runs.right_share,
        "right_spread": runs.right_spread,
        "mean_error_of_right": runs.mean_of_right.tolist(),
        "mean_error_of_all": runs.mean_of_all.tolist(),
        "median_translation": float(np.nanmedian(runs.translation_error)),
        "median_rotation": float(np.nanmedian(runs.rotation_error)),
        "mean_n_t": runs.mean_n_matched,
    }


def _drive_record(result: ScenarioResult) -> dict[str, object]:
    return {
        "path_length": result.errors.path_length,
        "end_translation": result.errors.end_translation,
        "end_rotation": result.errors.end_rotation,
        "end_translation_unrefused": result.end_unrefused,
        "right": result.right_share,
        "failed": result.n_failed,
        "wrong": result.lost.n_wrong,
        "end_without_lost_steps": result.lost.end_without,
        "mean_variance": result.variances.mean(axis=0).tolist() if len(result.variances) else None,
        "largest_variance": result.variances.max(axis=0).tolist() if len(result.variances) else None,
        "mean_lu_milios": result.lu_milios.mean(axis=0).tolist() if len(result.lu_milios) else None,
        "people_matched": result.people_matched.value,
        "static_matched": result.static_matched.value,
        "moved_precision": result.moved_precision.value,
        "moved_recall": result.moved_recall.value,
        "milliseconds": float(1e3 * np.median(result.run.seconds)),
    }


def _parts(folder: Path, results: Experiments) -> Iterator[Part]:
    if results.drives:
        yield from _paper_parts(folder, results)
    if results.logs:
        yield "## Real logs" if results.drives else f"# Every method on real logs (curvescan {__version__})"
        yield tables.log_table(results.logs)
    if any(judged.relations is not None for judged in results.logs):
        yield tables.log_relation_table(results.logs)
    yield "## Table VI: parameters"
    yield ResultTable(
        title="Parameters of each method, counted from its configuration",
        columns=("method", "parameters", "to be tuned, by the paper"),
        rows=[(method, str(n), PAPER_PARAMETERS.get(method, "-")) for method, n in results.n_parameters.items()],
    )
    if results.drives:
        yield "## What the paper concludes, and what we find"
        yield from _verdicts(results)


def _paper_parts(folder: Path, results: Experiments) -> Iterator[Part]:
    yield "# The paper's experiments"
    yield (
        "P. Núñez, R. Vázquez-Martín, A. Bandera, F. Sandoval, Robotica 27 (2009) 469-479, sections 3.2 and 3.3, rerun "
        f"on simulated scans by curvescan {__version__}, seed {results.seed}"
        + (", quick: ten runs, one seed and a quarter of the scans." if results.is_quick else ".")
    )
    yield _TEXT["conditions"]
    yield "## Experiment 1: random transform"
    yield _TEXT["experiment_1"]
    yield tables.random_transform_table(results.random_transforms)
    tables.draw_errors(folder / "errors.png", results.random_transforms)
    yield ("errors.png", "Errors of the matches that did not fail; the dashed lines bound a right one.")
    for drive in results.drives:
        yield from _drive_parts(folder, drive)


def _drive_parts(folder: Path, drive: ScenarioComparison) -> Iterator[Part]:
    experiment, name = drive.experiment, drive.experiment.name
    results = next(iter(drive.results.values()))
    lengths = ", ".join(f"{result.errors.path_length:.1f}" for result in results)
    shares = ", ".join(f"{100 * share:.1f}" for share in drive.people_shares)
    yield f"## Experiment {experiment.number}: {experiment.title}, {experiment.condition} conditions"
    yield (
        f"{len(drive.log):,} scans over {lengths} m, {1e3 * drive.log.sensor.sigma_range:.0f} mm of noise, "
        f"{experiment.n_people} people walking; {shares} % of the beams hit people. "
        + _TEXT[f"experiment_{experiment.number}"]
    )
    yield tables.drive_table(drive)
    yield tables.covariance_table(drive)
    if experiment.n_people:
        yield tables.dynamic_table(drive)
    yield from _lost_ways(drive)
    has_cfsma = "cfsma" in drive.results
    for figure, draw, is_wanted in (
        ("maps", tables.draw_maps, True),
        ("trajectories", tables.draw_trajectories, True),
        ("figure_7b", tables.draw_both_maps, has_cfsma and experiment.number == 2),
        ("figure_7c", tables.draw_end, has_cfsma and experiment.number == 2),
        ("figure_9a", tables.draw_discarded, has_cfsma and experiment.n_people > 0),
    ):
        if is_wanted:
            draw(folder / f"{figure}_{name}.png", drive)
            yield (f"{figure}_{name}.png", _TEXT[figure])


def _lost_ways(drive: ScenarioComparison) -> Iterator[str]:
    """Yield why a method ended more than 1 % of the path away from the truth, for the first seed."""
    for method, result in drive.first.items():
        lost = result.lost
        if result.errors.drift <= 0.01 or lost.n_failed + lost.n_wrong == 0:
            continue
        turns = {"turn": np.degrees(lost.turn), "usual_turn": np.degrees(lost.usual_turn)}
        share = 100 * lost.end_without / result.errors.path_length
        yield _TEXT["lost_way"].format(method=method, lost=lost, share=share, **turns)


def _verdicts(results: Experiments) -> Iterator[str]:
    """Yield one sentence a claim of the paper, each with its conditions and figures."""
    yield from _accuracy_verdicts(results)
    for drive in results.drives:
        methods = [m for m in ("cfsma", "idc", "cox", "histogram") if m in drive.results]
        if "cfsma" not in methods or len(methods) < 2:
            continue
        experiment = drive.experiment
        where = (
            f"Experiment {experiment.number}, {experiment.condition} conditions ({len(drive.log):,} scans, "
            f"{1e3 * drive.log.sensor.sigma_range:.0f} mm, {experiment.n_people} people, "
            f"{len(drive.results['cfsma'])} seeds)"
        )
        times = {m: _median(drive, m, lambda r: float(np.median(r.run.seconds))) for m in methods}
        fastest = min(times, key=times.__getitem__)
        yield (
            f"{where}. The paper: CF-SMA is the fastest of the four. Here the fastest is {fastest}: "
            + ", ".join(f"{m} {1e3 * seconds:.2f} ms" for m, seconds in times.items())
            + "."
        )
        ends = {m: _median(drive, m, lambda r: r.errors.end_translation) for m in methods}
        nearer = [m for m in methods if ends[m] < ends["cfsma"]]
        yield (
            f"{where}. The paper: CF-SMA is more accurate than IDC, Cox and Histogram. Here the median end pose "
            f"error of "
            + ", ".join(f"{m} is {end:.2f} m" for m, end in ends.items())
            + (
                f": more accurate than cfsma are {', '.join(nearer)}, so that the claim is not reproduced."
                if nearer
                else ": cfsma is the most accurate of the four, as in the paper."
            )
        )


def _accuracy_verdicts(results: Experiments) -> Iterator[str]:
    for condition, (runs, _) in list(results.random_transforms.items())[:N_PAPER_CONDITIONS]:
        x, y, _ = runs.mean_of_right
        all_x, all_y, _ = runs.mean_of_all
        holds = "reproduced" if min(x, y) <= 0.012 and max(x, y) <= 0.022 else "not reproduced"
        means = {"x": 1e3 * x, "y": 1e3 * y, "all_x": 1e3 * all_x, "all_y": 1e3 * all_y}
        about = {"title": condition.title, "n": len(runs.errors), "right": 100 * runs.right_share, "holds": holds}
        yield _TEXT["accuracy"].format(**about, **means)


def _median(drive: ScenarioComparison, method: str, figure: Callable[[ScenarioResult], float]) -> float:
    return float(np.median([figure(result) for result in drive.results[method]]))
