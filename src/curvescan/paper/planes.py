"""Planes and corners, from which the paper found its parameters (the paper's section 3.1)."""

from __future__ import annotations

import numpy as np

from curvescan.scan import LaserScan
from curvescan.simulation import Sensor


def wall_scans(
    sensor: Sensor, distance: float, *, sigma: float, n_scans: int, seed: int, angle: float = 0.0
) -> list[LaserScan]:
    """Return scans of a plane ahead, or of a corner in it, with Gaussian range noise.

    Parameters
    ----------
    sensor : Sensor
        Whose beams.
    distance : float
        To the plane, along the x axis, metres, > 0.
    sigma : float
        Range noise, metres.
    n_scans : int
        How many, each with its own noise.
    seed : int
        Of the noise.
    angle : float
        Radians by which each half of the plane is folded back at the x axis: 0 for a plane, pi / 4 for an edge
        of a right angle, negative for an inner corner.

    Returns
    -------
    list of LaserScan
        Beams that miss, or meet the wall beyond the sensor's range, have no reading.
    """
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
