"""Figures of the paper's experiments: error histograms, maps side by side (8), trajectories and what moved (9)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from curvescan import se2
from curvescan.mapping.occupied_cells import OccupiedCells, occupied_cells
from curvescan.paper.experiments import ScenarioComparison
from curvescan.paper.random_transform import SUCCESS, RandomTransformCondition, TransformResult
from curvescan.plots.canvas import DARK, FAILED, GREY, LIGHT, PATH, TRUTH, as_place, draw_truth, drawing, segment_colour
from curvescan.plots.map import draw_side_by_side, from_first


def draw_errors(path: Path, all_runs: dict[RandomTransformCondition, TransformResult]) -> None:
    """Save the histograms of the errors of experiment 1."""
    with drawing(path, 11.0, 4.5) as figure:
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
        figure.legend(*left.get_legend_handles_labels(), loc="outside lower center", ncols=3)


def draw_maps(path: Path, drive: ScenarioComparison) -> None:
    """Save the maps of all methods side by side, each at the scale that shows all of it (figure 8)."""
    truth = from_first(drive.log.truth.poses)
    n_columns = min(len(drive.results), 4)
    n_rows = -(-len(drive.results) // n_columns)
    with drawing(path, 3.6 * n_columns, 3.9 * n_rows + 0.5) as figure:
        places = np.ravel(figure.subplots(n_rows, n_columns, squeeze=False))
        for axes in places:
            axes.axis("off")
        for axes, (method, result) in zip(places, drive.first.items(), strict=False):
            axes.axis("on")
            poses = result.run.trajectory.poses
            axes.plot(*occupied_cells(drive.log, poses).T, "s", color=DARK, ms=1.2, mew=0)
            draw_truth(axes, truth)
            axes.plot(*poses[:, :2].T, color=PATH, lw=1.0, label="matching")
            failed = result.run.is_failed
            axes.plot(*poses[failed, :2].T, "x", color=FAILED, ms=3, label="match failed")
            end = result.errors.end_translation
            as_place(axes, f"{method}: end off by {end:.2f} m, {result.n_failed} failed")
            axes.set_aspect("equal", adjustable="datalim")
        figure.legend(*places[0].get_legend_handles_labels(), loc="outside lower center", ncols=3)


def draw_trajectories(path: Path, drive: ScenarioComparison) -> None:
    """Save the trajectories of all methods in one figure with the true one (figure 9b)."""
    truth = from_first(drive.log.truth.poses)
    with drawing(path, 9, 7) as figure:
        axes = figure.subplots()
        for k, (method, result) in enumerate(drive.first.items()):
            x, y = result.run.trajectory.poses[:, :2].T
            axes.plot(x, y, color=segment_colour(k), lw=1.0, label=method)
        draw_truth(axes, truth)
        margin = 0.35 * float(np.ptp(truth[:, :2], axis=0).max()) + 0.5
        low, high = truth[:, :2].min(axis=0) - margin, truth[:, :2].max(axis=0) + margin
        as_place(axes, "a method that leaves the frame has lost its way")
        axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        figure.legend(loc="outside lower center", ncols=5)


def draw_both_maps(path: Path, drive: ScenarioComparison, method: str) -> None:
    """Save the map of one method beside the map from wheel odometry (figure 7)."""
    tracks = {f"map by {method}": drive.first[method].run.trajectory.poses}
    if drive.log.odometry is not None:
        tracks["map from wheel odometry"] = drive.log.odometry.poses
    draw_side_by_side(path, drive.log, tracks, drive.log.truth.poses)


def draw_end(path: Path, drive: ScenarioComparison, method: str) -> None:
    """Save the way of one method about its start and its end, with the true one (figure 7c)."""
    truth = from_first(drive.log.truth.poses)
    run = drive.first[method].run
    poses, failed = run.trajectory.poses, run.is_failed
    with drawing(path, 7, 7) as figure:
        axes = figure.subplots()
        draw_truth(axes, truth)
        axes.plot(*poses[:, :2].T, color=PATH, lw=1.0, label=method)
        axes.plot(*poses[failed, :2].T, "x", color=FAILED, ms=4, label="match failed")
        axes.plot(0.0, 0.0, "o", color="white", mec=DARK, ms=8, label="start")
        axes.plot(*truth[-1, :2], "s", color="white", mec=TRUTH, ms=8, label="true end")
        axes.plot(*poses[-1, :2], "s", color="white", mec=PATH, ms=8, label=f"end by {method}")
        as_place(axes, f"experiment {drive.experiment.number}, {method}")
        axes.set_aspect("equal", adjustable="datalim")
        figure.legend(loc="outside lower center", ncols=3)


def draw_discarded(path: Path, drive: ScenarioComparison, method: str) -> None:
    """Save the map of what one method matched (dark) and what it left unmatched (grey): figure 9a."""
    result = drive.first[method]
    poses = result.run.trajectory.poses
    matched, unmatched, people = (OccupiedCells(0.05) for _ in range(3))
    for k, pose in enumerate(poses):
        scan, left = drive.log[k], result.is_discarded[k]
        for cells, readings in (
            (matched, scan.valid & ~left),
            (unmatched, left & ~drive.log.is_person[k]),
            (people, left & drive.log.is_person[k]),
        ):
            cells.add(se2.transform(pose, scan.points[readings]))
    with drawing(path, 9, 8) as figure:
        axes = figure.subplots()
        for cells, colour, label in (
            (unmatched, GREY, f"left unmatched by {method}"),
            (people, LIGHT, f"left unmatched by {method}: people"),
            (matched, DARK, f"matched by {method}"),
        ):
            axes.plot(*cells.centres().T, "s", color=colour, ms=1.4, mew=0)
            axes.plot([], [], "s", color=colour, ms=4, label=label)
        draw_truth(axes, from_first(drive.log.truth.poses))
        axes.plot(*poses[:, :2].T, color=PATH, lw=1.0, label=method)
        as_place(axes, f"experiment {drive.experiment.number}, {method}")
        axes.set_aspect("equal", adjustable="datalim")
        figure.legend(loc="outside lower center", ncols=3)
