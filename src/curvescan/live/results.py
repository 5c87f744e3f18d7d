"""ResultsSink: the results folder of a live run, the same as of an offline one."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Unpack

import numpy as np

from curvescan.diagnostics.preparation import PreparedLog
from curvescan.diagnostics.verdict import judge
from curvescan.engines.engine import Engine
from curvescan.io.arrays.memory import MemoryLog
from curvescan.live.pipeline import LiveReport
from curvescan.live.sinks import MapOptions, MapSink
from curvescan.live.tracker import TrackedScan
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.run_maps import RunMaps, build_maps
from curvescan.runs.result import Run
from curvescan.runs.results import percentiles, save_run
from curvescan.scan import LaserScan
from curvescan.slam import Localizer
from curvescan.types import Pose

_LONGEST_STEP_S = 2.0  # what moved is looked for between scans that are kept at most so far apart, seconds


class ResultsSink(MapSink):
    """Keeps scans for the map, in a thread of its own."""

    def __init__(self, **options: Unpack[MapOptions]) -> None:
        self._occupancy = options.get("occupancy") or OccupancyConfig()
        # scans are kept without SLAM too: the maps are made of them at the end
        super().__init__("results", is_revisable=options.get("mode") != "localization", capacity=2000, **options)

    def _take(self, tracked: TrackedScan) -> None:
        self._map.add(tracked)

    def write(
        self,
        folder: Path,
        report: LiveReport,
        *,
        name: str,
        engine: Engine,
        log: PreparedLog | None = None,
        command: Sequence[str] = (),
    ) -> tuple[str, ...]:
        """Write the results once SLAM is finished and the sink closed; a laser's maps are drawn from the scans kept."""
        scans = _Passed(name=name, n_scans=report.n_scans) if log is None else log.log
        record = report.record_of(len(scans))
        maps = self._maps(engine, record.trajectory.poses) if log is None or isinstance(engine, Localizer) else None
        run = Run(
            log=scans,
            scans=scans,
            engine=engine,
            record=record,
            prepared=log,
            verdict=judge(record, engine, log),
            occupancy=self._occupancy,
            maps=maps,
            command=tuple(command),
            details={"live": {"mode": self.mode, **_how_it_went(report)}},
        )
        save_run(folder, run)
        return tuple(sorted(path.name for path in folder.iterdir()))

    def _maps(self, engine: Engine, poses: Pose) -> RunMaps:
        """Return the maps of the scans that were kept, under the poses of all scans; of localization the live view."""
        if isinstance(engine, Localizer):
            grid = self._map.grid()
            cells = engine.map.occupancy().occupied_centres
            return RunMaps(standing=cells, moved=np.empty((0, 2)), grid=grid if grid.log_odds.size else None)
        kept = self._map.kept()
        indices, scans = np.array([index for index, _ in kept], dtype=np.int64), [scan for _, scan in kept]
        steps = np.diff([scan.stamp for scan in scans], prepend=-np.inf)
        is_joined = (steps > 0.0) & (steps < _LONGEST_STEP_S)
        return build_maps(scans, poses[indices], is_joined, occupancy=self._occupancy)


@dataclass(frozen=True, kw_only=True, repr=False)
class _Passed(MemoryLog):
    """The log of a sensor whose scans have passed: a name and a number."""

    n_scans: int
    scans: tuple[LaserScan, ...] = ()
    format: str = "live"

    def __len__(self) -> int:
        return self.n_scans


def _how_it_went(report: LiveReport) -> dict[str, object]:
    """Return the part of run.json that tells how a live run went: scans, drops, times."""
    return {
        "scans": report.n_scans,
        "dropped": report.n_dropped,
        "loop_closures": report.n_closures,
        "is_interrupted": report.is_interrupted,
        "error": None if report.error is None else str(report.error),
        "outcomes": {kind.name.lower(): count for kind, count in Counter(report.record.outcomes).items()},
        "milliseconds_per_scan": percentiles(report.record.seconds),
        "milliseconds_scan_to_pose": percentiles(report.latencies),
    }
