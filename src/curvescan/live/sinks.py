"""LiveSink: where tracked scans go; WorkerSink is the base of those that take their time."""

from __future__ import annotations

import threading
from typing import Protocol, runtime_checkable

from curvescan.errors import CurvescanError
from curvescan.live.queues import BoundedQueue
from curvescan.live.tracker import TrackedScan


@runtime_checkable
class LiveSink(Protocol):
    """What takes in tracked scans: a page, a file, a middleware."""

    def put(self, tracked: TrackedScan) -> None:
        """Take in a scan; must not wait for anything slow."""
        ...

    def close(self) -> None:
        """Finish what was taken in; called once, at the end."""
        ...


class WorkerSink:
    """A sink with a thread and a bounded queue of its own; subclasses write :meth:`_take`.

    Parameters
    ----------
    name : str
        Name of the thread.
    capacity : int
        Scans held at most.
    is_lossless : bool
        Whether `put` waits for room when the source can wait (a log); else the oldest scan is dropped and counted.
    """

    def __init__(self, name: str, *, capacity: int = 1000, is_lossless: bool = False) -> None:
        self._queue: BoundedQueue[TrackedScan] = BoundedQueue(capacity, is_lossless=is_lossless)
        self._thread = threading.Thread(target=self._work, name=name, daemon=True)
        self.error: CurvescanError | None = None
        self._thread.start()

    @property
    def n_dropped(self) -> int:
        """Scans that were dropped because the sink was too slow."""
        return self._queue.n_dropped

    def put(self, tracked: TrackedScan) -> None:
        """Take in a scan."""
        self._queue.put(tracked)

    def close(self) -> None:
        """Finish what was taken in."""
        self._queue.close()
        self._thread.join()
        self._finish()

    def _work(self) -> None:
        while (tracked := self._queue.get()) is not None:
            if self.error is None:
                try:
                    self._take(tracked)
                except CurvescanError as error:
                    self.error = error  # reported at the end; the other sinks and the poses go on

    def _take(self, tracked: TrackedScan) -> None:
        """Process one scan, in the sink's thread."""
        raise NotImplementedError

    def _finish(self) -> None:
        """Finish, in the caller's thread, after the last scan."""
