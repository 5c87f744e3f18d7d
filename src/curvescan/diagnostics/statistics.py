"""What a single pass over the scans of a log counts, in memory that does not grow with the readings.

Beams that should change and do not: a bin that was not refilled repeats its value to the last digit while the beams
around it change; noise rounded to a step repeats one only as often as it lands one step beside it. A beam on the
robot's own body keeps its reading within noise while the robot drives past everything else.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np

from curvescan.diagnostics.top_of_range import TopOfRange, runs_of
from curvescan.scan import LaserScan
from curvescan.types import Floats

_CHANGED = 8.0  # median change from sweep to sweep, in steps of the readings, from which on the scene changes
_NEAR = 4  # changes of up to so many steps are counted to estimate how often one of zero is expected
_MIN_CHANGES = 20
_MIN_STEP = 1e-4
_MIN_PAIRS = 10
_FIXED = 0.03  # largest standard deviation of a beam that keeps its reading, metres
_MOVING = 0.2  # standard deviation that half of the other beams exceed, metres: else the sensor stands, as walls do
_MAX_FIXED_SHARE = 0.3
_MIN_SCANS = 100  # in fewer, beams of one drive in ten keep their reading by chance
_FAR = 1e6  # deviations count up to this many metres, so that a reading of 1e300 has a square
_BODY = 1.5  # how far from its laser a robot may reach, metres
_MAX_EMPTY = 16  # neighbouring beams that are never fired: more of them are a blind sector
_MIN_EMPTY_SHARE = 0.1  # of all beams: fewer cost matches nothing
_EDGE = 3  # beams from those that see the robot to those that see past it; between them are some that see both


class FixedBeams(NamedTuple):
    """Runs of beams, first and last, that keep their reading while the sensor moves: they see the robot."""

    runs: tuple[tuple[int, int], ...]
    n_beams: int  # of the scans that have them

    def without(self, scan: LaserScan) -> LaserScan:
        """Return a scan in which they are no readings."""
        if len(scan) != self.n_beams:
            return scan
        ranges = scan.ranges.copy()
        for first, last in self.runs:
            ranges[first : last + 1] = np.nan
        return replace(scan, ranges=ranges)


class EmptyBeams(NamedTuple):
    """Runs of beams, first and last, that never read while those beside them do: the laser does not fire them."""

    runs: tuple[tuple[int, int], ...]
    n_beams: int  # of the scans that have them

    @property
    def share(self) -> float:
        """Part of the beams, 0 to 1."""
        return sum(last + 1 - first for first, last in self.runs) / max(self.n_beams, 1)

    def without(self, scan: LaserScan) -> LaserScan:
        """Return a scan of the other beams."""
        if len(scan) != self.n_beams:
            return scan
        kept = np.ones(self.n_beams, dtype=np.bool_)
        for first, last in self.runs:
            kept[first : last + 1] = False
        directions: dict[str, Any] = {"angle_min": None, "angle_increment": None, "angles": scan.angles[kept]}
        return replace(
            scan,
            **directions,
            ranges=scan.ranges[kept],
            intensities=None if scan.intensities is None else scan.intensities[kept],
            # the first and the last beam stay, and so does the time between them
            time_increment=scan.time_increment * (self.n_beams - 1) / (np.count_nonzero(kept) - 1),
        )


@dataclass
class BeamStatistics:
    """Counters over consecutive sweeps, and sums a beam; memory follows the number of beams."""

    n_pairs: int = 0  # pairs of consecutive sweeps between which the scene changed
    # readings of these pairs that are valid in both: all, those that are equal, and those that are not but lie within
    # four steps
    n_compared: int = 0
    n_equal: int = 0
    n_near: int = 0
    n_equal_neighbours: int = 0  # readings that are equal, and so are those of the next beam
    _previous: Floats | None = None
    _n_scans: int = 0
    _base: Floats = field(default_factory=lambda: np.empty(0))
    _counts: Floats = field(default_factory=lambda: np.empty(0))
    _sums: Floats = field(default_factory=lambda: np.empty(0))
    _squares: Floats = field(default_factory=lambda: np.empty(0))

    @property
    def stale_share(self) -> float:
        """Share of readings that repeat the sweep before beyond noise, 0 to 1; NaN where too few sweeps tell."""
        if self.n_pairs < _MIN_PAIRS:
            return np.nan
        expected = self.n_near / (2 * _NEAR)
        return max(self.n_equal - expected, 0.0) / self.n_compared

    @property
    def stale_run(self) -> float:
        """Share of the readings that repeat the sweep before beside another that does; NaN without any."""
        return self.n_equal_neighbours / self.n_equal if self.n_equal else np.nan

    @property
    def n_blind(self) -> int:
        """Beams of the first arrangement that never gave a valid reading."""
        return int(np.count_nonzero(self._counts == 0.0))

    @property
    def empty_beams(self) -> EmptyBeams | None:
        """Beams that never read, few side by side and many in all, between beams that do; None without any."""
        n, never = self._counts.size, self._counts == 0.0
        runs = [(a, b) for a, b in (runs_of(never) - [0, 1]).tolist() if a > 0 and b < n - 1 and b - a < _MAX_EMPTY]
        found = EmptyBeams(tuple(runs), n)
        return found if self._n_scans >= _MIN_SCANS and found.share >= _MIN_EMPTY_SHARE else None

    @property
    def fixed_beams(self) -> FixedBeams | None:
        """Beams that keep their reading beside a room that begins at once, while the sensor moves; None without any."""
        if self._n_scans < _MIN_SCANS:
            return None
        well_seen = 2 * self._counts > self._n_scans
        counts = np.maximum(self._counts, 1.0)
        means = self._sums / counts
        deviations = np.sqrt(np.maximum(self._squares / counts - means**2, 0.0))
        is_near = np.nan_to_num(self._base + means, nan=np.inf) < _BODY
        fixed = well_seen & is_near & (deviations < _FIXED)
        others = deviations[well_seen & ~fixed]
        if np.count_nonzero(fixed) > _MAX_FIXED_SHARE * np.count_nonzero(well_seen):
            return None
        if not others.size or np.median(others) < _MOVING:
            return None
        beside = np.pad(well_seen & ~fixed & (deviations < _MOVING), _EDGE)  # where walls stand
        runs = tuple((a, b) for a, b in (runs_of(fixed) - [0, 1]).tolist() if not (beside[a] or beside[b + 2 * _EDGE]))
        return FixedBeams(runs, fixed.size) if runs else None

    def add(self, scan: LaserScan) -> None:
        """Count one sweep."""
        ranges = np.where(scan.valid, scan.ranges, np.nan)
        previous, self._previous = self._previous, ranges
        if not self._n_scans:
            self._base = np.full(len(scan), np.nan)
            self._counts, self._sums, self._squares = np.zeros((3, len(scan)))
        if len(scan) == self._counts.size:
            self._n_scans += 1
            # deviations from the first reading, not readings: their squares keep their digits
            np.copyto(self._base, ranges, where=np.isnan(self._base))
            deviation = np.where(scan.valid, ranges - self._base, 0.0).clip(-_FAR, _FAR)
            self._counts += scan.valid
            self._sums += deviation
            self._squares += deviation**2
        if previous is not None and previous.size == ranges.size:
            self._add_pair(np.abs(ranges - previous))

    def _add_pair(self, changes: Floats) -> None:
        is_equal = changes == 0.0
        n_neighbours = int(np.count_nonzero(is_equal[1:] & is_equal[:-1]))
        changes = np.sort(changes[np.isfinite(changes)])
        changed = changes[np.searchsorted(changes, 0.0, "right") :]
        if changed.size < _MIN_CHANGES:
            return
        step = max(float(changed[0]), _MIN_STEP)
        if not changes[(changes.size - 1) // 2] + changes[changes.size // 2] > 2.0 * _CHANGED * step:  # the median
            return
        self.n_equal_neighbours += n_neighbours
        self.n_pairs += 1
        self.n_compared += changes.size
        self.n_equal += changes.size - changed.size
        self.n_near += int(np.searchsorted(changed, (_NEAR + 0.5) * step))


Layout = tuple[int, float, float, bool]  # number of beams, angle_min, mean step, whether the sweep is a full circle

_MAX_CODES = 1024
_MAX_LAYOUTS = 256
_N_TOP = 16
_N_SAMPLE = 200


@dataclass
class LogStatistics:
    """Counters over the scans seen so far; fresh readings are those of scans that do not repeat the one before."""

    stamps: array[float] = field(default_factory=lambda: array("d"))  # seconds, one a scan
    n_timed: int = 0  # scans that give the time from one beam to the next
    sweep_seconds: float = 0.0  # longest time from the first to the last beam, by these times; 0 without
    beams: BeamStatistics = field(default_factory=BeamStatistics)
    layouts: Counter[Layout] = field(default_factory=Counter)  # scans by arrangement of the beams
    range_min: float = math.inf
    range_max: float = 0.0  # of a valid reading, metres: the smallest lower and the largest upper limit
    n_readings: int = 0
    n_valid: int = 0
    n_fresh_readings: int = 0
    n_blank: int = 0  # scans without a valid reading
    n_repeats: int = 0  # scans whose readings are those of the scan before
    codes: Counter[float] = field(default_factory=Counter)  # values that are no reading: the first thousand of them
    top: dict[float, int] = field(default_factory=dict)  # exact counts of the 16 largest valid values, fresh
    top_of_range: TopOfRange = field(default_factory=TopOfRange)  # the fresh readings by distance
    sample: list[LaserScan] = field(default_factory=list)  # fresh scans, evenly spaced, and at most 200
    _spacing: int = 1
    _n_fresh: int = 0
    _previous: Floats | None = None

    def add(self, scan: LaserScan) -> None:
        """Count one scan."""
        self.stamps.append(scan.stamp)
        self.n_timed += scan.time_increment > 0.0
        self.sweep_seconds = max(self.sweep_seconds, scan.time_increment * (len(scan) - 1))
        layout = (len(scan), scan.angle_min, scan.mean_increment, scan.is_full_circle)
        if layout in self.layouts or len(self.layouts) < _MAX_LAYOUTS:
            self.layouts[layout] += 1
        self.range_min = min(self.range_min, scan.range_min)
        self.range_max = max(self.range_max, scan.range_max)
        valid = scan.valid
        n_valid = int(np.count_nonzero(valid))
        self.n_readings += len(scan)
        self.n_valid += n_valid
        self.n_blank += n_valid == 0
        if n_valid < len(scan):
            self._add_codes(scan.ranges[~valid])
        previous, self._previous = self._previous, scan.ranges
        if previous is not None and len(scan) and np.array_equal(previous, scan.ranges, equal_nan=True):
            self.n_repeats += n_valid > 0
            return  # what it says of the top of the range, and of single beams, has been said
        if self._n_fresh % self._spacing == 0:
            self.sample.append(scan)
            if len(self.sample) > _N_SAMPLE:
                self.sample, self._spacing = self.sample[::2], 2 * self._spacing
        self._n_fresh += 1
        self.beams.add(scan)
        self.n_fresh_readings += len(scan)
        if n_valid:
            self._add_top(scan.ranges[valid])
            self.top_of_range.add(scan)

    def _add_codes(self, values: Floats) -> None:
        for value, count in zip(*(part.tolist() for part in np.unique(values, return_counts=True)), strict=True):
            # NaN equals nothing, but a dict finds it again when it is the same object
            key = math.nan if value != value else value + 0.0  # -0.0 is 0.0
            if key in self.codes or len(self.codes) < _MAX_CODES:
                self.codes[key] += count

    def _add_top(self, values: Floats) -> None:
        # a value that 16 larger ones have pushed out can never return, so the counts stay exact
        if len(self.top) == _N_TOP:
            values = values[values >= min(self.top)]
        for value in values.tolist():
            self.top[value] = self.top.get(value, 0) + 1
        if len(self.top) > _N_TOP:
            self.top = {value: self.top[value] for value in sorted(self.top)[-_N_TOP:]}
