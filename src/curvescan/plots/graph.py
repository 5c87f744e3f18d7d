"""The pose graph as a picture: keyframes, matches of neighbours along the way, and loop closures."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from curvescan.plots.canvas import FAILED, GREY, LIGHT, PAIRED, PATH, as_place, drawing_places
from curvescan.slam.loops.closures import is_loop
from curvescan.slam.map import SlamMap
from curvescan.slam.pose_graph.graph import EdgeKind
from curvescan.types import Bools, Points


def draw_graph(path: Path, slam_map: SlamMap, cells: Points, *, title: str) -> None:
    """Save the pose graph of a map as a picture. cells (k, 2)."""
    places = np.concatenate((cells, slam_map.poses[:, :2]))
    with drawing_places(path, places) as (figure, [axes]):
        as_place(axes, title)
        axes.plot(*cells.T, "s", color=GREY, ms=0.7, mew=0.0)
        plot_graph(slam_map, axes)
        if axes.get_legend_handles_labels()[0]:  # none where the graph has one keyframe
            figure.legend(loc="outside lower center", ncols=4)


def plot_graph(slam_map: SlamMap, axes: Axes) -> None:
    """Draw the pose graph of a map on axes."""
    is_closure = np.asarray(slam_map.kinds == EdgeKind.CLOSURE)
    is_used = np.asarray(slam_map.weights > 0.5)
    follows = np.asarray(slam_map.kinds == EdgeKind.MATCH) & is_used
    sessions = np.asarray(slam_map.sessions)[slam_map.ends]
    closes = is_loop(slam_map.ends[:, 0], slam_map.ends[:, 1])
    closes |= sessions[:, 0] != sessions[:, 1]
    for chosen, colour, label in (
        (is_closure & is_used & closes, PAIRED, "loop closures"),
        (is_closure & is_used & ~closes, LIGHT, "matches of neighbours"),
        (is_closure & ~is_used, FAILED, "without weight"),
        (follows, PATH, "keyframes that follow each other"),
    ):
        _draw_edges(axes, slam_map, chosen, colour, f"{label} ({np.count_nonzero(chosen):,})")
    axes.plot(*slam_map.poses[:, :2].T, ".", color=PATH, ms=2.0, mew=0.0)


def _draw_edges(axes: Axes, slam_map: SlamMap, chosen: Bools, colour: str, label: str) -> None:
    if not chosen.any():
        return
    lines = slam_map.poses[slam_map.ends[chosen], :2]
    axes.add_collection(LineCollection(list(lines), colors=colour, linewidths=0.4))
    axes.plot([], [], color=colour, lw=1.0, label=label)
