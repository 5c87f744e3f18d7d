"""Outages: the probability that the sensor is no longer where it was tracked.

It may be carried away at any scan, at a small rate. A scan that surely matches what was known before refutes that, a scan
that does not makes it likelier. The track is lost once it is likelier than not. What was known before is kept, and a
match with it ends the outage, however late.
"""

from __future__ import annotations

import math
from typing import NamedTuple

from curvescan.matchers import PreparedScan
from curvescan.se2.uncertain import UncertainPose

_RATE = 1e-4
"""Probability that a sensor is carried away between two scans."""

_LEAST = math.log(_RATE)

_MOST = 3.0
"""Greatest evidence of one scan, logarithm of odds: one in twenty scans of a place that is known matches nothing."""

_USUAL = 1.4
"""Logarithm of the odds of a match that says nothing on the question: scans that follow each other match surely."""

_N_SEARCHES = 50
"""Scans after a loss that are still matched with what was known before."""


class Anchor(NamedTuple):
    """A scan that was in use before an outage, its number, and its place in the map."""

    scan: PreparedScan
    number: int
    place: UncertainPose


class Outage(NamedTuple):
    """Doubts whether the sensor is where it was tracked.

    Attributes
    ----------
    anchors : tuple of Anchor
        What was in use before.
    first : int
        Number of the scan that raised them.
    log_odds : float
        Logarithm of the odds that the sensor was carried away.
    seconds : float
        Time since the last scan before it.
    n_scans : int
        Scans since.
    is_lost : bool
        Whether the track was lost.
    is_broken : bool
        Whether a scan of it was matched with nothing, so that the poses since hang on the expected motion.
    """

    anchors: tuple[Anchor, ...]
    first: int
    log_odds: float = _LEAST
    seconds: float = 0.0
    n_scans: int = 0
    is_lost: bool = False
    is_broken: bool = False

    @property
    def is_over(self) -> bool:
        """Whether nothing of it remains, or it is no longer worth a search."""
        return self.n_scans > _N_SEARCHES if self.is_lost else self.log_odds <= _LEAST

    def after(self, confidence: float, nearness: float) -> Outage:
        """Return the outage after a scan that matches what was known before with a confidence, 0 where it does not.

        nearness: How well it should see that, in [0, 1]; 0 of a blind scan.
        """
        change = evidence(confidence, is_new=self.n_scans == 0)
        change = min(change, nearness * _MOST)
        if not self.is_broken:
            change *= 0.5  # a match, though a doubtful one, leads over it
        log_odds = max(self.log_odds + change, _LEAST)
        return self._replace(log_odds=log_odds, n_scans=self.n_scans + 1)


def evidence(confidence: float, *, is_new: bool) -> float:
    """Return what a match says for a sensor that was carried away: logarithm of the odds, at most a limit either way.

    Matches of one place err together: a doubtful one raises a doubt, and others like it do not add to it.
    """
    if confidence <= 0.0:
        return _MOST
    odds = math.log(max(1.0 - confidence, 1e-6) / confidence)
    return min(max(odds + _USUAL if is_new else min(odds, 0.0), -_MOST), _MOST)
