"""ResultsSink: the results folder of a live run: trajectory, occupancy map, run.json."""

from __future__ import annotations

from array import array
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from curvescan import __version__
from curvescan.io.trajectories.tum_csv import write_csv, write_tum
from curvescan.live.live_map import LiveMap
from curvescan.live.pipeline import LiveReport
from curvescan.live.sinks import WorkerSink
from curvescan.live.tracker import TrackedScan
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.map_server import write_map
from curvescan.plots.occupancy import draw_occupancy
from curvescan.runs.results import write_record
from curvescan.types import Trajectory


class ResultsSink(WorkerSink):
    """Keeps the trajectory (100 bytes a scan) and draws the map, in a thread of its own.

    Parameters
    ----------
    occupancy : OccupancyConfig or None
        How to make the occupancy map.
    is_revisable : bool
        Whether poses of the past may change (SLAM).
    is_lossless : bool
        Whether the tracker waits for this sink.
    """

    def __init__(
        self,
        *,
        occupancy: OccupancyConfig | None = None,
        is_revisable: bool = False,
        is_lossless: bool = False,
    ) -> None:
        self._map = LiveMap(occupancy, is_revisable=is_revisable)
        self._stamps, self._poses, self._covariances = array("d"), array("d"), array("d")
        self._outcomes: list[str] = []
        super().__init__("results", capacity=10_000, is_lossless=is_lossless)

    def _take(self, tracked: TrackedScan) -> None:
        self._map.add(tracked)
        self._stamps.append(tracked.scan.stamp)
        self._poses.extend(tracked.pose)
        self._covariances.extend(tracked.covariance.ravel())
        self._outcomes.append(tracked.outcome.name.lower())

    def _finish(self) -> None:
        self._map.redraw()

    def trajectory(self) -> Trajectory:
        """Return stamp, pose and covariance of each scan, as they were reported at the time."""
        n = len(self._outcomes)
        return Trajectory(
            stamps=np.array(self._stamps),
            poses=np.array(self._poses).reshape(n, 3),
            covariances=np.array(self._covariances).reshape(n, 3, 3),
        )

    def write(
        self,
        folder: Path,
        report: LiveReport,
        *,
        name: str,
        slam: Any = None,
        details: Mapping[str, object] | None = None,
    ) -> tuple[str, ...]:
        """Write the results into an existing folder, after the sink was closed, and return the names of the files.

        Parameters
        ----------
        folder : Path
            Where to write.
        report : LiveReport
            How the run went.
        name : str
            Name of the source.
        slam : Slam or None
            What was run: its revised trajectory and its map are written, and beside them what was reported at the time.
        details : mapping or None
            Further entries of run.json.
        """
        online = self.trajectory()
        trajectory = online if slam is None else slam.finish()
        write_tum(folder / "trajectory.tum", trajectory)
        write_csv(folder / "trajectory.csv", trajectory, self._outcomes)
        written = ["trajectory.tum", "trajectory.csv"]
        if slam is not None:
            write_tum(folder / "trajectory_online.tum", online)
            slam.map.save(folder / "map.csmap")
            written += ["trajectory_online.tum", "map.csmap"]
            self._map.redraw(trajectory.poses)
        grid = self._map.grid()
        if grid.log_odds.size:
            write_map(folder, grid)
            title = f"{name}: {report.n_scans:,} scans, live"
            draw_occupancy(folder / "occupancy.png", grid, trajectory.poses, title=title)
            written += ["map.pgm", "map.yaml", "occupancy.png"]
        record = (
            {"curvescan": __version__, "source": name} | record_of(report) | dict(details or {})
        )
        write_record(folder, record)
        return (*written, "run.json")


def record_of(report: LiveReport) -> dict[str, object]:
    """Return how a live run went, as run.json holds it."""
    record: dict[str, object] = {
        "scans": report.n_scans,
        "dropped": report.n_dropped,
        "loop_closures": report.n_closures,
        "is_partial": report.is_interrupted or report.error is not None,
        "error": None if report.error is None else str(report.error),
        "outcomes": {kind.name.lower(): count for kind, count in report.outcomes.items()},
    }
    if report.n_scans:
        for key, values in (
            ("milliseconds_per_scan", report.seconds),
            ("milliseconds_scan_to_pose", report.latencies),
        ):
            median, p99, worst = np.percentile(1e3 * values, [50.0, 99.0, 100.0]).tolist()
            record[key] = {
                "median": round(median, 4),
                "p99": round(p99, 4),
                "max": round(worst, 4),
            }
    return record
