"""The motion prior of a log: its wheel odometry, or else its gyroscope, where it agrees with the scans."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from curvescan.diagnostics.prior.agreement import compare_motion
from curvescan.diagnostics.prior.lag import without_lag
from curvescan.diagnostics.prior.reference import why_reference
from curvescan.diagnostics.rotation_direction import RotationDirection
from curvescan.errors import InvalidArgumentError
from curvescan.io.log import GyroLog, Log
from curvescan.types import Pose


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
    agreement = compare_motion(log, poses)
    verb = "used" if agreement.is_good else "left out"
    return Prior(
        poses=poses if agreement.is_good else None,
        sentence=f"{verb}: the {found} of the log, which {agreement.sentence}",
    )


def _poses_of(log: Log, lag: float) -> tuple[str, Pose | None]:
    """Return what the motion is measured by, and the (n, 3) poses; the positions by a gyroscope are NaN."""
    if (odometry := log.odometry) is not None:
        return "wheel odometry", without_lag(odometry.stamps, odometry.poses, lag) if lag else odometry.poses
    turned = log.turned_by_gyro() if isinstance(log, GyroLog) else None
    if turned is None:
        return "", None
    nowhere = np.full(turned.size, np.nan)
    return "gyroscope", np.column_stack([nowhere, nowhere, turned])
