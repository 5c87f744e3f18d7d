"""Match two scans of a square room, made by hand: where was the second taken, seen from the first."""

import numpy as np

import curvescan as cs

angles = np.radians(np.arange(-120.0, 120.5, 0.5))


def scan_from(x: float, y: float, theta: float) -> cs.LaserScan:
    """Return what a laser at a pose in a room of 5 m by 4 m would measure, with 5 mm of noise."""
    heading = angles + theta
    to_x = np.where(np.cos(heading) > 0, 5.0 - x, -x) / np.cos(heading)
    to_y = np.where(np.sin(heading) > 0, 4.0 - y, -y) / np.sin(heading)
    noise = 0.005 * np.random.default_rng(0).standard_normal(angles.size)
    return cs.LaserScan(
        np.minimum(to_x, to_y) + noise, angle_min=angles[0], angle_increment=angles[1] - angles[0], range_max=8.0
    )


result = cs.match(scan_from(1.5, 2.0, 0.3), scan_from(1.6, 2.1, 0.4))
print(result)
print(result.outcome.value)
print(result.covariance)
