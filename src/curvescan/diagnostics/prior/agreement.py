"""Whether wheels, or a gyroscope, measure the motion that the scans show.

The test takes short motions from all over a log and matches their scans without a guess.
"""

from __future__ import annotations

import math
from itertools import pairwise

import numpy as np

from curvescan import se2
from curvescan.io.log import Log
from curvescan.matchers import match
from curvescan.scan import LaserScan
from curvescan.types import Pose

_N_MOTIONS = 150
_SHORTEST, _LONGEST, _MAX_TURN = 0.1, 0.5, 0.5
"""Motions that are compared: metres, metres, radians. Shorter ones say nothing, longer ones are harder to match."""

_MAX_SCANS = 60  # most scans that a motion takes
_SURE = 0.9  # confidence of a match from which on it is compared
_N_SURE = 10  # sure matches that it takes to judge

_OFF, _OFF_RAD, _OFF_SHARE = 0.05, 0.03, 0.25
"""Motions agree that differ by no more than this, metres and radians, and this share of the motion: they may slip."""

_SHARE = 0.6  # share of the sure matches that agree with wheels that are used


def compare_motion(log: Log, poses: Pose) -> tuple[bool, str]:
    """Return whether (n, 3) poses by wheels, or by a gyroscope (x, y NaN), agree with matched scans, and a sentence."""
    n_sure = n_agreeing = 0
    for i, j in _motions(poses[: len(log)]):
        seen = sure_motion(log[i], log[j])
        if seen is None:
            continue
        n_sure += 1
        measured = se2.between(poses[i], poses[j])
        off = seen - measured
        # no comparison with the NaN of a gyroscope holds
        is_far = math.hypot(off[0], off[1]) > _OFF + _OFF_SHARE * math.hypot(measured[0], measured[1])
        n_agreeing += not is_far and abs(se2.wrap(off[2])) <= _OFF_RAD + _OFF_SHARE * abs(measured[2])
    if n_sure < _N_SURE:
        return False, "cannot be compared with the scans: too few motions are matched surely"
    return n_agreeing >= _SHARE * n_sure, f"agrees with the scans in {n_agreeing} of {n_sure} motions"


def sure_motion(earlier: LaserScan, later: LaserScan) -> Pose | None:
    """Return the (3,) motion between two scans by a match without a guess; None unless all of it is sure."""
    found = match(earlier, later)
    return found.pose if found.ok and found.confidence > _SURE and found.degenerate_direction is None else None


def _motions(poses: Pose) -> list[tuple[int, int]]:
    """Return pairs of scans: of each part of the log the longest motion from its first scans."""
    found = []
    edges = np.linspace(0, max(len(poses) - 1, 0), _N_MOTIONS + 1).astype(int).tolist()
    for begin, end in pairwise(edges):
        best, size = None, 0.0
        for i in range(begin, end, max((end - begin) // 8, 1)):
            moved = se2.between(poses[i], poses[i + 1 : i + 1 + _MAX_SCANS])
            length, turn = np.nan_to_num(np.hypot(moved[:, 0], moved[:, 1])), np.abs(moved[:, 2])
            is_short = (length <= _LONGEST) & (turn <= _MAX_TURN)
            n_short = int(np.argmin(is_short)) if not is_short.all() else is_short.size
            is_motion = (length >= _SHORTEST) | (turn >= _SHORTEST)
            amount = np.where(is_motion, length + turn, 0.0)[:n_short]
            if amount.size and amount.max() > size:
                best, size = (i, i + 1 + int(np.argmax(amount))), float(amount.max())
        if best is not None:
            found.append(best)
    return found
