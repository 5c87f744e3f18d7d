"""ScanSource: where live scans come from; a log that is replayed and a simulated robot are the two without hardware."""

from __future__ import annotations

import itertools
import math
import threading
import time
from collections.abc import Callable, Iterator
from types import TracebackType
from typing import TYPE_CHECKING, Any, Protocol, Self, runtime_checkable

import numpy as np

from curvescan.diagnostics.preparation import StreamMender
from curvescan.errors import require
from curvescan.scan import LaserScan
from curvescan.simulation.buildings.catalogue import build_world
from curvescan.simulation.driving.motion import drive_route
from curvescan.simulation.driving.pursuit import Drive
from curvescan.simulation.sensing.people import NOISE, PATH, PEOPLE, WORLD, People, child, walk
from curvescan.simulation.sensing.sensors import Sensor, choose_sensor

if TYPE_CHECKING:
    from curvescan.io.log import Log
    from curvescan.types import Pose

_LONGEST_PAUSE = 2.0  # a leap of a log's stamps is replayed as a pause of this length at most, seconds


@runtime_checkable
class ScanSource(Protocol):
    """A source of scans: a context that yields them as they come. Leaving it from another thread ends it.

    ``scans()`` waits for the next scan, ends when the source has ended or is closed, and raises
    :class:`curvescan.SourceError` when the sensor is gone.
    """

    @property
    def name(self) -> str:
        """Name for titles and messages."""

    @property
    def is_live(self) -> bool:
        """Whether scans come at their own time, so that what is not taken in time is lost."""

    def __enter__(self) -> Self:
        """Open the source."""

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, traceback: TracebackType | None
    ) -> None:
        """Close the source; may be called from another thread than the one that reads."""

    def scans(self) -> Iterator[LaserScan]:
        """Yield the scans as they come."""


_PAUSED = 0.05  # seconds between two looks whether a pause has ended


class Paced:
    """A source that we make ourselves, by `_made`, at the pace of its stamps; it can be paused and hurried on."""

    is_live = False
    n_scans = 0  # scans of a log; 0 of a source that makes them

    def __init__(self, speed: float) -> None:
        self.speed = speed
        self.is_paused = False
        self.skip_to = 0  # scans before it are taken as fast as it goes
        self._closed = threading.Event()

    @property
    def speed(self) -> float:
        """How many times as fast as the stamps say; 0: as fast as it goes. It may change on the way."""
        return self._speed

    @speed.setter
    def speed(self, speed: float) -> None:
        require(speed >= 0.0, "speed must be >= 0 (0: as fast as it goes)", speed)
        self._speed = speed

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        self._closed.set()

    def first(self) -> LaserScan | None:
        """Return the first scan, without taking it; None of a source that has none."""
        return next(self._made(), None)

    def _made(self) -> Iterator[LaserScan]:
        """Yield the scans, each as soon as it is asked for."""
        raise NotImplementedError

    def scans(self) -> Iterator[LaserScan]:
        """Yield the scans at the pace of their stamps, which may repeat or go back; ends when the source is closed."""
        due, before = time.monotonic(), math.nan
        for k, scan in enumerate(self._made()):
            while self.is_paused and k >= self.skip_to and not self._closed.wait(_PAUSED):
                due = time.monotonic()
            step, before = scan.stamp - before, scan.stamp
            if k < self.skip_to or self._speed == 0.0 or math.isinf(self._speed):
                due = time.monotonic()
            elif step > 0.0:
                due += min(step, _LONGEST_PAUSE) / self._speed
            if self._closed.wait(max(due - time.monotonic(), 0.0)):
                return
            yield scan


class MendedSource:
    """A running laser whose scans a StreamMender mends; tell: called with a sentence for what is, or no longer is."""

    def __init__(self, source: ScanSource, tell: Callable[[str], object]) -> None:
        self._source, self._mender = source, StreamMender(tell)
        self.name, self.is_live = source.name, source.is_live

    def __enter__(self) -> Self:
        self._source.__enter__()
        return self

    def __exit__(self, *error: Any) -> None:
        self._source.__exit__(*error)

    def scans(self) -> Iterator[LaserScan]:
        """Yield the scans as they come, mended."""
        return map(self._mender.add, self._source.scans())


class LogSource(Paced):
    """A log, replayed; speed 1 is the pace of its stamps, 10 ten times as fast, 0 as fast as the scans are taken."""

    def __init__(self, log: Log, *, speed: float = 1.0) -> None:
        super().__init__(speed)
        self.log, self.name, self.n_scans = log, log.name, len(log)

    def _made(self) -> Iterator[LaserScan]:
        return iter(self.log)


class SimulatedSource(Paced):
    """A simulated robot that drives round a building, lap after lap; each scan is made when it is due.

    `world` is the name of one with a route; `n_scans` None: until closed; the others are those of
    :func:`curvescan.simulate` and :class:`LogSource`.
    """

    def __init__(
        self,
        world: str = "office-floor",
        *,
        sensor: Sensor | str = "spinning-360",
        n_scans: int | None = None,
        n_people: int = 0,
        seed: int = 0,
        speed: float = 1.0,
    ) -> None:
        super().__init__(speed)
        require(n_scans is None or n_scans >= 1, "n_scans must be >= 1", n_scans)
        require(n_people >= 0, "n_people must be >= 0", n_people)
        self.sensor = choose_sensor(sensor)
        self.world = build_world(world, child(seed, WORLD))
        self.name = f"simulated {self.world.name} (seed {seed})"
        self._n_scans, self._n_people, self._seed = n_scans, n_people, seed

    def lap(self) -> Pose:
        """Return the (n, 3) true poses of one lap, world frame; the last neighbours the first."""
        rng = np.random.default_rng(child(self._seed, PATH))
        return drive_route(self.world, Drive(), self.sensor.period, rng)

    def _made(self) -> Iterator[LaserScan]:
        from curvescan.simulation.recording import as_scan, observe, sweep_velocities

        lap, period = self.lap(), self.sensor.period
        people = walk(self.world, lap, self._n_people, People(), period, child(self._seed, PEOPLE))
        velocities = sweep_velocities(np.vstack((lap, lap[:1])), self.sensor)
        for k in itertools.count() if self._n_scans is None else range(self._n_scans):
            now = slice(k % len(lap), k % len(lap) + 1)
            seed, moving = child(self._seed, NOISE, k), None if velocities is None else velocities[now]
            ranges, _, _ = observe(self.world, lap[now], self.sensor, people[now], seed, velocities=moving)
            yield as_scan(ranges[0], self.sensor, k * period)
