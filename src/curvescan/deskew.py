"""Deskew: change a sweep that was taken on the move into what the sensor sees from the middle of the sweep.

Each reading is moved to where the sensor would see it from there, by half a sweep at most, so that an error of the
velocity mostly cancels in a match. The beams keep their order and their number. A reading that comes to lie behind a
nearer one is dropped: it could not be seen from there. The velocity is that of a motion between two scans, by the
clock of their stream.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from itertools import pairwise
from statistics import median
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from curvescan import se2
from curvescan._jit import kernel
from curvescan.scan import LaserScan
from curvescan.types import Bools, Floats, Pose, three_numbers

_FASTEST = 0.5
"""Turn of the sensor from a beam to the next, in angles between beams, from which on it is no velocity of a robot."""

WORTH_AGAIN = 0.005
"""Shift of the readings, metres, by :func:`sweep_shift`, from which on a sweep is worth deskewing and matching again
with the velocity that the first match found: a third of a common laser's noise, and three times what the noise of the
velocity itself makes when it does not change."""

_MOST_MOVED = 0.5
"""A reading that a sweep's motion moves by more than this share of its range is dropped: where it lies is not known."""

_N_STAMPS = 12

_HYSTERESIS = 0.02  # the period is taken anew when it changes by a larger share: stamps that jitter change nothing

_LONGEST = 1e15  # seconds: 30 million years, which can be counted in periods
_DIGITS = 3
"""Significant digits of the period: what is less than the hysteresis must not enter when it is taken anew either."""

_FASTEST_SENSOR = 1_000.0  # no sensor moves so fast, metres a second

_REGULAR = 0.5, 1.5
"""Steps of the clock from one scan to the next, in usual steps: what jitters, and no scan was lost on the way."""

_MOST_PERIODS = 3  # a step of more periods than this is a pause: how long the motion took is not known
_TICK = 1e-9  # seconds: a clock that goes by less stands still
_LEAP = 100  # a step of more periods than this is a leap of the clock


def as_twist(velocity: ArrayLike) -> Floats:
    """Return a velocity vx, vy, omega, (3,). Raises InvalidArgumentError."""
    return three_numbers(velocity, "velocity must be three finite numbers vx, vy, omega (m/s, m/s, rad/s)")


def deskew(scan: LaserScan, velocity: ArrayLike) -> LaserScan:
    """Return a scan as seen from one place, at the middle of its sweep; velocity (3,). Raises InvalidArgumentError."""
    twist = as_twist(velocity)
    n, step = len(scan), abs(scan.angle_increment)
    if n < 2 or scan.time_increment == 0.0:
        return scan
    least = step if scan.has_uniform_angles else float(np.min(np.abs(np.diff(scan.angles))))
    if abs(twist[2]) * scan.time_increment >= _FASTEST * least:
        return scan
    turned, bearings, ranges = _from_the_middle(scan.angles, scan.ranges, scan.valid, scan.time_increment, twist)
    way = 1.0 if scan.angle_increment > 0.0 else -1.0
    seen = _seen(way * bearings, ranges, np.isfinite(bearings), 1e-3 * step)
    angles = way * _between_seen(way * bearings, way * turned, seen)
    angles, is_again = _once_around(angles, step)
    given: dict[str, Any] = {"angle_min": None, "angle_increment": None, "angles": angles}
    return replace(
        scan,
        ranges=np.where(seen & ~is_again, ranges, np.where(scan.valid, np.nan, scan.ranges)),
        stamp=scan.stamp + middle_of_sweep(scan),
        time_increment=0.0,
        **given,
    )


def middle_of_sweep(scan: LaserScan) -> float:
    """Return the time from the first beam of a scan to the middle of its sweep, seconds; 0 where it is not known."""
    return 0.5 * scan.time_increment * max(len(scan) - 1, 0)


def sweep_shift(scan: LaserScan, velocity: ArrayLike) -> float:
    """Return how far a velocity (3,), or an error of one, moves the readings at the ends of a sweep, metres."""
    vx, vy, omega = (float(value) for value in np.asarray(velocity, dtype=np.float64))
    far = float(median(np.sort(scan.ranges[scan.valid]).tolist() or [0.0]))  # np.median takes three times as long
    return middle_of_sweep(scan) * (math.hypot(vx, vy) + abs(omega) * far)


class Deskewer(NamedTuple):
    """The clock of a stream of scans, and the velocity that a motion between two of them means; a new one each scan."""

    stamps: tuple[float, ...] = ()  # the last few stamps, seconds
    period: float = 0.0  # usual time between two scans, seconds; 0 where stamps do not tell
    elapsed: float = 0.0  # time from the scan before to the last one by their stamps, seconds
    seconds: float = 0.0  # the same as a whole number of periods, 0 of a pause
    n_steps: int = 1  # how many periods it took, 1 at the least; logs written in bursts begin with any step

    def ticked(self, stamp: float, scan_time: float = 0.0) -> Deskewer:
        """Return the deskewer at the time of the next scan."""
        stamps = (*self.stamps, stamp)[-_N_STAMPS:]
        elapsed = min(max(stamp - self.stamps[-1], -_LONGEST), _LONGEST) if self.stamps else 0.0
        period = usual_period(stamps, scan_time)
        if abs(period - self.period) <= _HYSTERESIS * self.period:
            period = self.period
        else:
            period = float(f"{period:.{_DIGITS}g}")
        n = n_periods(stamps, period) if period > 0.0 else 0
        n_steps = max(round(elapsed / period), 1) if len(stamps) == _N_STAMPS and period > 0.0 else 1
        return Deskewer(stamps=stamps, period=period, elapsed=elapsed, seconds=n * period, n_steps=n_steps)

    def velocity(self, motion: Pose) -> Floats:
        """Return the velocity, [vx, vy, omega], of a sensor that made a motion since the last scan."""
        return predicted_velocity(motion, self.seconds)

    def deskewed(self, scan: LaserScan, motion: Pose) -> LaserScan:
        """Return the scan, deskewed as if the sensor made a motion since the last."""
        return deskew(scan, self.velocity(motion)) if scan.time_increment != 0.0 else scan

    def is_worth_again(self, scan: LaserScan, expected: Pose, found: Pose) -> bool:
        """Return whether a motion that was found puts readings elsewhere than the expected one did."""
        error = self.velocity(se2.between(expected, found))
        return sweep_shift(scan, error) > WORTH_AGAIN


def deskewed_along(scans: Iterable[LaserScan], poses: Pose) -> Iterator[LaserScan]:
    """Yield scans deskewed with the motion of a trajectory, poses (n, 3), for maps."""
    deskewer, before = Deskewer(), None
    for scan, pose in zip(scans, poses, strict=False):
        deskewer = deskewer.ticked(scan.stamp, scan.scan_time)
        yield deskewer.deskewed(scan, np.zeros(3) if before is None else se2.between(before, pose))
        before = pose


def predicted_velocity(motion: ArrayLike, seconds: float) -> Floats:
    """Return the velocity (3,) of a sensor whose motion (3,) goes on."""
    if not seconds > 0.0:
        return np.zeros(3)
    with np.errstate(over="ignore", invalid="ignore"):
        velocity: Floats = se2.log(motion) / seconds
    is_possible = math.hypot(velocity[0], velocity[1]) <= _FASTEST_SENSOR
    return velocity if is_possible else np.zeros(3)


def usual_period(stamps: Sequence[float], scan_time: float = 0.0) -> float:
    """Return the time between two scans of a clock that may stand still, go back, leap or jitter."""
    forward = [after - before for before, after in pairwise(stamps) if _TICK < after - before < math.inf]
    usual = scan_time if scan_time > _TICK or not forward else median(forward)
    regular = [step for step in forward if _REGULAR[0] * usual <= step <= _REGULAR[1] * usual]
    return sum(regular) / len(regular) if regular else usual


def n_periods(stamps: Sequence[float], period: float) -> int:
    """Return the whole number of periods of a clock's last step: more where scans were lost, 0 about a pause."""
    steps = [after - before for before, after in pairwise(stamps[-3:])]
    if any(_MOST_PERIODS + 0.5 < step / period <= _LEAP for step in steps):
        return 0
    is_step = bool(steps) and 0.0 < steps[-1] <= _LEAP * period
    return max(round(steps[-1] / period), 1) if is_step else 1


@kernel
def _from_the_middle(
    angles: Floats, ranges: Floats, valid: Bools, time_increment: float, twist: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return where the beams point to, and bearing and range of the readings, from the middle of the sweep.

    `turned`, (n,), are the beams' directions: where far readings come to lie, and beams without a reading. The path
    is that of :func:`curvescan.se2.exp`. Bearings are not wrapped, and NaN without a reading, as the ranges are.
    """
    n = angles.size
    turned, bearings, distances = np.empty(n), np.full(n, np.nan), np.full(n, np.nan)
    for i in range(n):
        time = (i - 0.5 * (n - 1)) * time_increment
        turn = twist[2] * time
        turned[i] = angles[i] + turn
        if not valid[i]:
            continue
        half = 0.5 * turn
        # sin(half) / half, to rounding
        chord = math.sin(half) / half if abs(half) > 1e-4 else 1.0 - half * half / 6.0
        along, across = chord * math.cos(half) * time, chord * math.sin(half) * time
        x = along * twist[0] - across * twist[1]
        y = across * twist[0] + along * twist[1]
        if math.hypot(x, y) > _MOST_MOVED * ranges[i]:
            continue
        c, s = math.cos(turned[i]), math.sin(turned[i])
        ahead, aside = ranges[i] + c * x + s * y, c * y - s * x
        bearings[i] = turned[i] + math.atan2(aside, ahead)
        distances[i] = math.sqrt(ahead * ahead + aside * aside)
    return turned, bearings, distances


@kernel
def _seen(bearings: Floats, ranges: Floats, valid: Bools, least: float) -> Bools:
    """Return (n,) which readings stay in sight: of two whose bearings are out of order the farther is dropped."""
    n = bearings.size
    stack = np.empty(n, dtype=np.int64)
    top = 0
    for i in range(n):
        if not valid[i]:
            continue
        left, is_hidden = top, False
        while left > 0 and not is_hidden and bearings[i] - bearings[stack[left - 1]] < least:
            is_hidden = ranges[stack[left - 1]] <= ranges[i]
            left -= 1
        if not is_hidden:
            stack[left] = i
            top = left + 1
    seen = np.zeros(n, dtype=np.bool_)
    for k in range(top):
        seen[stack[k]] = True
    return seen


def _between_seen(bearings: Floats, turned: Floats, seen: Bools) -> Floats:
    """Return (n,) rising angles: the bearings where seen, between them evenly spread, beyond them as turned."""
    at = np.flatnonzero(seen)
    if not at.size:
        return turned
    beams = np.arange(turned.size)
    angles: Floats = np.interp(beams, at, bearings[at])
    first, last = at[0], at[-1]
    angles[:first] = bearings[first] + turned[:first] - turned[first]
    angles[last + 1 :] = bearings[last] + turned[last + 1 :] - turned[last]
    return angles


def _once_around(angles: Floats, step: float) -> tuple[Floats, Bools]:
    """Return angles of a sweep that goes round no more than once and a step, and the beams that went farther."""
    way = 1.0 if angles[-1] > angles[0] else -1.0
    around = way * (angles - angles[0])
    is_again = around > 2.0 * math.pi + 0.5 * step
    n_again = int(np.count_nonzero(is_again))
    if n_again:
        first = angles.size - n_again
        end = 2.0 * math.pi + step
        around = around.copy()
        around[first:] = np.linspace(around[first - 1], end, n_again + 1)[1:]
    return angles[0] + way * around, is_again
