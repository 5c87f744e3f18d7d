"""Localization of a whole log in a map, and its result folder."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from curvescan._interrupts import stoppable
from curvescan._version import __version__
from curvescan.io.trajectories.layouts import write_csv, write_tum
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.odometry.run import pose_at
from curvescan.plots.canvas import DARK, PATH, as_place, drawing_places
from curvescan.runs.plain import as_plain
from curvescan.runs.results import write_record
from curvescan.scan import LaserScan
from curvescan.slam.localization.step import LocalizerOutcome, LocalizerStep
from curvescan.slam.localizer import Localizer
from curvescan.types import Floats, Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class LocalizerRun:
    """Localization of a whole log.

    Attributes
    ----------
    localizer : Localizer
        As it was at the end.
    trajectory : Trajectory
        Pose and covariance at each scan in the frame of the map; NaN while the sensor was searched for.
    outcomes : tuple of LocalizerOutcome
        How each scan was found.
    seconds : (n,) float64
        Time that each scan took.
    is_partial : bool
        Whether the run was interrupted.
    """

    localizer: Localizer
    trajectory: Trajectory
    outcomes: tuple[LocalizerOutcome, ...]
    seconds: Floats
    is_partial: bool

    @property
    def first_fix(self) -> int | None:
        """Number of the first scan whose pose is known; None where none is."""
        known = np.flatnonzero(np.isfinite(self.trajectory.poses[:, 0]))
        return int(known[0]) if known.size else None


def run_localizer(
    scans: Iterable[LaserScan],
    localizer: Localizer,
    *,
    odometry_poses: Pose | None = None,
    on_step: Callable[[LocalizerStep], None] | None = None,
) -> LocalizerRun:
    """Return the localization of a sequence of scans; Ctrl-C ends it and gives what there is so far."""
    steps: list[LocalizerStep] = []
    seconds: list[float] = []
    with stoppable() as stop:
        for k, scan in enumerate(scans):
            started = time.perf_counter()
            step = localizer.add(scan, pose_at(odometry_poses, k))
            seconds.append(time.perf_counter() - started)
            steps.append(step)
            if on_step:
                on_step(step)
            if stop.is_asked:
                break
    n = len(steps)
    return LocalizerRun(
        localizer=localizer,
        trajectory=Trajectory(
            stamps=np.array([s.stamp for s in steps]),
            poses=np.array([s.pose for s in steps]).reshape(n, 3),
            covariances=np.array([s.covariance for s in steps]).reshape(n, 3, 3),
        ),
        outcomes=tuple(s.outcome for s in steps),
        seconds=np.array(seconds[:n]),
        is_partial=stop.is_asked,
    )


def save_localizer_run(
    folder: Path,
    run: LocalizerRun,
    *,
    name: str,
    command: tuple[str, ...] = (),
    further: Mapping[str, object] | None = None,
) -> None:
    """Write trajectory.tum, trajectory.csv, map.png and run.json, with `further` entries, into an existing folder."""
    write_tum(folder / "trajectory.tum", run.trajectory)
    write_csv(folder / "trajectory.csv", run.trajectory, [o.name.lower() for o in run.outcomes])
    cells = run.localizer.map.occupancy().occupied_centres
    poses = run.trajectory.poses[np.isfinite(run.trajectory.poses[:, 0])]
    places = np.concatenate((cells, poses[:, :2], run.localizer.map.poses[:, :2]))
    with drawing_places(folder / "map.png", places) as (_, [axes]):
        as_place(axes, f"{name}: {len(run.outcomes):,} scans localized")
        axes.plot(*cells.T, "s", color=DARK, ms=0.8, mew=0.0)
        axes.plot(*poses[:, :2].T, ".", color=PATH, ms=1.5, mew=0.0)
    counts = Counter(run.outcomes)
    record = {
        "curvescan": __version__,
        "command": list(command),
        "scans": len(run.outcomes),
        "is_partial": run.is_partial,
        "outcomes": {o.name.lower(): counts[o] for o in LocalizerOutcome},
        "first_fix": run.first_fix,
        "config": as_plain(run.localizer.config),
        "milliseconds_per_scan": {
            "median": round(float(np.median(1e3 * run.seconds)), 4),
            "max": round(float(np.max(1e3 * run.seconds)), 4),
        },
    }
    write_record(folder, {**record, **(further or {})})
