"""What sure matches say of a gyroscope: its bias, and whether its turn straightens sweeps without beam times.

A rotating laser whose log gives no beam times sweeps from one stamp to the next. On the turn such sweeps are bent and
match badly; undone by the gyroscope's turn over the interval before the stamp they match the better the more of the
bend it explains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from curvescan.deskew import deskew
from curvescan.diagnostics.motion_prior import sure_motion
from curvescan.io.log import Log
from curvescan.matchers import match
from curvescan.scan import LaserScan
from curvescan.se2 import wrap
from curvescan.types import Floats

_N_STEPS, _N_TURNS = 150, 60  # steps that the bias is found from, and turns in which sweeps are straightened, at most

_MIN_STEPS, _MIN_TURNS = 20, 15
_SHARP = math.radians(4.0)  # turns of so much within a sweep bend it by more than a beam
_BIASED = math.radians(1.0)  # bias from which on a gyroscope is worse than the motion model, radians a second
_CERTAIN = 4.0  # standard errors that the gain must be from zero


@dataclass(frozen=True, kw_only=True)
class Gyroscope:
    """What sure matches say of a gyroscope."""

    bias: float  # rate that it shows at rest, radians a second; 0 where too few steps are matched surely
    n_turns: int  # sharp turns in which sweeps were straightened by it
    gain: float  # mean score of matches of straightened sweeps, less that of the sweeps as they are
    standard_error: float  # of the gain; NaN with fewer than two turns

    @property
    def is_biased(self) -> bool:
        """Whether the bias is worth taking off."""
        return abs(self.bias) > _BIASED

    @property
    def straightens(self) -> bool:
        """Whether sweeps are bent on the turn, and straight once its turn is taken out."""
        return self.n_turns >= _MIN_TURNS and self.gain > _CERTAIN * self.standard_error


def judge_gyroscope(log: Log, turned: Floats) -> Gyroscope:
    """Return what sure matches say of a gyroscope that turned by (n,) radians at each scan, NaN where unknown."""
    stamps = np.array([scan.stamp for scan in log])
    seconds = np.diff(stamps)
    rates = np.full(turned.size, np.nan)
    np.divide(np.diff(turned), seconds, out=rates[1:], where=seconds > 0.0)
    steps = np.unique(np.linspace(1, max(len(stamps) - 1, 1), _N_STEPS).astype(int)).tolist()
    biases = [
        float(rates[k] - wrap(motion[2]) / seconds[k - 1])
        for k in steps
        if k < rates.size and math.isfinite(rates[k]) and (motion := sure_motion(log[k - 1], log[k])) is not None
    ]
    bias = float(np.median(biases)) if len(biases) >= _MIN_STEPS else 0.0
    gains = _gains(log, rates - bias, float(np.median(seconds)) if seconds.size else 0.0)
    error = float(np.std(gains, ddof=1)) / math.sqrt(len(gains)) if len(gains) > 1 else math.nan
    return Gyroscope(
        bias=bias, n_turns=len(gains), gain=float(np.mean(gains)) if gains else math.nan, standard_error=error
    )


def straightened(scan: LaserScan, rate: float, seconds: float) -> LaserScan:
    """Return a scan without the turn during its sweep, which took so many seconds and ended at the stamp."""
    if not (math.isfinite(rate) and seconds > 0.0) or scan.time_increment > 0.0:
        return scan
    timed = replace(scan, time_increment=seconds / max(len(scan), 1))
    return replace(deskew(timed, (0.0, 0.0, rate)), stamp=scan.stamp, time_increment=0.0)


def _gains(log: Log, rates: Floats, seconds: float) -> list[float]:
    """Return by how much the matches over sharp turns score more once the sweeps are straightened."""
    turns = np.nan_to_num(np.abs(rates) * seconds)
    sharpest = [k for k in np.argsort(-turns)[:_N_TURNS].tolist() if turns[k] > _SHARP and k > 0]
    gains = []
    for k in sharpest:
        earlier, later = log[k - 1], log[k]
        if earlier.time_increment > 0.0:
            return []
        before = match(earlier, later).score
        after = match(
            straightened(earlier, float(rates[k - 1]), seconds), straightened(later, float(rates[k]), seconds)
        )
        if math.isfinite(before) and math.isfinite(after.score):
            gains.append(after.score - before)
    return gains
