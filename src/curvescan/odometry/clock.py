"""The time from a scan to the next, from stamps that may jitter, stand still, go back or leap."""

from __future__ import annotations

import math
from typing import NamedTuple

_MAX_PERIODS = 20.0
"""A pause longer than this many scans counts as this many."""

_NOMINAL = 0.1
"""Seconds between two scans whose stamps do not tell."""

_N_UNUSUAL = 10
"""So many steps of the clock are averaged before one is called long: logs written in bursts begin with any step."""


class Clock(NamedTuple):
    """The stamps of a stream: the last one, the usual time between two, seconds, and how many steps it was taken from."""

    stamp: float = math.nan
    period: float = 0.0
    n_steps: int = 0

    def ticked(self, stamp: float) -> tuple[Clock, float]:
        """Return the clock after the next stamp, and the seconds that took, a whole number of rounded periods.

        Both are rounded so that stamps that jitter change nothing at all.
        """
        elapsed = stamp - self.stamp
        if not elapsed > 0.0:  # the first one, a clock that stands or goes back
            return self._replace(stamp=stamp), _seconds(1.0, self.period)
        n_steps, usual = self.n_steps + 1, self.period
        if n_steps <= _N_UNUSUAL:
            period = usual + (elapsed - usual) / n_steps
            return Clock(stamp, period, n_steps), _seconds(1.0, period)
        period = usual + (min(elapsed, 3.0 * usual) - usual) / _N_UNUSUAL**2
        n_periods = min(max(round(elapsed / usual), 1.0), _MAX_PERIODS)
        return Clock(stamp, period, n_steps), _seconds(n_periods, usual)


def _seconds(n_periods: float, period: float) -> float:
    return n_periods * (float(f"{period:.1g}") or _NOMINAL)
