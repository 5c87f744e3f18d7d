"""The gyroscope of a bag (sensor_msgs/Imu): by how much it has turned at each scan."""

from __future__ import annotations

from array import array

import numpy as np

from curvescan.errors import LogFormatError
from curvescan.io.ros.bags.bag import Bag
from curvescan.io.ros.messages import IMU, BrokenMessageError, stamp_of
from curvescan.types import Floats


def read_gyro(bag: Bag, stamps: Floats, *, is_unstamped: bool) -> Floats | None:
    """Return the angle about z that the gyroscope has turned by at each scan.

    Of several the one with the most messages is read. Its z axis is taken to point up, as REP-103 has it.

    stamps (n,); result (n,): Radians if the driver gives radians a second; NaN outside the time it covers. None
    without a gyroscope.
    """
    counts = {name: topic.count for name, topic in bag.topics.items() if topic.msgtype == IMU}
    if not any(counts.values()):
        return None
    rows = array("d")
    try:
        for message in bag.messages([max(counts, key=lambda name: counts[name])]):
            try:
                decoded = bag.decode(message)
                rate = float(decoded.angular_velocity.z)
                at = message.received / 10**9 if is_unstamped else stamp_of(decoded.header)
            except (BrokenMessageError, AttributeError, TypeError, ValueError, OverflowError):
                continue  # one of a hundred a second
            rows.extend((at, rate))
    except LogFormatError:
        pass  # damage from here on: what stands before is used, and the read errors of the scans report it
    times, rates = np.array(rows).reshape(-1, 2).T
    times, first_idx = np.unique(times[np.isfinite(rates)], return_index=True)
    if times.size < 2:
        return None
    rates = rates[np.isfinite(rates)][first_idx]
    turned = np.append(0.0, np.cumsum(np.diff(times) * 0.5 * (rates[1:] + rates[:-1])))
    at_scans: Floats = np.interp(stamps, times, turned, left=np.nan, right=np.nan)
    return at_scans
