"""The motion prior of a log: its wheel odometry, or else its gyroscope, where it agrees with the scans."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan.diagnostics.prior.agreement import compare_motion, sure_motion
from curvescan.diagnostics.prior.lag import without_lag
from curvescan.diagnostics.rotation_direction import RotationDirection
from curvescan.errors import InvalidArgumentError
from curvescan.io.log import EstimatedLog, GyroLog, Log
from curvescan.types import Floats, Pose

_WAY = 50.0  # least way between two visits of a place, metres
_NEAR = 0.5  # most by which the two poses differ, metres and radians

_EXACT, _EXACT_RAD = 0.15, math.radians(2.0)
"""Poses that never drift agree with the scans within so much: the steps of a search grid, and of rounding."""

_N_VISITS, _N_SURE = 40, 10  # visits that are matched at most, and those that must be sure to judge by
_APART = 10  # scans between two visits that are matched, at least
_SHARE = 0.9  # share of the sure visits that are exact in poses that never drift


def why_reference(log: Log, poses: Pose) -> str:
    """Return why the poses (n, 3) in a log are a reference; empty for wheel odometry.

    A log may say so itself (NEFF lines, frames of a bag). Poses that come back to a place after a long way within
    centimetres of what the scans say tell it too: wheels drift by one part in a hundred or so.
    """
    if isinstance(log, EstimatedLog) and (why := log.why_estimated()):
        return why
    errors = _errors_of_visits(log, poses)
    if len(errors) < _N_SURE:
        return ""
    n_exact = int(np.count_nonzero((errors[:, 0] < _EXACT) & (errors[:, 1] < _EXACT_RAD)))
    if n_exact < _SHARE * len(errors):
        return ""
    return (
        f"they never drift: in {n_exact} of {len(errors)} places seen again after {_WAY:g} m and more they agree with "
        f"the scans to {_EXACT:g} m"
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


@dataclass(frozen=True, eq=False, kw_only=True)
class Prior:
    """The motion prior of a log."""

    # (n, 3) float64 or None: pose of the sensor at each scan by wheels or gyroscope, without lag; None where it is
    # left out, or there is none
    poses: Pose | None = None
    sentence: str = ""  # whether it is used, and why; empty where the log has none


def choose_prior(
    log: Log, *, sense: RotationDirection | None = None, lag: float = 0.0, wanted: bool | None = None
) -> Prior:
    """Return the motion prior of a log, whose wheels lag by so many seconds.

    With wanted=None it is used where it agrees with the scans, with True in any case, with False never.
    Raises InvalidArgumentError where it is wanted and there is none, it turns against the scans, or is the output of a
    SLAM.
    """
    found, poses = _poses_of(log, lag)
    if poses is None:
        if wanted:
            raise InvalidArgumentError(
                f"{log.name} holds neither wheel odometry nor a gyroscope that could serve as motion prior: leave "
                "odometry_prior=True out"
            )
        return Prior()
    if wanted is False:
        return Prior(sentence=f"left out: the {found} of the log, as odometry_prior=False asks")
    if found == "wheel odometry" and (why := why_reference(log, poses)):
        if wanted:
            raise InvalidArgumentError(
                f"the poses in {log.name} are a reference and no motion prior: {why}; leave odometry_prior=True out"
            )
        return Prior(sentence=f"left out: the poses in the log are a reference and no motion prior, {why}")
    if sense is not None and sense.is_reversed:
        against = f"turns against {{}} scans in {sense.n_reversed} of {sense.n_turns} sharp turns"
        if wanted:
            raise InvalidArgumentError(
                f"the {found} of {log.name} {against.format('its')}: give clockwise=True if the sensor does, or leave "
                "odometry_prior=True out"
            )
        return Prior(sentence=f"left out: the {found} of the log {against.format('the')}")
    if wanted:
        return Prior(poses=poses, sentence=f"used: the {found} of the log, as odometry_prior=True asks")
    agrees, how = compare_motion(log, poses)
    verb = "used" if agrees else "left out"
    return Prior(poses=poses if agrees else None, sentence=f"{verb}: the {found} of the log, which {how}")


def _poses_of(log: Log, lag: float) -> tuple[str, Pose | None]:
    """Return what the motion is measured by, and the (n, 3) poses; the positions by a gyroscope are NaN."""
    if (odometry := log.odometry) is not None:
        return "wheel odometry", without_lag(odometry.stamps, odometry.poses, lag) if lag else odometry.poses
    turned = log.turned_by_gyro() if isinstance(log, GyroLog) else None
    if turned is None:
        return "", None
    nowhere = np.full(turned.size, np.nan)
    return "gyroscope", np.column_stack([nowhere, nowhere, turned])
