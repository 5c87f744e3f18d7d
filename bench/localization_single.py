"""Localization by single scans: each alone, with no guess, in a map that shows it in part or not at all."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from curvescan.plots.colours import DARK, FAILED, LIGHT
from curvescan.plots.map import drawing
from curvescan.types import Bools, Floats
from localization_runs import Checked
from localization_tasks import PARTS, LocalizationTask

_EDGES = (0.0, 0.2, 0.4, 0.5, 0.6, 0.7, 0.8, 0.85, 0.9, 0.95, 1.0001)


def lines(scans: list[Checked]) -> Iterator[str]:
    """Yield lines on single scans, each the only step of a localizer."""
    shown, found, right = _judged(scans)
    for least, most, where in PARTS:
        is_here = (shown >= least) & (shown < most)
        n, n_right, n_false = (is_here.sum(), (is_here & right).sum(), (is_here & found & ~right).sum())
        share = f"{n_right / n:.0%}" if n else "none tried"
        yield f"  single scans, {where}: {n_right} of {n} right ({share}), {n_false} false"
    median, worst = np.percentile([s.milliseconds[0] for s in scans], [50.0, 99.0])
    text = f"  {median:.0f} ms of processor a scan, 99 % {worst:.0f} ms"
    good = [s for s, is_right in zip(scans, right, strict=True) if is_right]
    if good:
        error = 1e3 * np.median([s.error_m[0] for s in good])
        nees = np.array([s.nees[0] for s in good])
        text += f"; median error {error:.0f} mm, NEES {nees.mean():.1f}, {np.mean(nees < 7.815):.0%} within 95 %"
    yield text


def _judged(scans: list[Checked]) -> tuple[Floats, Bools, Bools]:
    """Return of each scan the share that the map shows, whether a pose was given, and whether it is right."""
    shown = np.array([s.shown[0] for s in scans])
    found = np.array([s.is_known[0] for s in scans], dtype=np.bool_)
    right = np.array([s.is_right[0] for s in scans], dtype=np.bool_)
    return shown, found, right


def draw(path: Path, task: LocalizationTask, scans: list[Checked]) -> None:
    """Save a picture of where single scans are found, and of how much of them the map shows."""
    with drawing(path, 11.0, 5.6) as figure:
        place, bars = figure.subplots(1, 2, width_ratios=[1.25, 1.0])
        _draw_places(place, task, scans)
        _draw_shares(bars, scans)


def _draw_places(axes: Axes, task: LocalizationTask, scans: list[Checked]) -> None:
    cells = task.slam_map.occupancy().occupied_centres
    axes.plot(*cells.T, "s", color="0.6", markersize=0.7, markeredgewidth=0.0)
    _, found, right = _judged(scans)
    places = np.array([task.poses[s.scan[0], :2] for s in scans])
    for label, colour, chosen, size in (
        ("not sure from this scan alone", LIGHT, ~found, 4.0),
        ("found from one scan", DARK, right, 5.0),
        ("false", FAILED, found & ~right, 9.0),
    ):
        if chosen.any():
            at = places[chosen].T
            name = f"{label}: {chosen.sum()}"
            axes.plot(*at, ".", color=colour, markersize=size, markeredgewidth=0.0, label=name)
    low, high = np.percentile(cells, [0.1, 99.9], axis=0)
    axes.set(xlim=(low[0] - 1.0, high[0] + 1.0), ylim=(low[1] - 1.0, high[1] + 1.0))
    axes.set(xlabel="x [m]", ylabel="y [m]", aspect="equal")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)


def _draw_shares(axes: Axes, scans: list[Checked]) -> None:
    shown, _, right = _judged(scans)
    for low, high in pairwise(_EDGES):
        chosen = (shown >= low) & (shown < high)
        if not chosen.any():
            continue
        share = 100.0 * float(np.mean(right[chosen]))
        axes.bar(50.0 * (low + high), share, width=98.0 * (high - low), color=DARK)
        axes.text(50.0 * (low + high), share + 1.5, str(chosen.sum()), ha="center")
    axes.set(xlabel="readings of the scan that the map shows [%]", ylabel="scans found [%]")
    axes.set(xlim=(0.0, 100.0), ylim=(0.0, 107.0))
