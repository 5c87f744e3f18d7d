"""One drive, mapped twice: the same scans under two trajectories, side by side."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from curvescan.io.log import Log
from curvescan.mapping.occupied_cells import occupied_cells
from curvescan.plots.canvas import DARK, PATH, TRUTH, as_place, drawing_places
from curvescan.plots.map import draw_cells, from_first
from curvescan.types import Pose


def draw_side_by_side(path: Path, log: Log, tracks: Mapping[str, Pose], truth: Pose | None = None) -> None:
    """Save a picture of the maps that the same scans make under several trajectories; truth (>= n, 3)."""
    poses = {title: from_first(track) for title, track in tracks.items()}
    cells = {title: occupied_cells(log, track) for title, track in poses.items()}
    everything = [*cells.values(), *(track[:, :2] for track in poses.values())]
    with drawing_places(path, np.concatenate(everything), len(tracks)) as (figure, places):
        for axes, (title, track) in zip(places, poses.items(), strict=True):
            as_place(axes, title)
            draw_cells(axes, cells[title], DARK, "where readings ended")
            if truth is not None:
                true = from_first(truth[: len(track)])
                axes.plot(*true[:, :2].T, color=TRUTH, lw=1.2, ls="--", label="truth")
            axes.plot(*track[:, :2].T, color=PATH, lw=1.0, label="trajectory")
            axes.plot(*track[0, :2], "o", color="white", mec=PATH, mew=1.4, ms=6.0, label="start")
            axes.plot(*track[-1, :2], "s", color="white", mec=PATH, mew=1.4, ms=6.0, label="end")
        handles = places[0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", ncols=5)
