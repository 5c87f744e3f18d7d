"""Codes for *no reading* that a log does not declare: a narrow band at the top of the range that is seen all around.

Some drivers report a number just below the sensor's limit where nothing came back, and not always the same one
(51.05 to 51.16 m in one log). As readings they become arcs in the map. A real surface is seen at many distances as the
sensor moves; a code stays where it is and comes from beams all around.
"""

from __future__ import annotations

import numpy as np

from curvescan.scan import LaserScan
from curvescan.types import Floats

_BIN = 0.05  # width of the bins in which readings are counted, metres
_N_BINS = 2048  # readings beyond the last bin, 102 m, are not counted: no common 2D laser reaches farther
_BAND = 0.01  # share of the largest reading that is its band: a code is rounded, not noisy
_BELOW = 0.10  # share of the largest reading down to which the band is compared with what lies below it
_MIN_SHARE = 0.002  # least share of all readings in the band: fewer leave no arcs in a map
_MIN_BEAMS = 0.5
"""Least share of the beams that have been in the band: the far end of a room is seen by fewer, from one place."""
_STRAYS = 0.0005  # share of the largest readings that may lie above the band: single wrong ones


class TopOfRange:
    """Counts readings by distance, and which beams they came from, in memory that does not grow with the log."""

    def __init__(self) -> None:
        self._counts = np.zeros(_N_BINS, dtype=np.int64)
        self._has_beam = np.zeros((_N_BINS, 0), dtype=np.bool_)

    def add(self, scan: LaserScan) -> None:
        """Count the valid readings of one scan."""
        if len(scan) > self._has_beam.shape[1]:
            wider = np.zeros((_N_BINS, len(scan)), dtype=np.bool_)
            wider[:, : self._has_beam.shape[1]] = self._has_beam
            self._has_beam = wider
        beams = np.flatnonzero(scan.valid & (scan.ranges < _BIN * _N_BINS))
        bins = (scan.ranges[beams] / _BIN).astype(np.int64)
        self._counts += np.bincount(bins, minlength=_N_BINS)
        self._has_beam[bins, beams] = True

    def code_band(self) -> tuple[float, float, float] | None:
        """Return the band that looks like codes for no reading; None without."""
        total = int(self._counts.sum())
        if not total:
            return None
        above = np.cumsum(self._counts[::-1])[::-1]
        top = int(np.flatnonzero(above > _STRAYS * total)[-1])
        band = slice(max(int((1.0 - _BAND) * top) - 1, 0), top + 1)
        below = slice(int((1.0 - _BELOW) * top), band.start)
        n_band, n_below = int(self._counts[band].sum()), int(self._counts[below].sum())
        n_beams = self._has_beam.shape[1]
        seen_by = int(np.count_nonzero(self._has_beam[band].any(axis=0)))
        if n_band < _MIN_SHARE * total or n_band <= n_below or seen_by < _MIN_BEAMS * n_beams:
            return None
        filled: Floats = np.flatnonzero(self._counts[band]).astype(np.float64) + band.start
        return float(filled[0]) * _BIN, float(filled[-1] + 1.0) * _BIN, n_band / total
