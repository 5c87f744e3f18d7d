"""Planes and corners, from which the paper found its parameters (the paper's section 3.1)."""

from __future__ import annotations

import numpy as np

from curvescan.scan import LaserScan
from curvescan.simulation import Sensor


def wall_scans(
    sensor: Sensor, distance: float, *, sigma: float, n_scans: int, seed: int, angle: float = 0.0
) -> list[LaserScan]:
    """Return scans of a plane ahead, or of a corner in it, with Gaussian range noise."""
    beams = sensor.angle_min + sensor.angle_increment * np.arange(sensor.n_beams)
    # each half is a line through (distance, 0) that leans by `angle` away from the sensor
    with np.errstate(divide="ignore"):
        exact = distance * np.cos(angle) / np.cos(np.abs(beams) + angle)
    exact = np.where((np.abs(beams) + angle < np.pi / 2) & (exact > 0.0), exact, np.inf)
    rng = np.random.default_rng(seed)
    return [
        LaserScan(
            exact + sigma * rng.standard_normal(beams.size),
            angle_min=sensor.angle_min,
            angle_increment=sensor.angle_increment,
            range_min=sensor.range_min,
            range_max=sensor.range_max,
        )
        for _ in range(n_scans)
    ]
