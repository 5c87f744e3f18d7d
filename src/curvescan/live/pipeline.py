"""run_live: source -> tracker -> sinks, until the source ends or Ctrl-C."""

from __future__ import annotations

import threading
import time
from array import array
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from curvescan._interrupts import stoppable
from curvescan.engines import RunRecord
from curvescan.engines.record import Recorder
from curvescan.engines.run import finished
from curvescan.errors import CurvescanError
from curvescan.live.sinks import BoundedQueue, LiveSink, MapSink
from curvescan.live.sources import ScanSource
from curvescan.live.tracker import TrackedScan, Tracker
from curvescan.scan import LaserScan
from curvescan.slam import Slam
from curvescan.types import Floats

_CAPACITY = 4  # scans that may wait for the tracker: at 10 Hz a hiccup of 0.4 s
_POLL = 0.2  # seconds between two looks at the keyboard's interrupt while no scan comes


@dataclass(frozen=True, eq=False, kw_only=True)
class LiveReport:
    """How a live run went."""

    record: RunRecord  # the steps in columns: outcomes, poses, and the time that tracking each scan took
    n_dropped: int  # scans of the source that were dropped because tracking was too slow
    n_closures: int  # loop closures
    latencies: Floats  # (n,): from the scan's arrival to its pose, seconds
    is_interrupted: bool  # whether Ctrl-C ended the run
    error: CurvescanError | None  # what ended the source before its time

    @property
    def n_scans(self) -> int:
        """Scans tracked."""
        return len(self.record.outcomes)

    def record_of(self, n_scans: int) -> RunRecord:
        """Return the record, partial where the source had a fault or has more scans, `n_scans` in all."""
        return replace(self.record, is_partial=self.error is not None or n_scans > self.n_scans)


def run_live(
    source: ScanSource,
    tracker: Tracker,
    sinks: Sequence[LiveSink] = (),
    *,
    is_lossless: bool | None = None,
    on_scan: Callable[[TrackedScan], object] | None = None,
) -> LiveReport:
    """Track the scans of a source, which is opened and closed here, and hand them to sinks, which the caller closes.

    A live source never waits: when tracking falls behind by more than four scans, the oldest is dropped and counted. A
    fault of the source ends the run, and the report names it. is_lossless: whether the source waits, None: unless it is
    live; on_scan: called after each scan. Raises SourceError where the source cannot be opened.
    """
    lossless = not source.is_live if is_lossless is None else is_lossless
    queue: BoundedQueue[tuple[LaserScan, float]] = BoundedQueue(_CAPACITY, is_lossless=lossless)
    recorder, latencies, n_closures = Recorder(), array("f"), 0
    fault: list[CurvescanError] = []

    def read() -> None:
        try:
            for scan in source.scans():
                if not queue.put((scan, time.monotonic())):
                    return
        except CurvescanError as error:
            fault.append(error)
        finally:
            queue.close()

    with source, stoppable() as stop:
        threading.Thread(target=read, name="scan source", daemon=True).start()
        try:
            while (item := queue.get(_POLL)) is not None or not queue.is_done:
                if stop.is_asked:
                    break
                if item is None:
                    continue
                scan, received = item
                tracked = tracker.add(scan, received=received, n_dropped=queue.n_dropped)
                recorder.add(tracked.step, tracked.seconds)
                latencies.append(time.monotonic() - received)
                n_closures += len(tracked.closures)
                for sink in sinks:
                    sink.put(tracked)
                if on_scan:
                    on_scan(tracked)
        finally:
            queue.close()
    return LiveReport(
        record=recorder.record(tracker.engine.method, is_partial=False, has_prior=tracker.has_prior),
        n_dropped=queue.n_dropped,
        n_closures=n_closures,
        latencies=np.asarray(latencies),
        is_interrupted=stop.is_asked,
        error=fault[0] if fault else None,
    )


def finish(report: LiveReport, tracker: Tracker, sinks: Sequence[MapSink]) -> LiveReport:
    """Return the report of a run of SLAM after its graph is optimized once more; the sinks get the final poses."""
    if not report.n_scans or not isinstance(tracker.engine, Slam):
        return report
    with tracker.lock:
        record = finished(report.record, tracker.engine)
    for sink in sinks:
        sink.finish_with(record.trajectory.poses)
    return replace(report, record=record)
