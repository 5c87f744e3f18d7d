"""Figures of an evaluation: errors along the path, and the trajectory as a map."""

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from curvescan import se2
from curvescan.evaluation.reference import ReferenceErrors
from curvescan.evaluation.relations import RelationErrors
from curvescan.evaluation.trajectory_errors import travelled
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.plots.colours import DARK, FAILED, GREY, LIGHT, PATH, TRUTH
from curvescan.plots.map import as_place, drawing, drawing_places
from curvescan.types import Floats

_N_WORST = 10


def draw_relation_errors(path: Path, errors: RelationErrors) -> None:
    """Save the errors of near relations along the path, and of far ones against the path between their scans."""
    with drawing(path, 12, 7) as figure:
        for row, (name, chosen, x, label) in enumerate(
            (
                ("near", errors.is_near, errors.place, "path travelled [m]"),
                ("far", ~errors.is_near, errors.between, "path between the two scans [m]"),
            )
        ):
            for column, (what, values, unit) in enumerate(
                (("translation", errors.translation, "m"), ("rotation", np.degrees(errors.rotation), "deg"))
            ):
                axes = figure.add_subplot(2, 2, 2 * row + column + 1)
                _scatter(axes, x[chosen], values[chosen], f"{np.count_nonzero(chosen):,} {name} relations", unit)
                axes.set(xlabel=label, ylabel=f"{what} error [{unit}]")


def draw_relation_places(path: Path, errors: RelationErrors, trajectory: Trajectory) -> None:
    """Save the trajectory as a map, with the places of the near relations of the largest translation errors."""
    known = trajectory.poses[~np.isnan(trajectory.poses).any(axis=1)]
    near = np.flatnonzero(errors.is_near)
    worst = near[np.argsort(errors.translation[near])[-_N_WORST:]]
    with drawing_places(path, known[:, :2], legend=4) as [axes]:
        axes.plot(*known[:, :2].T, color=DARK, lw=0.8, label="trajectory")
        axes.plot(*known[0, :2], "o", color=TRUTH, ms=6, label="start")
        axes.plot(*known[-1, :2], "s", color=PATH, ms=6, label="end")
        if worst.size:
            places = trajectory.poses[errors.scan[worst], :2]
            label = f"the {worst.size} near relations with the largest translation errors"
            axes.plot(*places.T, "x", color=FAILED, ms=7, mew=1.6, label=label)
        as_place(axes)


def draw_reference_errors(path: Path, errors: ReferenceErrors) -> None:
    """Save the errors of position and heading along the path, and the relative errors of each metre."""
    length = travelled(errors.reference)
    heading = {
        "best alignment": np.degrees(se2.wrap(errors.poses[:, 2] - errors.reference[:, 2])),
        "first poses made equal": np.degrees(se2.wrap(errors.from_first[:, 2] - errors.reference[:, 2])),
    }
    position = {"best alignment": errors.ate_best, "first poses made equal": errors.ate_first}
    colours = (DARK, LIGHT)
    with drawing(path, 12, 7, legend=2) as figure:
        panels = np.ravel(figure.subplots(2, 2))
        for axes, what, lines in (
            (panels[0], "position error [m]", position),
            (panels[1], "heading error [deg]", heading),
        ):
            for colour, (name, values) in zip(colours, lines.items(), strict=True):
                axes.plot(length, values, color=colour, lw=1.0, label=name)
            axes.set(xlabel="path travelled [m]", ylabel=what)
        largest = max(float(values.max()) for values in position.values())
        panels[0].set_ylim(0.0, 1.05 * largest or 1.0)
        for axes, what, values, unit in (
            (panels[2], "translation", errors.rpe_metre.translation, "m"),
            (panels[3], "rotation", np.degrees(errors.rpe_metre.rotation), "deg"),
        ):
            _scatter(axes, length[errors.rpe_metre.stop], values, f"{len(values):,} motions", unit)
            axes.set(xlabel="path travelled [m]", ylabel=f"{what} error of each metre [{unit}]")


def draw_overlay(path: Path, errors: ReferenceErrors) -> None:
    """Save the aligned trajectory over the reference, with lines between poses that belong together."""
    own, goal = errors.poses[:, :2], errors.reference[:, :2]
    with drawing_places(path, np.concatenate([own, goal]), legend=3) as [axes]:
        # NaN ends a line: one plot for all
        gaps = np.full((len(own), 3, 2), np.nan)
        gaps[:, 0], gaps[:, 1] = own, goal
        axes.plot(*gaps.reshape(-1, 2).T, color=GREY, lw=0.6, label="error")
        axes.plot(*goal.T, color=TRUTH, lw=1.4, label="reference")
        axes.plot(*own.T, color=PATH, lw=1.0, label="trajectory, best alignment")
        as_place(axes)


def _scatter(axes: Axes, x: Floats, values: Floats, title: str, unit: str) -> None:
    """Plot errors on a logarithmic scale with their median; what is exactly right stands at the bottom."""
    positive = values[values > 0.0]
    if positive.size == 0:  # no error has a logarithm
        axes.plot(x, values, ".", color=DARK, ms=4)
        axes.set_title(title)
        return
    floor = 0.5 * float(positive.min())
    axes.plot(x, np.maximum(values, floor), ".", color=DARK, ms=4, alpha=0.5, mew=0)
    median = float(np.median(values))
    axes.axhline(max(median, floor), color=PATH, lw=1.0, ls="--")
    axes.set_title(f"{title}, median {median:.3g} {unit}")
    axes.set_yscale("log")
