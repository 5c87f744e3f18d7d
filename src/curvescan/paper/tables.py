"""The tables and figures of the paper's experiments and of real logs."""

import math
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TypeAlias

import numpy as np
from matplotlib.axes import Axes

from curvescan import se2
from curvescan.evaluation.real_logs import LogEvaluation
from curvescan.mapping.occupied_cells import OccupiedCells, occupied_cells
from curvescan.paper.experiments import ScenarioComparison
from curvescan.paper.random_transform import SUCCESS, RandomTransformCondition, RandomTransformRuns, TransformResult
from curvescan.paper.scenarios import ScenarioResult
from curvescan.plots.colours import DARK, FAILED, GREY, LIGHT, PATH, TRUTH, segment_colour
from curvescan.plots.map import as_place, draw_side_by_side, draw_truth, drawing, from_first
from curvescan.runs.document import ResultTable
from curvescan.types import Floats

_ByMethod: TypeAlias = tuple[str, tuple[ScenarioResult, ...]]  # A method and its results, one a seed


def random_transform_table(all_runs: dict[RandomTransformCondition, TransformResult]) -> ResultTable:
    """Return a table of experiment 1, beside the paper's figures."""

    def right(runs: RandomTransformRuns) -> str:
        return f"{100 * runs.right_share:.1f} ± {100 * runs.right_spread:.1f} %"

    return ResultTable.of(
        f"cfsma: errors of x, y, theta; right is within {SUCCESS[0]} m, {np.degrees(SUCCESS[1]):.0f} deg; "
        "± is the standard deviation from seed to seed",
        [(condition, *result) for condition, result in all_runs.items()],
        [
            ("scans", lambda one: one[0].title),
            ("runs", lambda one: f"{len(one[1].errors):,}"),
            ("right", lambda one: right(one[1])),
            ("failed", lambda one: f"{100 * one[1].failed_share:.1f} %"),
            ("mean errors of right", lambda one: _mean_errors(one[1].mean_of_right)),
            ("mean errors of all", lambda one: _mean_errors(one[1].mean_of_all)),
            ("median of all", lambda one: f"{1e3 * np.nanmedian(one[1].translation_error):.1f} mm"),
            ("mean N_t", lambda one: "-" if np.isnan(one[1].mean_n_matched) else f"{one[1].mean_n_matched:.0f}"),
            ("right, with consistency", lambda one: right(one[2])),
            ("mean errors of all, with consistency", lambda one: _mean_errors(one[2].mean_of_all)),
        ],
        last=[("paper", "1,000", "-", "-", "-", "12 mm, 22 mm, lost", "-", "245", "-", "-")],
    )


def _mean_errors(mean: Floats) -> str:
    x, y, theta = mean
    if np.isnan(x):
        return "-"
    return f"{1e3 * x:.1f} mm, {1e3 * y:.1f} mm, {np.degrees(theta):.2f} deg"


def drive_table(drive: ScenarioComparison) -> ResultTable:
    """Return a table of one experiment: accuracy of every method (Tables II and IV of the paper), seed by seed."""

    def by_seed(figure: Callable[[ScenarioResult], float], form: str, unit: str = "") -> Callable[[_ByMethod], str]:
        return lambda one: f"{', '.join(f'{figure(result):{form}}' for result in one[1])} {unit}".strip()

    return ResultTable.of(
        f"{_name(drive)}: all methods on the same scans, scan to scan; one figure a seed",
        drive.results.items(),
        [
            ("method", lambda one: one[0]),
            ("time a scan", lambda one: f"{1e3 * np.median(np.concatenate([r.run.seconds for r in one[1]])):.2f} ms"),
            ("steps right", by_seed(lambda r: 100 * r.right_share, ".1f", "%")),
            ("failed", by_seed(lambda r: r.n_failed, ".0f")),
            ("end pose error", by_seed(lambda r: r.errors.end_translation, ".2f", "m")),
            ("in angle", by_seed(lambda r: math.degrees(r.errors.end_rotation), ".1f", "deg")),
            ("of the path", by_seed(lambda r: 100 * r.errors.drift, ".1f", "%")),
            ("end pose error without refusals", by_seed(lambda r: r.end_unrefused, ".2f", "m")),
        ],
        last=[("paper", *["entries lost in our copy"] * 7)],
    )


def covariance_table(drive: ScenarioComparison) -> ResultTable:
    """Return the covariances of one experiment, all seeds (Tables III and V of the paper)."""

    def diagonal(values: Floats) -> str:
        return ", ".join(f"{value:.1e}" for value in values)

    found = [
        (method, np.concatenate([r.variances for r in results]), np.concatenate([r.lu_milios for r in results]))
        for method, results in drive.results.items()
    ]
    return ResultTable.of(
        f"{_name(drive)}: diagonal of the covariance [m², m², rad²]",
        [one for one in found if len(one[1])],
        [
            ("method", lambda one: one[0]),
            ("by Lu and Milios for all, mean", lambda one: diagonal(one[2].mean(axis=0))),
            ("largest", lambda one: diagonal(one[2].max(axis=0))),
            ("the method's own, mean", lambda one: diagonal(one[1].mean(axis=0))),
            ("largest", lambda one: diagonal(one[1].max(axis=0))),
        ],
        last=[("paper", *["entries lost in our copy"] * 2, "-", "-")],
    )


def dynamic_table(drive: ScenarioComparison) -> ResultTable:
    """Return what became of the readings of people, all seeds."""

    def share(name: str, one: _ByMethod) -> float:
        n_part, n_whole = np.sum([getattr(result, name) for result in one[1]], axis=0)
        return float(n_part) / max(int(n_whole), 1)

    people = "matched readings that are people, of all readings that are"
    others = "matched readings of all others, of these"
    moved = "dynamic by free-space violation: precision, recall"
    return ResultTable.of(
        f"{_name(drive)}: readings of people",
        drive.results.items(),
        [
            ("method", lambda one: one[0]),
            (people, lambda one: f"{100 * share('people_matched', one):.1f} %"),
            (others, lambda one: f"{100 * share('static_matched', one):.1f} %"),
            (moved, lambda one: f"{share('moved_precision', one):.3f}, {share('moved_recall', one):.3f}"),
        ],
    )


def _name(drive: ScenarioComparison) -> str:
    return f"Experiment {drive.experiment.number}, {drive.experiment.condition} conditions"


def log_table(judged: Sequence[LogEvaluation]) -> ResultTable:
    """Return a table of how methods did on real logs."""

    def percent(share: float) -> str:
        return "-" if np.isnan(share) else f"{100 * share:.1f} %"

    def motion(of: tuple[float, float]) -> str:
        return "-" if np.isnan(of[0]) else f"{1e3 * of[0]:.1f} mm, {np.degrees(of[1]):.2f} deg"

    def reasons(one: LogEvaluation) -> str:
        shares = (f"{outcome.name.lower()} {100 * n / one.n_steps:.1f} %" for outcome, n in one.failures.items())
        return ", ".join(shares) or "-"

    return ResultTable.of(
        "Consecutive scans of real logs, no guess, laser alone, against the poses in the log",
        judged,
        [
            ("log", lambda one: one.log),
            ("method", lambda one: one.method),
            ("steps", lambda one: f"{one.n_steps:,}"),
            ("within 0.25 m, 3 deg", lambda one: percent(one.right_share)),
            ("beyond 0.3 m or 10 deg", lambda one: percent(one.wrong_share)),
            ("difference, median", lambda one: motion(one.median_difference)),
            ("failed", lambda one: percent(one.n_failed / one.n_steps)),
            ("why", reasons),
            ("motion, 99th percentile", lambda one: motion(one.largest_motion)),
            ("time a scan", lambda one: f"{1e3 * np.median(one.seconds):.3f} ms"),
        ],
        keys=2,
    )


def log_relation_table(judged: Sequence[LogEvaluation]) -> ResultTable:
    """Return the errors of methods against relations, of the logs that have some."""
    rows = [(one, one.relations, one.run) for one in judged if one.relations is not None and one.run is not None]
    return ResultTable.of(
        "Errors of relations, the odometry of each method: keyframes for the default matcher, scan to scan for "
        "the others",
        [(one, run, known.spreads("near"), known.spreads("far"), known.spreads("all")) for one, known, run in rows],
        [
            ("log", lambda row: row[0].log),
            ("method", lambda row: row[0].method),
            ("near, far relations", lambda row: f"{row[2][0].n:,}, {row[3][0].n:,}"),
            ("near: translation", lambda row: f"{1e3 * row[2][0].mean:.1f} ± {1e3 * row[2][0].std:.1f} mm"),
            ("near: rotation", lambda row: f"{np.degrees(row[2][1].mean):.3f} ± {np.degrees(row[2][1].std):.3f} deg"),
            ("all: translation", lambda row: f"{row[4][0].mean:.3f} ± {row[4][0].std:.3f} m"),
            ("all: rotation", lambda row: f"{np.degrees(row[4][1].mean):.2f} ± {np.degrees(row[4][1].std):.2f} deg"),
            ("failed", lambda row: f"{np.count_nonzero(row[1].is_failed):,} of {row[0].n_steps:,}"),
            ("time a scan", lambda row: f"{1e3 * np.median(row[1].seconds):.3f} ms"),
        ],
        keys=2,
    )


def draw_errors(path: Path, all_runs: dict[RandomTransformCondition, TransformResult]) -> None:
    """Save the histograms of the errors of experiment 1."""
    with drawing(path, 11.0, 4.5, legend=3) as figure:
        left, right = figure.subplots(1, 2)
        for k, (condition, (runs, _)) in enumerate(all_runs.items()):
            style = {"histtype": "step", "color": segment_colour(k), "lw": 1.3}
            for axes, errors, limits in (
                (left, runs.translation_error, np.geomspace(1e-3, 10.0, 31)),
                (right, np.degrees(runs.rotation_error), np.geomspace(1e-2, 180.0, 31)),
            ):
                known = errors[~np.isnan(errors)]
                weights = np.full(known.size, 100.0 / errors.size)
                axes.hist(
                    np.clip(known, limits[0], limits[-1]), bins=limits, label=condition.title, weights=weights, **style
                )
        for axes, limit, name in (
            (left, SUCCESS[0], "translation error [m]"),
            (right, np.degrees(SUCCESS[1]), "rotation error [deg]"),
        ):
            axes.axvline(limit, color=PATH, ls="--", lw=1.0)
            axes.set(xscale="log", xlabel=name, ylabel="runs [%]")


def draw_maps(path: Path, drive: ScenarioComparison) -> None:
    """Save the maps of all methods side by side, each at the scale that shows all of it (figure 8)."""
    n_columns = min(len(drive.results), 4)
    n_rows = -(-len(drive.results) // n_columns)
    with drawing(path, 3.6 * n_columns, 3.9 * n_rows + 0.5, legend=3) as figure:
        places = np.ravel(figure.subplots(n_rows, n_columns, squeeze=False))
        for axes in places[len(drive.results) :]:
            axes.axis("off")
        for axes, (method, result) in zip(places, drive.first.items(), strict=False):
            axes.plot(*occupied_cells(drive.log, result.run.trajectory.poses).T, "s", color=DARK, ms=1.2, mew=0)
            _draw_ways(axes, drive, result, "matching", ms=3)
            end = result.errors.end_translation
            as_place(axes, f"{method}: end off by {end:.2f} m, {result.n_failed} failed")
            axes.set_aspect("equal", adjustable="datalim")


def _draw_ways(axes: Axes, drive: ScenarioComparison, result: ScenarioResult, label: str, ms: float) -> None:
    """Draw the true way and the one by a method, with a cross where a match failed."""
    poses, failed = result.run.trajectory.poses, result.run.is_failed
    draw_truth(axes, from_first(drive.log.truth.poses))
    axes.plot(*poses[:, :2].T, color=PATH, lw=1.0, label=label)
    axes.plot(*poses[failed, :2].T, "x", color=FAILED, ms=ms, label="match failed")


def draw_trajectories(path: Path, drive: ScenarioComparison) -> None:
    """Save the trajectories of all methods in one figure with the true one (figure 9b)."""
    truth = from_first(drive.log.truth.poses)
    with drawing(path, 9, 7, legend=5) as figure:
        axes = figure.subplots()
        for k, (method, result) in enumerate(drive.first.items()):
            axes.plot(*result.run.trajectory.poses[:, :2].T, color=segment_colour(k), lw=1.0, label=method)
        draw_truth(axes, truth)
        margin = 0.35 * float(np.ptp(truth[:, :2], axis=0).max()) + 0.5
        low, high = truth[:, :2].min(axis=0) - margin, truth[:, :2].max(axis=0) + margin
        as_place(axes, "a method that leaves the frame has lost its way")
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))


def draw_both_maps(path: Path, drive: ScenarioComparison) -> None:
    """Save the map by cfsma beside the map from wheel odometry (figure 7)."""
    tracks = {"map by cfsma": drive.first["cfsma"].run.trajectory.poses}
    if drive.log.odometry is not None:
        tracks["map from wheel odometry"] = drive.log.odometry.poses
    draw_side_by_side(path, drive.log, tracks, drive.log.truth.poses)


def draw_end(path: Path, drive: ScenarioComparison) -> None:
    """Save the way by cfsma about its start and its end, with the true one (figure 7c)."""
    result = drive.first["cfsma"]
    with drawing(path, 7, 7, legend=3) as figure:
        axes = figure.subplots()
        _draw_ways(axes, drive, result, "cfsma", ms=4)
        axes.plot(0.0, 0.0, "o", color="white", mec=DARK, ms=8, label="start")
        true_end, end = from_first(drive.log.truth.poses)[-1], result.run.trajectory.poses[-1]
        axes.plot(*true_end[:2], "s", color="white", mec=TRUTH, ms=8, label="true end")
        axes.plot(*end[:2], "s", color="white", mec=PATH, ms=8, label="end by cfsma")
        as_place(axes, f"experiment {drive.experiment.number}, cfsma")
        axes.set_aspect("equal", adjustable="datalim")


def draw_discarded(path: Path, drive: ScenarioComparison) -> None:
    """Save the map of what cfsma matched (dark) and what it left unmatched (grey): figure 9a."""
    result = drive.first["cfsma"]
    poses = result.run.trajectory.poses
    unmatched, people, matched = (OccupiedCells(0.05) for _ in range(3))
    for k, pose in enumerate(poses):
        scan, left, is_person = drive.log[k], result.is_discarded[k], drive.log.is_person[k]
        unmatched.add(se2.transform(pose, scan.points[left & ~is_person]))
        people.add(se2.transform(pose, scan.points[left & is_person]))
        matched.add(se2.transform(pose, scan.points[scan.valid & ~left]))
    with drawing(path, 9, 8, legend=3) as figure:
        axes = figure.subplots()
        for cells, colour, label in (
            (unmatched, GREY, "left unmatched by cfsma"),
            (people, LIGHT, "left unmatched by cfsma: people"),
            (matched, DARK, "matched by cfsma"),
        ):
            axes.plot(*cells.centres().T, "s", color=colour, ms=1.4, mew=0)
            axes.plot([], [], "s", color=colour, ms=4, label=label)
        draw_truth(axes, from_first(drive.log.truth.poses))
        axes.plot(*poses[:, :2].T, color=PATH, lw=1.0, label="cfsma")
        as_place(axes, f"experiment {drive.experiment.number}, cfsma")
        axes.set_aspect("equal", adjustable="datalim")
