"""What a log itself tells of the motion from scan to scan: its wheel odometry, or else its gyroscope."""

from __future__ import annotations

import numpy as np

from curvescan.errors import InvalidArgumentError
from curvescan.io.log import Log
from curvescan.io.sense import GyroLog, rotation_sense
from curvescan.types import Pose


def prior_of(log: Log) -> Pose:
    """Return the pose of the sensor at each scan by the log's own odometry.

    Parameters
    ----------
    log : Log
        Its scans are read once more where only a gyroscope tells, to find its unit and sense.

    Returns
    -------
    (n, 3) float64
        [x, y, theta] in a frame of its own: metres, metres, radians; NaN where it does not tell. Of a gyroscope x and y
        are NaN.

    Raises
    ------
    InvalidArgumentError
        When the log has neither, or its gyroscope turns against its scans.
    """
    if log.odometry is not None:
        return log.odometry.poses
    turned = log.turned_by_gyro() if isinstance(log, GyroLog) else None
    if turned is None:
        raise InvalidArgumentError(
            f"{log.name} holds neither wheel odometry nor a gyroscope that --odometry-prior could "
            "take: leave it out"
        )
    sense = rotation_sense(log, turned, "gyroscope")
    if sense is not None and sense.is_against:
        raise InvalidArgumentError(
            f"the gyroscope of {log.name} turns against its scans in {sense.n_against} of "
            f"{sense.n_turns} sharp turns: give --clockwise if the sensor does, or leave "
            "--odometry-prior out"
        )
    if sense is not None and sense.is_in_degrees:
        turned = np.radians(turned)
    nowhere = np.full(turned.size, np.nan)
    return np.column_stack([nowhere, nowhere, turned])
