"""run_live: source -> tracker -> sinks, until the source ends or Ctrl-C."""

from __future__ import annotations

import threading
import time
from array import array
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from curvescan._interrupts import stoppable
from curvescan.errors import CurvescanError
from curvescan.live.sinks import BoundedQueue, LiveSink
from curvescan.live.sources import ScanSource
from curvescan.live.tracker import TrackedScan, Tracker
from curvescan.scan import LaserScan
from curvescan.types import Floats

_CAPACITY = 4  # scans that may wait for the tracker: at 10 Hz a hiccup of 0.4 s
_POLL = 0.2  # seconds between two looks at the keyboard's interrupt while no scan comes


@dataclass(frozen=True, eq=False, kw_only=True)
class LiveReport:
    """How a live run went."""

    n_scans: int  # scans tracked
    n_dropped: int  # scans of the source that were dropped because tracking was too slow
    outcomes: Counter[Enum]  # how often each outcome
    n_closures: int  # loop closures
    seconds: Floats  # (n,): time that tracking each scan took
    latencies: Floats  # (n,): from the scan's arrival to its pose, seconds
    is_interrupted: bool  # whether Ctrl-C ended the run
    error: CurvescanError | None  # what ended the source before its time


def run_live(
    source: ScanSource,
    tracker: Tracker,
    sinks: Sequence[LiveSink] = (),
    *,
    is_lossless: bool | None = None,
    on_scan: Callable[[TrackedScan], object] | None = None,
) -> LiveReport:
    """Track the scans of a source and hand them to the sinks.

    The source is read in a thread of its own. A live one is never kept waiting: when tracking falls behind by more than
    four scans the oldest is dropped and counted. A fault of the source ends the run; what came before is kept, and the
    report names the fault. The source is opened and closed here, the sinks are closed by the caller.

    is_lossless: whether the source waits for the tracker, so that nothing is dropped; None: unless it is live; on_scan:
    called after each scan, in the calling thread. Raises SourceError where the source cannot be opened.
    """
    lossless = not source.is_live if is_lossless is None else is_lossless
    queue: BoundedQueue[tuple[LaserScan, float]] = BoundedQueue(_CAPACITY, is_lossless=lossless)
    statistics = _Statistics()
    with source, stoppable() as stop:
        reader = _Reader(source, queue)
        try:
            while (item := queue.get(_POLL)) is not None or not queue.is_closed:
                if stop.is_asked:
                    break
                if item is None:
                    continue
                scan, received = item
                tracked = tracker.add(scan, received=received, n_dropped=queue.n_dropped)
                statistics.add(tracked)
                for sink in sinks:
                    sink.put(tracked)
                if on_scan:
                    on_scan(tracked)
        finally:
            queue.close()
    return statistics.report(queue.n_dropped, stop.is_asked, reader.error)


class _Reader:
    """Reads a source in a thread of its own."""

    def __init__(self, source: ScanSource, queue: BoundedQueue[tuple[LaserScan, float]]) -> None:
        self.error: CurvescanError | None = None
        self._source, self._queue = source, queue
        threading.Thread(target=self._read, name="scan source", daemon=True).start()

    def _read(self) -> None:
        try:
            for scan in self._source.scans():
                if not self._queue.put((scan, time.monotonic())):
                    return
        except CurvescanError as error:
            self.error = error
        finally:
            self._queue.close()


class _Statistics:
    def __init__(self) -> None:
        self._seconds, self._latencies = array("f"), array("f")
        self._outcomes: Counter[Enum] = Counter()
        self._n_closures = 0

    def add(self, tracked: TrackedScan) -> None:
        self._seconds.append(tracked.seconds)
        self._latencies.append(time.monotonic() - tracked.received)
        self._outcomes[tracked.outcome] += 1
        self._n_closures += len(tracked.closures)

    def report(self, n_dropped: int, is_interrupted: bool, error: CurvescanError | None) -> LiveReport:
        return LiveReport(
            n_scans=len(self._seconds),
            n_dropped=n_dropped,
            outcomes=self._outcomes,
            n_closures=self._n_closures,
            seconds=np.asarray(self._seconds),
            latencies=np.asarray(self._latencies),
            is_interrupted=is_interrupted,
            error=error,
        )
