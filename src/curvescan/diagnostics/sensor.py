"""What a log's scans say of its sensor: in which order the beams were swept, and which way it turns.

Some drivers turn the order of the readings round and leave time_increment as it was; deskewing then doubles the
distortion. Where the sensor turns at a changing rate two scans agree the better the more of it is taken away: each
pair is matched deskewed as the log says, and as if the beams had been swept in reverse.
"""

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import islice

import numpy as np

from curvescan.deskew import Deskewer, deskew, sweep_shift
from curvescan.diagnostics.motion_prior import CERTAIN, mean_and_error
from curvescan.diagnostics.rotation_direction import RotationDirection, rotation_of_log
from curvescan.io.log import Log
from curvescan.matchers import match, prepare
from curvescan.scan import LaserScan
from curvescan.types import Floats

_N_ORDER_SCANS = 300  # scans of a log in which the order of the beams is looked for
_LEAST_SHIFT = 0.03  # pairs count whose sweeps move readings by this much, metres


@dataclass(frozen=True, kw_only=True)
class BeamOrder:
    """In which order beams were swept."""

    n_pairs: int  # pairs of scans that distinguish the two orders
    gain: float  # mean of the matches' scores as the log says, less that in the reverse order; NaN without pairs
    standard_error: float  # of the gain; NaN with fewer than two pairs

    @property
    def is_reversed_order(self) -> bool:
        """Whether the log certainly has the beams in the reverse order: ``read_log(..., backwards=True)``."""
        return self.gain < -CERTAIN * self.standard_error

    @property
    def is_forwards(self) -> bool:
        """Whether the log certainly has the beams in the order in which they were swept."""
        return self.gain > CERTAIN * self.standard_error


def beam_order_of_log(log: Iterable[LaserScan]) -> BeamOrder | None:
    """Return in which order the beams of a log's first 300 scans were swept; None where they have no beam times."""
    first = next(iter(log), None)
    if first is None or first.time_increment <= 0.0:
        return None
    gains: list[float] = []
    deskewer = Deskewer()
    held: deque[tuple[LaserScan, Floats]] = deque(maxlen=3)  # each with the velocity before it
    before = None
    for scan in islice(log, _N_ORDER_SCANS):
        deskewer = deskewer.ticked(scan.stamp, scan.scan_time)
        current = prepare(scan)
        result = None if before is None else match(before, current)
        velocity = deskewer.velocity(result.pose) if result is not None and result.ok else np.full(3, math.nan)
        before = current
        held.append((scan, velocity))
        if len(held) == 3:
            gains += _gain(held)
    gain, error = mean_and_error(gains)
    return BeamOrder(n_pairs=len(gains), gain=gain, standard_error=error)


def _gain(held: deque[tuple[LaserScan, Floats]]) -> list[float]:
    """Return by how much scans agree better in the order of the log than in reverse; none if undetermined."""
    (first, v_first), (second, v_second), (_, v_third) = held
    # at a scan the mean of the velocities before and after it
    v_first, v_second = 0.5 * (v_first + v_second), 0.5 * (v_second + v_third)
    is_known = np.isfinite((v_first, v_second)).all() and first.time_increment != 0.0
    if not is_known or sweep_shift(second, v_second) < _LEAST_SHIFT:
        return []
    scores = [match(deskew(first, sign * v_first), deskew(second, sign * v_second)).score for sign in (1.0, -1.0)]
    return [scores[0] - scores[1]] if np.isfinite(scores).all() else []


@dataclass(frozen=True, kw_only=True)
class SensorJudgement:
    """What a log's scans say of its sensor."""

    beam_order: BeamOrder | None  # in which order the beams were swept; None where the scans have no beam times
    # how the turns of the scans compare with those of wheels or gyroscope; None without either
    rotation: RotationDirection | None

    @property
    def can_deskew(self) -> bool:
        """Whether sweeps can be deskewed by their beam times: not where the beams are listed in reverse."""
        return self.beam_order is None or not self.beam_order.is_reversed_order


def judge_sensor(log: Log, *, is_order_needed: bool = True) -> SensorJudgement:
    """Return what a log's scans say of its sensor."""
    order = beam_order_of_log(log) if is_order_needed else None
    return SensorJudgement(beam_order=order, rotation=rotation_of_log(log))
