"""ResultsSink: the results folder of a live run, by the writers of `curvescan odometry`, `slam` and `localize`."""

from __future__ import annotations

import time
from array import array
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from curvescan.io.files.read_errors import ReadError
from curvescan.io.log import Log, ScanAccess
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.live.pipeline import LiveReport
from curvescan.live.sinks import MapSink
from curvescan.live.tracker import TrackedScan
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.map_server import write_map
from curvescan.mapping.run_maps import RunMaps, build_maps
from curvescan.matchers import Outcome
from curvescan.odometry import OdometryRun
from curvescan.plots.occupancy import draw_occupancy
from curvescan.runs.localize import LocalizerRun, save_localizer_run
from curvescan.runs.odometry import save_run
from curvescan.runs.slam import save_slam_run
from curvescan.scan import LaserScan
from curvescan.slam import Slam, SlamRun
from curvescan.types import Pose

_LONGEST_STEP_S = 2.0
"""What moved is looked for between scans that are kept at most so far apart, seconds."""


class ResultsSink(MapSink):
    """Keeps the trajectory (about 200 bytes a scan) and scans for the map, in a thread of its own.

    Parameters
    ----------
    occupancy : OccupancyConfig or None
        How to make the occupancy map.
    mode : str
        "odometry", "SLAM" or "localization".
    is_lossless : bool
        Whether the tracker waits for this sink.
    """

    def __init__(
        self, *, occupancy: OccupancyConfig | None = None, mode: str = "odometry", is_lossless: bool = False
    ) -> None:
        self._occupancy, self._mode = occupancy, mode
        self._stamps, self._poses, self._odom, self._covariances, self._seconds = (array("d") for _ in range(5))
        self._n_matched, self._is_degenerate = array("q"), array("b")
        self._outcomes: list[Any] = []
        self._failures: Counter[Outcome] = Counter()
        self._n_rejected = 0
        # scans are kept without SLAM too: the maps are made of them at the end
        is_kept = mode != "localization"
        super().__init__("results", occupancy=occupancy, is_revisable=is_kept, capacity=2000, is_lossless=is_lossless)

    def put(self, tracked: TrackedScan) -> None:
        """Take in a scan; its pose at once, so that none is missing in the trajectory."""
        match = tracked.match
        self._stamps.append(tracked.scan.stamp)
        self._poses.extend(tracked.pose)
        self._odom.extend(tracked.pose_odom)
        self._covariances.extend(tracked.covariance.ravel())
        self._seconds.append(tracked.seconds)
        self._n_matched.append(match.n_matched if match else 0)
        self._is_degenerate.append(match is not None and match.degenerate_direction is not None)
        self._outcomes.append(tracked.outcome)
        if match and not match.ok:
            self._failures[match.outcome] += 1
        elif match and not tracked.is_matched:
            self._n_rejected += 1
        super().put(tracked)

    def _take(self, tracked: TrackedScan) -> None:
        self._map.add(tracked)

    def trajectory(self) -> Trajectory:
        """Return stamp, pose and covariance of each scan, as they were reported at the time."""
        return Trajectory(
            stamps=np.array(self._stamps),
            poses=np.array(self._poses).reshape(-1, 3),
            covariances=np.array(self._covariances).reshape(-1, 3, 3),
        )

    def write(
        self,
        folder: Path,
        report: LiveReport,
        *,
        name: str,
        engine: Any,
        log: Log | None = None,
        command: Sequence[str] = (),
    ) -> tuple[str, ...]:
        """Write the results into an existing folder, after the sink was closed, and return the names of the files.

        Of a log that was replayed they are those of the offline command. A laser's scans have gone: its maps are drawn from
        those that were kept, one for every 0.15 m and 20 degrees.

        Parameters
        ----------
        folder : Path
            Where to write.
        report : LiveReport
            How the run went; at least one scan.
        name : str
            Name of the source.
        engine : Odometry, Slam or Localizer
            What ran.
        log : Log or None
            What was replayed; None for a source that cannot be read again.
        command : sequence of str
            The command line behind the run.
        """
        further = {"live": {"mode": self._mode, **record_of(report)}}
        if self._mode == "localization":
            self._write_localization(folder, report, name, engine, command, further)
        elif self._mode == "SLAM":
            revised = self._finished(engine)
            slam_run = SlamRun(
                slam=engine,
                revised=self._run(engine.method, revised, report, len(log or ())),
                online=self.trajectory(),
                odometry=Trajectory(stamps=np.array(self._stamps), poses=np.array(self._odom).reshape(-1, 3)),
                seconds_to_finish=self._seconds_to_finish,
            )
            save_slam_run(
                folder,
                slam_run,
                log or _Passed(name, report.n_scans),
                command=command,
                occupancy=self._occupancy,
                maps=None if log else self._maps(revised.poses),
                further=further,
            )
        else:
            run = self._run(engine.method, self.trajectory(), report, len(log or ()))
            save_run(
                folder,
                run,
                log or _Passed(name, report.n_scans),
                odometry=engine,
                command=command,
                occupancy=self._occupancy,
                maps=None if log else self._maps(run.trajectory.poses),
                further=further,
            )
        return tuple(sorted(path.name for path in folder.iterdir()))

    def _finished(self, engine: Slam) -> Trajectory:
        """Return every pose of the finished graph; one that was finished is not touched again, which would move its poses."""
        if self._final is not None:
            return engine.trajectory()
        started = time.perf_counter()
        trajectory = engine.finish()
        self._seconds_to_finish = time.perf_counter() - started
        return trajectory

    def _run(self, method: str, trajectory: Trajectory, report: LiveReport, n_whole: int) -> OdometryRun:
        return OdometryRun(
            method=method,
            trajectory=trajectory,
            outcomes=tuple(self._outcomes),
            failures=dict(self._failures.most_common()),
            n_rejected=self._n_rejected,
            n_matched=np.array(self._n_matched, dtype=np.int64),
            is_degenerate=np.array(self._is_degenerate, dtype=np.bool_),
            seconds=np.array(self._seconds),
            is_partial=report.error is not None or n_whole > report.n_scans,
        )

    def _maps(self, poses: Pose) -> RunMaps:
        """Return the maps of the scans that were kept, under the poses of all scans."""
        kept = self._map.kept()
        indices = np.array([index for index, _ in kept], dtype=np.int64)
        scans = [scan for _, scan in kept]
        stamps = np.array([scan.stamp for scan in scans])
        steps = np.diff(stamps, prepend=-np.inf)
        is_joined = (steps > 0.0) & (steps < _LONGEST_STEP_S)
        config = self._occupancy or OccupancyConfig()
        return build_maps(scans, poses[indices], is_joined, occupancy=config)

    def _write_localization(
        self,
        folder: Path,
        report: LiveReport,
        name: str,
        engine: Any,
        command: Sequence[str],
        further: Mapping[str, object],
    ) -> None:
        run = LocalizerRun(
            localizer=engine,
            trajectory=self.trajectory(),
            outcomes=tuple(self._outcomes),
            seconds=np.array(self._seconds),
            is_partial=report.is_interrupted or report.error is not None,
        )
        grid = self._map.grid()
        if grid.log_odds.size:
            write_map(folder, grid)
            title = f"{name}: {report.n_scans:,} scans localized"
            draw_occupancy(folder / "occupancy.png", grid, run.trajectory.poses, title=title)
        save_localizer_run(folder, run, name=name, command=tuple(command), further=further)


class _Passed(ScanAccess):
    """The log of a sensor whose scans have passed: a name and a number."""

    format = "live"
    odometry: Trajectory | None = None
    read_errors: tuple[ReadError, ...] = ()
    tag_counts: Mapping[str, int] = {}
    notes: tuple[str, ...] = ()

    def __init__(self, name: str, n_scans: int) -> None:
        self.name, self._n_scans = name, n_scans

    def __len__(self) -> int:
        return self._n_scans

    def __iter__(self) -> Iterator[LaserScan]:
        return iter(())


def record_of(report: LiveReport) -> dict[str, object]:
    """Return how a live run went, as run.json holds it."""
    record: dict[str, object] = {
        "scans": report.n_scans,
        "dropped": report.n_dropped,
        "loop_closures": report.n_closures,
        "is_interrupted": report.is_interrupted,
        "error": None if report.error is None else str(report.error),
        "outcomes": {_name(kind): count for kind, count in report.outcomes.items()},
    }
    for key, values in (("milliseconds_per_scan", report.seconds), ("milliseconds_scan_to_pose", report.latencies)):
        median, p99, worst = np.percentile(1e3 * values, [50.0, 99.0, 100.0]).tolist()
        record[key] = {"median": round(median, 4), "p99": round(p99, 4), "max": round(worst, 4)}
    return record


def _name(kind: Enum) -> str:
    return kind.name.lower()
