"""Turns of the scans against those of wheels or a gyroscope: whether they go the same way, and how late they come.

A sensor that turns to the left sees every wall further right: the profile of ranges over beams shifts. The shift that
makes two profiles agree best is the turn between them; of sharp turns its sign is used. Where it is the other one, the
beams run the other way than the log says. The lag of a clock of its own is where moved headings agree best.
"""

import math
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal, TypeAlias

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from curvescan import se2
from curvescan.io.log import Log, ScanAccess
from curvescan.scan import LaserScan
from curvescan.types import Floats

Reference: TypeAlias = Literal["wheel odometry", "gyroscope"]

_N_PAIRS = 300
_MAX_TURN = math.radians(40.0)
_MIN_OVERLAP = 0.2
_TRUNCATED = 0.5  # differences of range count up to this many metres: what lies beyond is another surface
_MAX_CELLS = 1 << 18  # that are compared at once
_CLEARER = 0.8  # a shift counts where its cost is less than this share of that of the same shift the other way
_DEGREES = (30.0, 90.0)  # a gyroscope that turns so many times as far as the scans gives degrees
_MIN_TURNS = 10
_MIN_SHARE = 0.8
_CERTAIN_SHARE = 0.9


@dataclass(frozen=True, kw_only=True)
class RotationDirection:
    """How the turns of the scans compare with those of the robot."""

    reference: Reference  # source of the robot's turns: ``"wheel odometry"`` or ``"gyroscope"``
    n_turns: int  # turns between two scans that both sources measured, of the sharpest of the log
    n_reversed: int  # those in which scans and reference turn opposite ways
    ratio: float  # median of the reference's turn over the scans', without sign: 1, or 57.3 for a gyroscope in degrees

    @property
    def is_reversed(self) -> bool:
        """Whether scans and reference clearly turn opposite ways."""
        return self.n_turns >= _MIN_TURNS and self.n_reversed >= _MIN_SHARE * self.n_turns

    @property
    def is_certainly_reversed(self) -> bool:
        """Whether they turn opposite ways in all but a few turns: no mistake in single turns explains that."""
        return self.is_reversed and self.n_reversed >= _CERTAIN_SHARE * self.n_turns

    @property
    def is_along(self) -> bool:
        """Whether they clearly turn the same way."""
        return self.n_turns >= _MIN_TURNS and self.n_turns - self.n_reversed >= _MIN_SHARE * self.n_turns

    @property
    def is_in_degrees(self) -> bool:
        """Whether the reference is a gyroscope that gives degrees where REP-103 requires radians."""
        is_fully_observed = self.is_reversed or self.is_along
        return self.reference == "gyroscope" and is_fully_observed and _DEGREES[0] < self.ratio < _DEGREES[1]


def rotation_of_log(log: Log) -> RotationDirection | None:
    """Return how a log's scans, read once more, turn against its wheels, or else its gyroscope; None without either."""
    if (odometry := log.odometry) is not None:
        return compare_rotation(log, odometry.poses[:, 2], "wheel odometry")
    if isinstance(log, ScanAccess) and (turned := log.turned_by_gyro()) is not None:
        return compare_rotation(log, turned, "gyroscope")
    return None


def compare_rotation(scans: Iterable[LaserScan], headings: Floats, reference: Reference) -> RotationDirection | None:
    """Return how scans turn against (n,) headings, by the sharpest turns; None where the reference never turns."""
    turns = np.diff(headings)
    if reference == "wheel odometry":
        turns = se2.wrap(turns)
    sharpness = np.where(np.isfinite(turns), np.abs(turns), 0.0)
    sharpest = {int(k) for k in np.argsort(-sharpness)[:_N_PAIRS] if sharpness[k] > 0.0}
    if not sharpest:
        return None
    seen = ((k, turn_between(*pair)) for k, pair in enumerate(pairwise(scans)) if k in sharpest)
    ratios = [turns[k] / turn for k, turn in seen if turn != 0.0]
    return RotationDirection(
        reference=reference,
        n_turns=len(ratios),
        n_reversed=sum(bool(ratio < 0.0) for ratio in ratios),
        ratio=float(np.median(np.abs(ratios))) if ratios else math.nan,
    )


def turn_between(earlier: LaserScan, later: LaserScan) -> float:
    """Return the angle by which a sensor turned between two scans, radians; 0 where they do not show it clearly."""
    step, n = earlier.angle_increment, len(earlier)
    if len(later) != n or later.angle_increment != step or not earlier.has_uniform_angles:
        return 0.0
    first = np.where(earlier.valid, earlier.ranges, np.nan)
    second = np.where(later.valid, later.ranges, np.nan)
    n_shifts = min(int(_MAX_TURN / abs(step)), n // 3)
    around = first[-n_shifts:], first[:n_shifts]
    beyond = around if earlier.is_full_circle and n_shifts else (np.full(n_shifts, np.nan),) * 2
    # row k: the earlier profile, shifted by k - n_shifts beams
    shifted = sliding_window_view(np.concatenate((beyond[0], first, beyond[1])), n)
    costs = np.concatenate([_costs(some, second) for some in np.array_split(shifted, 1 + shifted.size // _MAX_CELLS)])
    best = int(np.argmin(costs))
    if not costs[best] < _CLEARER * costs[2 * n_shifts - best]:
        return 0.0
    return (best - n_shifts) * step


def _costs(shifted: Floats, profile: Floats) -> Floats:
    """Return the mean difference of each of some profiles from one, infinite where they overlap little."""
    change = np.minimum(np.abs(shifted - profile), _TRUNCATED)
    seen = np.isfinite(change)
    n_seen = np.count_nonzero(seen, axis=1)
    total = np.where(seen, change, 0.0).sum(axis=1)
    return np.where(n_seen > _MIN_OVERLAP * profile.size, total / np.maximum(n_seen, 1), np.inf)


_N_WINDOWS = 12
_WINDOW = 15  # steps on either side of a sharp turn that are compared
_LAGS = np.arange(-10, 31) * 0.05  # lags that are tried, seconds: an odometry is late more often than early
_LEAST_LAG = 0.1
_BETTER = 0.6  # a lag is found where it leaves less than this share of the differences
_MIN_STEPS = 30


def odometry_lag(scans: Iterable[LaserScan], headings: Floats) -> float:
    """Return by how many seconds the (n,) headings of a log, radians or NaN, are late; 0 if no delay is found."""
    turns = se2.wrap(np.diff(headings))
    sharpness = np.where(np.isfinite(turns), np.abs(turns), 0.0)
    wanted = _windows(sharpness)
    stamps: list[float] = []
    seen: dict[int, float] = {}
    for k, (earlier, later) in enumerate(pairwise(scans)):
        stamps += [later.stamp] if stamps else [earlier.stamp, later.stamp]
        if k in wanted:
            seen[k] = turn_between(earlier, later)
    times = np.array(stamps)
    known = np.isfinite(headings[: times.size])
    if len(seen) < _MIN_STEPS or not known.all() or not (np.diff(times) > 0.0).all():
        return 0.0
    row, by_scans = np.array(list(seen)), np.array(list(seen.values()))
    whole = np.unwrap(headings[: times.size])

    def difference(lag: float) -> float:
        moved = np.interp(times + lag, times, whole)
        return float(np.mean(np.abs(moved[row + 1] - moved[row] - by_scans)))

    lag = min(_LAGS.tolist(), key=difference)
    is_clear = difference(lag) < _BETTER * difference(0.0) and abs(lag) >= _LEAST_LAG
    return lag if is_clear else 0.0


def without_lag(stamps: Floats, poses: Floats, lag: float) -> Floats:
    """Return poses as they would be without their lag. stamps (n,); poses (n, 3)."""
    columns = (poses[:, 0], poses[:, 1], np.unwrap(poses[:, 2]))
    moved = np.column_stack([np.interp(stamps + lag, stamps, column) for column in columns])
    moved[:, 2] = se2.wrap(moved[:, 2])
    return moved


def _windows(sharpness: Floats) -> set[int]:
    """Return the steps around the sharpest turns."""
    left, wanted = sharpness.copy(), set[int]()
    for _ in range(_N_WINDOWS):
        if not left.max(initial=0.0) > math.radians(2.0):
            break
        k = int(np.argmax(left))
        low, high = max(k - _WINDOW, 0), min(k + _WINDOW + 1, left.size)
        wanted.update(range(low, high))
        left[low:high] = 0.0
    return wanted
