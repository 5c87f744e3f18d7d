"""The map of a run, as in the paper's figure 7: from matching (dark) over from wheel odometry (light)."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from curvescan.types import Bools, Points, Pose
from curvescan.view.canvas import (
    DARK,
    FAILED,
    GREY,
    LIGHT,
    PATH,
    TRUTH,
    WHEELS,
    as_place,
    drawing_places,
)


def draw_map(
    path: Path,
    *,
    title: str,
    cells: Points,
    poses: Pose,
    failed: Bools,
    moved_cells: Points,
    wheel_cells: Points | None = None,
    wheel_poses: Pose | None = None,
    true_poses: Pose | None = None,
) -> None:
    """Save the map of a run as a picture.

    Parameters
    ----------
    path : Path
        The PNG to write.
    title : str
        Drawn above the map.
    cells : (k, 2) float64
        Cells of what stands, under the trajectory from matching, metres.
    poses : (n, 3) float64
        That trajectory.
    failed : (n,) bool
        Where its match failed; marked by crosses.
    moved_cells : (m, 2) float64
        Cells in which something moved, drawn in grey; may be empty.
    wheel_cells, wheel_poses : (j, 2), (n, 3) float64 or None
        The same under wheel odometry, in the frame of the first scan.
    true_poses : (n, 3) float64 or None
        True trajectory, in the frame of the first scan.
    """
    everything = [cells, moved_cells, poses[:, :2], np.zeros((1, 2))]
    if wheel_cells is not None:
        everything.append(wheel_cells)
    with drawing_places(path, np.concatenate(everything)) as (figure, [axes]):
        as_place(axes, title)
        if wheel_cells is not None:
            _draw_cells(axes, wheel_cells, LIGHT, "map from wheel odometry")
        if len(moved_cells):
            _draw_cells(axes, moved_cells, GREY, "moved while the sensor passed")
        _draw_cells(axes, cells, DARK, "map from scan matching")
        if wheel_poses is not None:
            axes.plot(*wheel_poses[:, :2].T, color=WHEELS, lw=0.9, ls=":", label="wheel odometry")
        if true_poses is not None:
            axes.plot(*true_poses[:, :2].T, color=TRUTH, lw=1.2, ls="--", label="truth")
        axes.plot(*poses[:, :2].T, color=PATH, lw=1.0, label="scan matching")
        if failed.any():
            label = f"match failed ({np.count_nonzero(failed):,} of {max(len(poses) - 1, 1):,})"
            axes.plot(*poses[failed, :2].T, "x", color=FAILED, ms=3.5, mew=0.8, label=label)
        axes.plot(*poses[0, :2], "o", color="white", mec=PATH, mew=1.4, ms=6.0, label="start")
        axes.plot(*poses[-1, :2], "s", color="white", mec=PATH, mew=1.4, ms=6.0, label="end")
        figure.legend(loc="outside lower center", ncols=3)


def _draw_cells(axes: Axes, cells: Points, colour: str, label: str) -> None:
    # as large as a cell of 0.05 m on paper, but never too small to see
    size = np.clip(72.0 * 9.0 * 0.05 / np.ptp(axes.get_xlim()), 0.7, 3.0)
    axes.plot(*cells.T, "s", color=colour, ms=size, mew=0.0)
    axes.plot([], [], "s", color=colour, ms=4.0, mew=0.0, label=label)
