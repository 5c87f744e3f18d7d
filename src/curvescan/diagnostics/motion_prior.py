"""The motion prior in a log itself: its wheel odometry, or else its gyroscope."""

from __future__ import annotations

import numpy as np

from curvescan.diagnostics.odometry_lag import odometry_lag, without_lag
from curvescan.diagnostics.rotation_direction import RotationDirection, rotation_of_log
from curvescan.errors import InvalidArgumentError
from curvescan.io.log import GyroLog, Log
from curvescan.types import Floats, Pose

_FASTEST = 20.0
"""No robot turns by this much, radians a second."""


def motion_prior(log: Log, sense: RotationDirection | None = None) -> Pose:
    """Return the pose of the sensor at each scan by the log's own odometry.

    result (n, 3). Raises InvalidArgumentError.
    """
    turned = log.turned_by_gyro() if log.odometry is None and isinstance(log, GyroLog) else None
    if log.odometry is None and turned is None:
        raise InvalidArgumentError(
            f"{log.name} holds neither wheel odometry nor a gyroscope that could serve as motion prior: leave "
            "odometry_prior=True out"
        )
    sense = sense or rotation_of_log(log)
    if sense is not None and sense.is_reversed:
        raise InvalidArgumentError(
            f"the {sense.reference} of {log.name} turns against its scans in {sense.n_reversed} of "
            f"{sense.n_turns} sharp turns: give clockwise=True if the sensor does, or leave odometry_prior=True out"
        )
    if log.odometry is not None:
        poses = log.odometry.poses
        lag = odometry_lag(log, poses[:, 2])
        return without_lag(log.odometry.stamps, poses, lag) if lag else poses
    assert turned is not None
    if (sense is not None and sense.is_in_degrees) or _is_too_fast(turned, log):
        turned = np.radians(turned)
    nowhere = np.full(turned.size, np.nan)
    return np.column_stack([nowhere, nowhere, turned])


def _is_too_fast(turned: Floats, log: Log) -> bool:
    """Return whether a gyroscope turns faster than any robot, so that it must give degrees."""
    seconds = np.diff([scan.stamp for scan in log])
    usual = np.median(seconds[seconds > 0.0]) if (seconds > 0.0).any() else np.inf
    steps = np.abs(np.diff(turned))
    steps = steps[np.isfinite(steps)]
    return bool(steps.size and np.percentile(steps, 99.0) / usual > _FASTEST)
