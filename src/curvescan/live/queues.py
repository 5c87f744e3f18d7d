"""BoundedQueue: what stands between two threads of which one may be slower."""

import threading
from collections import deque
from typing import Generic, TypeVar

from curvescan.errors import require

T = TypeVar("T")


class BoundedQueue(Generic[T]):
    """A queue of `capacity` items between threads: when it is full `put` drops the oldest, or waits if lossless."""

    def __init__(self, capacity: int, *, is_lossless: bool = False) -> None:
        require(capacity >= 1, "capacity must be at least 1", capacity)
        self._items: deque[T] = deque()
        self._capacity, self._is_lossless = capacity, is_lossless
        self._changed = threading.Condition()
        self._is_closed = False
        self._n_dropped = 0

    @property
    def n_dropped(self) -> int:
        """Items that were dropped for want of room."""
        return self._n_dropped

    @property
    def is_closed(self) -> bool:
        """Whether nothing more is taken in."""
        return self._is_closed

    def __len__(self) -> int:
        return len(self._items)

    def put(self, item: T) -> bool:
        """Append an item and return True; False when the queue is closed."""
        with self._changed:
            while self._is_lossless and len(self._items) >= self._capacity and not self._is_closed:
                self._changed.wait()
            if self._is_closed:
                return False
            if len(self._items) >= self._capacity:
                self._items.popleft()
                self._n_dropped += 1
            self._items.append(item)
            self._changed.notify_all()
            return True

    def get(self, timeout: float | None = None) -> T | None:
        """Return the oldest item; None when the queue is closed and empty, or nothing came within `timeout` seconds."""
        with self._changed:
            if not self._changed.wait_for(lambda: self._items or self._is_closed, timeout):
                return None
            if not self._items:
                return None
            item = self._items.popleft()
            self._changed.notify_all()
            return item

    def close(self) -> None:
        """Take in nothing more; what is held can still be had."""
        with self._changed:
            self._is_closed = True
            self._changed.notify_all()
