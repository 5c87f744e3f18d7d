"""Turns of a spinning laser: cut from its points, given a time, made into scans."""

import math
import statistics
import time
from collections import deque
from collections.abc import Sequence

import numpy as np

from curvescan.scan import LaserScan

_LATE = 0.5
"""A turn that ends later than expected by this share of a turn was delivered late, and keeps the time expected."""

_SLEW = 0.1  # share of a smaller delay by which the clock follows
_MAX_LATE = 10  # after so many late turns in a row it is the clock that was wrong: turns were lost


class TurnClock:
    """When each turn of a steadily spinning laser began and ended, from when its bytes came.

    Bytes come when the sensor has sent them or later, never earlier: a turn that comes late, behind others in a buffer,
    ended one period after the turn before it. A delay that stays for ten turns is a gap, and is kept.
    """

    def __init__(self) -> None:
        self._end: float | None = None
        self._periods: deque[float] = deque(maxlen=15)
        self._last_arrival: float | None = None
        self._n_late = 0

    def turn(self, arrival: float | None, rate_hz: float = 0.0) -> tuple[float, float]:
        """Return begin and end of the turn whose last bytes came at `arrival`, seconds; None: turns follow on."""
        if arrival is not None and self._last_arrival is not None and arrival > self._last_arrival:
            self._periods.append(arrival - self._last_arrival)
        self._last_arrival = arrival
        period = self._period(rate_hz)
        if self._end is None:
            end = 0.0 if arrival is None else arrival
            begin = end - period
        else:
            begin = self._end
            end = self._next_end(begin + period, period, arrival)
        self._end = end
        return begin, end

    def _next_end(self, expected: float, period: float, arrival: float | None) -> float:
        if arrival is None:
            return expected
        delay = arrival - expected
        if delay <= 0.0:
            self._n_late = 0
            # it was there: it cannot have ended later; nor did it take no time
            return max(arrival, expected - 0.9 * period)
        if delay < _LATE * period:
            self._n_late = 0
            return expected + _SLEW * delay
        self._n_late += 1
        if self._n_late > _MAX_LATE:
            self._n_late = 0
            return arrival
        return expected

    def _period(self, rate_hz: float) -> float:
        if rate_hz > 0.0 and math.isfinite(rate_hz):
            return 1.0 / rate_hz
        return statistics.median(self._periods) if self._periods else 0.1


def to_unix(monotonic: float) -> float:
    """Return a time by time.monotonic() as seconds since 1970."""
    return monotonic - time.monotonic() + time.time()


def scan_of_turn(
    points: Sequence[tuple[float, float, float]],
    begin: float,
    end: float,
    *,
    is_clockwise: bool,
    limits: tuple[float, float],
    ignore_beams: tuple[int, int] = (0, 0),
) -> LaserScan | None:
    """Return (n, 3) directions, ranges and strengths, radians and metres, as a scan; None without two directions."""
    table = np.array(points, dtype=np.float64).reshape(-1, 3)
    angles, order = np.unique(np.mod(table[:, 0], 2.0 * np.pi), return_index=True)
    n = angles.size
    used = slice(ignore_beams[0], n - ignore_beams[1])
    angles, order = angles[used], order[used]
    if angles.size < 2:
        return None
    return LaserScan(
        table[order, 1],
        angles=-angles if is_clockwise else angles,
        range_min=limits[0],
        range_max=limits[1],
        stamp=begin + ignore_beams[0] / n * (end - begin),
        intensities=table[order, 2],
        time_increment=(end - begin) / n,
        scan_time=end - begin,
    )
