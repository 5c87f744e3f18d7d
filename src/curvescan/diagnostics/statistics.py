"""What a single pass over the scans of a log counts, in memory that does not grow with the readings.

Stamps are kept, 8 bytes a scan; everything else is a handful of counters.
"""

from __future__ import annotations

import math
from array import array
from collections import Counter
from dataclasses import dataclass, field

import numpy as np

from curvescan.diagnostics.beam_statistics import BeamStatistics
from curvescan.diagnostics.top_of_range import TopOfRange
from curvescan.scan import LaserScan
from curvescan.types import Floats

Layout = tuple[int, float, float, bool]  # number of beams, angle_min, mean step, whether the sweep is a full circle

_MAX_CODES = 1024
_MAX_LAYOUTS = 256
_N_TOP = 16


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
    _previous: Floats | None = None

    @property
    def largest_reading(self) -> float:
        """Largest valid reading, metres; NaN without."""
        return max(self.top, default=math.nan)

    def add(self, scan: LaserScan) -> None:
        """Count one scan."""
        self.stamps.append(scan.stamp)
        self.n_timed += scan.time_increment > 0.0
        self.sweep_seconds = max(self.sweep_seconds, scan.time_increment * (len(scan) - 1))
        self._add_layout(scan)
        self.range_min = min(self.range_min, scan.range_min)
        self.range_max = max(self.range_max, scan.range_max)
        valid = scan.valid
        n_valid = int(np.count_nonzero(valid))
        self.n_readings += len(scan)
        self.n_valid += n_valid
        self.n_blank += n_valid == 0
        if n_valid < len(scan):
            self._add_codes(scan.ranges[~valid])
        if self._repeats_previous(scan.ranges):
            self.n_repeats += 1
            return  # what it says of the top of the range, and of single beams, has been said
        self.beams.add(scan)
        self.n_fresh_readings += len(scan)
        if n_valid:
            self._add_top(scan.ranges[valid])
            self.top_of_range.add(scan)

    def _repeats_previous(self, ranges: Floats) -> bool:
        previous, self._previous = self._previous, ranges
        if previous is None or not ranges.size:
            return False
        return bool(np.array_equal(previous, ranges, equal_nan=True))

    def _add_layout(self, scan: LaserScan) -> None:
        layout = (len(scan), scan.angle_min, scan.mean_increment, scan.is_full_circle)
        if layout in self.layouts or len(self.layouts) < _MAX_LAYOUTS:
            self.layouts[layout] += 1

    def _add_codes(self, values: Floats) -> None:
        for value, count in zip(*_counted(values), strict=True):
            # NaN equals nothing, but a dict finds it again when it is the same object
            key = math.nan if value != value else value + 0.0  # -0.0 is 0.0
            if key in self.codes or len(self.codes) < _MAX_CODES:
                self.codes[key] += count

    def _add_top(self, values: Floats) -> None:
        # a value that 16 larger ones have pushed out can never return, so the counts stay exact
        if len(self.top) == _N_TOP:
            values = values[values >= min(self.top)]
        if not values.size:
            return
        for value, count in zip(*_counted(values), strict=True):
            self.top[value] = self.top.get(value, 0) + count
        if len(self.top) > _N_TOP:
            self.top = {value: self.top[value] for value in sorted(self.top)[-_N_TOP:]}


def _counted(values: Floats) -> tuple[list[float], list[int]]:
    different, counts = np.unique(values, return_counts=True)
    return different.tolist(), counts.tolist()
