"""Whether a log is of a SICK PLS: its slow mirror gives the times of the beams, which FLASER lines lack.

The mirror of a PLS turns 25 times a second, so that half a turn, a sweep, takes 20 ms: a robot that turns by 45 degrees
a second is 0.9 degrees farther at its end. A PLS counts in steps of 5 cm, up to 51.15 m.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from curvescan.types import Floats, Ints

_PLS_TURN = 1.0 / 25.0
"""Time of a turn of the mirror, seconds."""

_PLS_END = 51.2
"""End of the scale of a PLS, metres."""

_EVERY = 8
"""One sweep of so many is looked at."""

_N_READINGS = 1_000
"""So many readings show on which steps they lie."""

_MOST_BY_CHANCE = 0.6
"""Share of the readings on the two commonest of the five centimetres of a step: 0.40 to 0.42 in six logs of an LMS,
which counts centimetres, 0.76 to 0.88 in three of a PLS."""


@dataclass
class PlsSigns:
    """What the readings of a log's sweeps say of their laser."""

    # (5,): readings by their centimetre within a step of a PLS
    by_centimetre: Ints = field(default_factory=lambda: np.zeros(5, dtype=np.int64))
    longest: float = 0.0  # the longest finite reading, metres
    _n_sweeps: int = 0

    def add(self, ranges: Floats) -> None:
        """Take up a sweep, (n,) metres."""
        self._n_sweeps += 1
        if self._n_sweeps % _EVERY != 1:
            return
        read = ranges[(ranges > 0.0) & (ranges < 1e6)]  # not where it is NaN
        if not read.size:
            return
        self.longest = max(self.longest, float(read.max()))
        centimetres = np.rint(100.0 * read).astype(np.int64) % 5
        self.by_centimetre += np.bincount(centimetres, minlength=5)

    @property
    def turn_time(self) -> float:
        """Time of a turn of the mirror, seconds; 0 for a laser of which nothing is known."""
        n = int(self.by_centimetre.sum())
        n_on_step = int(np.sort(self.by_centimetre)[-2:].sum())
        is_pls = n >= _N_READINGS and n_on_step > _MOST_BY_CHANCE * n
        return _PLS_TURN if is_pls and self.longest <= _PLS_END else 0.0
