"""Whether the poses in a log are a reference (of SLAM, localization or our odometry), no wheel odometry.

A log may say so itself (NEFF lines, frames of a bag). Poses that come back to a place after a long way within
centimetres of what the scans say tell it too: wheels drift by one part in a hundred or so.
"""

from __future__ import annotations

import math

import numpy as np

from curvescan import se2
from curvescan.diagnostics.prior.agreement import sure_motion
from curvescan.io.log import EstimatedLog, Log
from curvescan.types import Floats, Pose

_WAY = 50.0  # least way between two visits of a place, metres
_NEAR = 0.5  # most by which the two poses differ, metres and radians

_EXACT, _EXACT_RAD = 0.15, math.radians(2.0)
"""Poses that never drift agree with the scans within so much: the steps of a search grid, and of rounding."""

_N_VISITS, _N_SURE = 40, 10  # visits that are matched at most, and those that must be sure to judge by
_APART = 10  # scans between two visits that are matched, at least
_SHARE = 0.9  # share of the sure visits that are exact in poses that never drift


def why_reference(log: Log, poses: Pose) -> str:
    """Return why the poses in a log are a reference; empty for wheel odometry. poses (n, 3)."""
    if isinstance(log, EstimatedLog) and (why := log.why_estimated()):
        return why
    errors = _errors_of_visits(log, poses)
    if len(errors) < _N_SURE:
        return ""
    n_exact = int(np.count_nonzero((errors[:, 0] < _EXACT) & (errors[:, 1] < _EXACT_RAD)))
    if n_exact < _SHARE * len(errors):
        return ""
    return (
        f"they never drift: in {n_exact} of {len(errors)} places seen again after {_WAY:g} m and more they agree "
        f"with the "
        f"scans to {_EXACT:g} m"
    )


def _errors_of_visits(log: Log, poses: Pose) -> Floats:
    """Return (n, 2) by how much the poses differ from sure matches of two visits of a place: metres and radians."""
    steps = np.nan_to_num(np.hypot(*np.diff(poses[:, :2], axis=0).T))
    way = np.concatenate(([0.0], np.cumsum(steps)))
    errors: list[tuple[float, float]] = []
    n_matched, last = 0, -_APART
    # in an order that takes visits from all over the log, and is the same each time
    for later in np.random.default_rng(0).permutation(np.flatnonzero(way > _WAY)).tolist():
        if n_matched == _N_VISITS or (n_matched == _N_SURE and not errors):
            break
        difference = np.abs(poses - poses[later])
        difference[:, 2] = np.abs(se2.wrap(difference[:, 2]))
        apart = np.where((way[later] - way > _WAY) & (difference[:, 2] < _NEAR), np.hypot(*difference[:, :2].T), np.inf)
        earlier = int(np.nanargmin(apart))
        if not apart[earlier] < _NEAR or abs(later - last) < _APART:
            continue
        n_matched, last = n_matched + 1, later
        motion = sure_motion(log[earlier], log[later])
        if motion is not None:
            off = motion - se2.between(poses[earlier], poses[later])
            errors.append((math.hypot(off[0], off[1]), abs(float(se2.wrap(off[2])))))
    return np.array(errors).reshape(-1, 2)
