"""LiveSink: where tracked scans go; WorkerSink is the base of slow ones, MapSink of those with a map."""

import threading
from collections import deque
from typing import Generic, Literal, Protocol, TypedDict, TypeVar, Unpack, runtime_checkable

from curvescan.errors import CurvescanError, OutputError, require
from curvescan.live.live_map import LiveMap
from curvescan.live.tracker import TrackedScan
from curvescan.mapping.config import OccupancyConfig
from curvescan.slam import SlamMap
from curvescan.types import Pose

T = TypeVar("T")


class BoundedQueue(Generic[T]):
    """A queue of `capacity` items between threads: when it is full `put` drops the oldest, or waits if lossless."""

    def __init__(self, capacity: int, *, is_lossless: bool = False) -> None:
        require(capacity >= 1, "capacity must be at least 1", capacity)
        self._items: deque[T] = deque()
        self._capacity, self._is_lossless = capacity, is_lossless
        self._changed = threading.Condition()
        self.is_closed = False  # whether nothing more is taken in
        self.n_dropped = 0  # items that were dropped for want of room

    def put(self, item: T) -> bool:
        """Append an item and return True; False when the queue is closed."""
        with self._changed:
            while self._is_lossless and len(self._items) >= self._capacity and not self.is_closed:
                self._changed.wait()
            if self.is_closed:
                return False
            if len(self._items) >= self._capacity:
                self._items.popleft()
                self.n_dropped += 1
            self._items.append(item)
            self._changed.notify_all()
            return True

    def get(self, timeout: float | None = None) -> T | None:
        """Return the oldest item; None when the queue is closed and empty, or nothing came within `timeout` seconds."""
        with self._changed:
            self._changed.wait_for(lambda: self._items or self.is_closed, timeout)
            if not self._items:
                return None
            item = self._items.popleft()
            self._changed.notify_all()
            return item

    @property
    def is_done(self) -> bool:
        """Whether nothing more will come."""
        with self._changed:
            return self.is_closed and not self._items

    def close(self) -> None:
        """Take in nothing more; what is held can still be had."""
        with self._changed:
            self.is_closed = True
            self._changed.notify_all()


@runtime_checkable
class LiveSink(Protocol):
    """What takes in tracked scans: a page, a file, a middleware."""

    def put(self, tracked: TrackedScan) -> None:
        """Take in a scan; must not wait for anything slow."""

    def close(self) -> None:
        """Finish what was taken in; called once, at the end."""


class WorkerSink:
    """A sink with a thread and a bounded queue of its own; subclasses write :meth:`_take`."""

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
        try:
            while self.error is None and (tracked := self._queue.get()) is not None:
                self._take(tracked)
        except CurvescanError as error:
            self.error = error  # reported at the end; the other sinks and the poses go on
        except OSError as error:
            self.error = OutputError(f"{self._thread.name} ended: {error.strerror or error}")
        finally:
            self._queue.close()  # nobody waits for a sink that ended

    def _take(self, tracked: TrackedScan) -> None:
        """Process one scan, in the sink's thread."""
        raise NotImplementedError

    def _finish(self) -> None:
        """Finish, in the caller's thread, after the last scan."""


class MapOptions(TypedDict, total=False):
    """What sinks that draw a map have in common."""

    mode: Literal["odometry", "SLAM", "localization"]
    occupancy: OccupancyConfig | None  # how the map is made
    saved_map: SlamMap | None  # what is localized in, drawn from the beginning
    is_lossless: bool  # whether the tracker waits, so that no scan is missing


class MapSink(WorkerSink):
    """A sink that draws a map; is_revisable: whether poses of the past may change, None for those of SLAM."""

    def __init__(
        self, name: str, *, is_revisable: bool | None = None, capacity: int = 200, **options: Unpack[MapOptions]
    ) -> None:
        self.mode = options.get("mode", "odometry")
        is_revisable = self.mode == "SLAM" if is_revisable is None else is_revisable
        self._map = LiveMap(options.get("occupancy"), is_revisable=is_revisable)
        if (saved_map := options.get("saved_map")) is not None:
            self._map.begin_with(saved_map.scans, saved_map.poses)
        self._final: Pose | None = None
        super().__init__(name, capacity=capacity, is_lossless=options.get("is_lossless", False))

    def finish_with(self, poses: Pose) -> None:
        """Tell the final poses of all scans, before the sink is closed."""
        self._final = poses

    def _finish(self) -> None:
        if self._final is not None:
            self._map.revise(self._final)
        self._map.redraw()
