"""curvescan.plot: figures of a match, a trajectory and a map on Matplotlib's axes, for notebooks and own figures."""

from __future__ import annotations

import math
import os
import textwrap
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias, runtime_checkable

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan.engines import RunRecord
from curvescan.errors import InvalidArgumentError
from curvescan.io.log import Log
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.mapping.occupancy import OccupancyBuilder, OccupancyGrid
from curvescan.matchers.result import MatchResult
from curvescan.plots.colours import FIRST, PATH, SECOND
from curvescan.plots.map import as_place, draw_grid, mark_ends
from curvescan.plots.match import draw_overlay
from curvescan.scan import LaserScan
from curvescan.slam import Localizer, Slam, SlamMap
from curvescan.slam.map import as_map
from curvescan.types import Cov, Pose

if TYPE_CHECKING:
    from matplotlib.axes import Axes

__all__ = ["map", "match", "trajectory"]

_Path: TypeAlias = str | os.PathLike[str]
_TITLE = 45  # columns of a title, as a subplot takes it
_N_ELLIPSES = 12
_SHARE = 0.8  # of the pixels along the axes that blocks of cells may take: axes are smaller than their place
_SIGMAS = 3.0
_ELLIPSE = 64  # corners of its polygon


@runtime_checkable
class MappedRun(Protocol):
    """What :func:`curvescan.run` returns."""

    @property
    def record(self) -> RunRecord:
        """The steps in columns."""

    @property
    def map(self) -> SlamMap | OccupancyGrid | None:
        """The map; None where it would be too large."""


def match(
    result: MatchResult, reference: LaserScan | None = None, current: LaserScan | None = None, *, ax: Axes | None = None
) -> Axes:
    """Draw two scans as their match aligns them, and return the axes.

    Parameters
    ----------
    result : MatchResult
        Of any method. Where it is not `ok`, the scans are drawn as measured, each in its own frame.
    reference, current : LaserScan or None
        The scans; None where `result` has them, as those of :func:`curvescan.match` do.
    ax : Axes or None
        Where to draw; None for the axes of a new figure.

    Raises
    ------
    InvalidArgumentError
        When `result` is no MatchResult, or its scans are neither in it nor given.
    """
    if not isinstance(result, MatchResult):
        raise InvalidArgumentError(f"result must be a MatchResult, got {type(result).__name__}")
    reference, current = reference or result.reference, current or result.current
    if reference is None or current is None:
        raise InvalidArgumentError(
            "the result of a match within an odometry does not keep its scans: give reference= and current="
        )
    axes = _axes(ax)
    points = se2.transform(result.pose, current.points) if result.ok else current.points
    draw_overlay(axes, result, reference.points, points)
    if result.ok:
        axes.plot(*result.pose[:2], "o", color=SECOND, ms=4, label="sensor, current")
    matched = ", matched" * result.ok
    axes.plot([], [], ".", color=FIRST, label=f"first scan{matched}")
    axes.plot([], [], ".", color=SECOND, label=f"second scan{matched}")
    title = f"{result.n_matched:,} readings matched" if result.ok else result.outcome.value
    as_place(axes)
    axes.set_title(textwrap.fill(f"{result.method}: {title}", _TITLE))
    axes.legend(loc="best", fontsize="small")
    return axes


def trajectory(
    source: Trajectory | RunRecord | MappedRun | Slam | ArrayLike,
    *,
    ax: Axes | None = None,
    label: str | None = None,
    **style: Any,
) -> Axes:
    """Draw a trajectory with its start, its end and, where it has covariances, 3-sigma ellipses; return the axes.

    Parameters
    ----------
    source : Run, Slam, Trajectory or (n, 3) array_like
        Poses [x, y, theta]: metres, metres, radians; rows of NaN are left out.
    ax : Axes or None
        Where to draw; None for the axes of a new figure.
    label : str or None
        Of the legend.
    **style
        For ``Axes.plot``: color, lw, ls, ...

    Raises
    ------
    InvalidArgumentError
        When `source` is none of the above.
    """
    from matplotlib.cbook import normalize_kwargs
    from matplotlib.lines import Line2D

    poses, covariances = _poses(source)
    axes = _axes(ax)
    look: dict[str, Any] = {"color": PATH, "linewidth": 1.2} | normalize_kwargs(style, Line2D)
    axes.plot(*poses[:, :2].T, label=label, **look)
    mark_ends(axes, poses, look["color"])
    if covariances is not None and len(poses):
        angles = np.linspace(0.0, 2.0 * math.pi, _ELLIPSE)
        circle = np.column_stack([np.cos(angles), np.sin(angles)])
        for k in np.unique(np.linspace(0, len(poses) - 1, _N_ELLIPSES).astype(int)):
            values, directions = np.linalg.eigh(covariances[k, :2, :2])
            ellipse = poses[k, :2] + _SIGMAS * (circle * np.sqrt(np.maximum(values, 0.0))) @ directions.T
            axes.fill(*ellipse.T, color=look["color"], alpha=0.15, lw=0.0)
    as_place(axes)
    if label:
        axes.legend(loc="best", fontsize="small")
    return axes


def map(  # noqa: A001 - its name in the public contract
    source: MappedRun | Slam | Localizer | SlamMap | OccupancyGrid | OccupancyBuilder | Log | _Path,
    trajectory: Trajectory | ArrayLike | None = None,
    *,
    ax: Axes | None = None,
) -> Axes:
    """Draw an occupancy map, and return the axes.

    Parameters
    ----------
    source : Run, Slam, Localizer, SlamMap, OccupancyGrid, OccupancyBuilder, Log or path
        A map or its file, or what one is made from: a run, SLAM as it is now, a log with its sensor's `trajectory`.
    trajectory : Trajectory, (n, 3) array_like or None
        Pose of the sensor at each scan of a Log; for a map it is drawn on it where it is given. A run and a Slam bring
        their own.
    ax : Axes or None
        Where to draw; None for the axes of a new figure.

    Raises
    ------
    InvalidArgumentError
        When `source` is none of the above, or a Log without a trajectory, or the map has no cell.
    """
    if trajectory is None and isinstance(source, MappedRun):
        trajectory = source.record.trajectory
    elif trajectory is None and isinstance(source, Slam):
        trajectory = source.trajectory()
    grid = _grid_of(source, trajectory)
    if not grid.log_odds.size:
        raise InvalidArgumentError("the map has no cell: no scan with a valid reading was entered")
    axes = _axes(ax)
    as_place(axes)
    draw_grid(axes, grid.blocks(int(_SHARE * max(axes.get_window_extent().size))))
    if trajectory is not None:
        poses = _poses(trajectory)[0]
        axes.plot(*poses[:, :2].T, color=PATH, lw=0.8, label="path of the sensor")
    axes.legend(loc="best", fontsize="small")
    return axes


def _grid_of(source: Any, trajectory: Trajectory | ArrayLike | None) -> OccupancyGrid:
    """Return the occupancy map of what `map` takes."""
    found = source.map if isinstance(source, MappedRun | Slam | Localizer) else source
    if isinstance(found, OccupancyGrid):
        return found
    if isinstance(found, OccupancyBuilder):
        return found.grid()
    if isinstance(found, SlamMap | str | os.PathLike):
        return as_map(found).occupancy()
    if isinstance(source, MappedRun):
        raise InvalidArgumentError("the run has no occupancy map: it would be too large, or no scan has a reading")
    if not isinstance(found, Log):
        raise InvalidArgumentError(
            "source must be a Run, a Slam, a Localizer, a SlamMap or its file, an OccupancyGrid, an OccupancyBuilder or"
            f" a Log, got {type(source).__name__}"
        )
    if trajectory is None:
        raise InvalidArgumentError("the map of a log needs the poses of its scans: give trajectory=")
    builder = OccupancyBuilder()
    for scan, pose in zip(found, _poses(trajectory, keeps_nan=True)[0], strict=False):
        builder.add(scan, pose)
    return builder.grid()


def _axes(ax: Axes | None) -> Axes:
    if ax is not None:
        return ax
    import matplotlib.pyplot as plt

    return plt.figure(layout="constrained").subplots()


def _poses(source: Any, *, keeps_nan: bool = False) -> tuple[Pose, Cov | None]:
    covariances = None
    if isinstance(source, MappedRun):
        source = source.record
    if isinstance(source, RunRecord):
        source = source.trajectory
    elif isinstance(source, Slam):
        source = source.trajectory()
    if isinstance(source, Trajectory):
        poses, covariances = source.poses, source.covariances
    else:
        try:
            poses = np.asarray(source, dtype=np.float64)
        except (TypeError, ValueError):
            poses = np.empty(0)
        if poses.ndim != 2 or poses.shape[1] != 3:
            raise InvalidArgumentError(
                f"a trajectory must be a Trajectory, a run or poses of shape (n, 3), got {type(source).__name__}"
                + (f" of shape {poses.shape}" if poses.size else "")
            )
    known = np.isfinite(poses).all(axis=1)
    if keeps_nan or known.all():
        return poses, covariances
    return poses[known], None if covariances is None else covariances[known]
