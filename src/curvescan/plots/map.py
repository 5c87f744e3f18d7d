"""The map of a run, that of its wheels alone (the paper's figure 7), the same scans mapped twice, and the graph."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection

from curvescan import se2
from curvescan.io.log import Log
from curvescan.mapping.occupied_cells import occupied_cells
from curvescan.mapping.run_maps import RunMaps
from curvescan.odometry import RunRecord
from curvescan.plots.canvas import (
    DARK,
    FAILED,
    GREY,
    LIGHT,
    PAIRED,
    PATH,
    WHEELS,
    as_place,
    draw_truth,
    drawing_places,
    mark_ends,
)
from curvescan.slam.loops.closures import is_loop
from curvescan.slam.map import SlamMap
from curvescan.slam.pose_graph.graph import EdgeKind
from curvescan.types import Bools, Points, Pose


def draw_map(path: Path, run: RunRecord, place: RunMaps, *, title: str, truth: Pose | None = None) -> None:
    """Save the map of a run as a picture; truth (>= n, 3)."""
    poses, failed = run.trajectory.poses, run.is_failed
    known = poses[np.isfinite(poses[:, 0])]
    cells, moved_cells = place.standing, place.moved
    true_poses = None if truth is None else from_first(truth[: len(poses)])
    everything = [cells, moved_cells, poses[:, :2], np.zeros((1, 2))]
    with drawing_places(path, np.concatenate(everything)) as (figure, [axes]):
        as_place(axes, title)
        if len(moved_cells):
            draw_cells(axes, moved_cells, GREY, "moved while the sensor passed")
        draw_cells(axes, cells, DARK, "map from scan matching")
        if true_poses is not None:
            draw_truth(axes, true_poses)
        axes.plot(*poses[:, :2].T, color=PATH, lw=1.0, label="scan matching")
        if failed.any():
            label = f"match failed ({np.count_nonzero(failed):,} of {max(len(poses) - 1, 1):,})"
            axes.plot(*poses[failed, :2].T, "x", color=FAILED, ms=3.5, mew=0.8, label=label)
        mark_ends(axes, known)
        figure.legend(loc="outside lower center", ncols=3)


def draw_wheels(path: Path, log: Log, poses: Pose, *, title: str) -> None:
    """Save the map that a log's wheel odometry alone, poses (n, 3), makes of its scans."""
    poses = from_first(poses)
    cells = occupied_cells(log, poses)
    with drawing_places(path, np.concatenate([cells, poses[:, :2]])) as (figure, [axes]):
        as_place(axes, title)
        draw_cells(axes, cells, DARK, "map from wheel odometry")
        axes.plot(*poses[:, :2].T, color=WHEELS, lw=1.0, label="wheel odometry")
        figure.legend(loc="outside lower center", ncols=2)


def from_first(poses: Pose) -> Pose:
    """Return poses seen from the first one that is known."""
    known = np.flatnonzero(~np.isnan(poses[:, 2]))
    if known.size == 0:
        return poses
    return se2.between(poses[known[0]], poses)


def draw_cells(axes: Axes, cells: Points, colour: str, label: str) -> None:
    """Draw (k, 2) cells of 0.05 m on the axes of a map."""
    # as large as a cell of 0.05 m on paper, but never too small to see
    size = np.clip(72.0 * 9.0 * 0.05 / np.ptp(axes.get_xlim()), 0.7, 3.0)
    axes.plot(*cells.T, "s", color=colour, ms=size, mew=0)
    axes.plot([], [], "s", color=colour, ms=4, mew=0, label=label)


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
                draw_truth(axes, from_first(truth[: len(track)]))
            axes.plot(*track[:, :2].T, color=PATH, lw=1.0, label="trajectory")
            mark_ends(axes, track)
        handles = places[0].get_legend_handles_labels()
        figure.legend(*handles, loc="outside lower center", ncols=5)


def draw_graph(path: Path, slam_map: SlamMap, cells: Points, *, title: str) -> None:
    """Save the pose graph of a map as a picture. cells (k, 2)."""
    places = np.concatenate((cells, slam_map.poses[:, :2]))
    with drawing_places(path, places) as (figure, [axes]):
        as_place(axes, title)
        axes.plot(*cells.T, "s", color=GREY, ms=0.7, mew=0)
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
    axes.plot(*slam_map.poses[:, :2].T, ".", color=PATH, ms=2, mew=0)


def _draw_edges(axes: Axes, slam_map: SlamMap, chosen: Bools, colour: str, label: str) -> None:
    if not chosen.any():
        return
    lines = slam_map.poses[slam_map.ends[chosen], :2]
    axes.add_collection(LineCollection(list(lines), colors=colour, linewidths=0.4))
    axes.plot([], [], color=colour, lw=1.0, label=label)
