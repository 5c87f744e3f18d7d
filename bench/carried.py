"""Drives whose sensor is carried to another room: how many end sure of the wrong one.

Run as ``python bench/carried.py 300 --first 7300000 [--full]``: twelve scans in one room, then twenty in another, of 6
to 14 by 5 to 12 m with 5 to 12 boxes in each. Odometry should lose its track; a drive whose last pose is known to a few
metres in the frame of the first scan was taken to go on.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import replace

import numpy as np

import curvescan as cs
from curvescan.simulation import SENSORS, Sensor, World, simulate
from curvescan.simulation.buildings.rooms import room
from curvescan.types import Floats

KNOWN_M = 5.0
"""Standard deviation below which the last pose is known in the frame of the first scan, metres."""

HALF = SENSORS["sick-lms200"]
FULL = replace(HALF, n_beams=360, angle_min=-math.pi, angle_increment=2.0 * math.pi / 360.0)

_N_BEFORE, _N_AFTER, _N_TRIES = 12, 20, 20


def furnished(rng: np.random.Generator) -> World:
    """Return a room with boxes along its walls and, two of five, anywhere in it."""
    length, width = rng.uniform(6.0, 14.0), rng.uniform(5.0, 12.0)
    boxes = [_box(0.5 * length, 0.5 * width, rng) for _ in range(int(rng.integers(5, 13)))]
    return replace(room(length, width), boxes=np.array(boxes))


def _box(x_wall: float, y_wall: float, rng: np.random.Generator) -> list[float]:
    """Return the centre, the two sides and the direction of a box in a room of half lengths `x_wall`, `y_wall`."""
    long, short = rng.uniform(0.3, 1.8), rng.uniform(0.3, 0.9)
    if rng.random() >= 0.6:
        x, y = rng.uniform(0.8 - x_wall, x_wall - 0.8), rng.uniform(0.8 - y_wall, y_wall - 0.8)
        return [x, y, long, short, rng.uniform(0.0, math.pi)]
    side = rng.choice([-1.0, 1.0])
    if rng.random() < 0.5:
        return [rng.uniform(1.0 - x_wall, x_wall - 1.0), side * (y_wall - 0.5 * short), long, short, 0.0]
    return [side * (x_wall - 0.5 * short), rng.uniform(1.0 - y_wall, y_wall - 1.0), short, long, 0.0]


def drive(seed: int, n_scans: int, sensor: Sensor) -> list[cs.LaserScan]:
    """Return the scans of a drive through a room; another one is furnished where a robot finds no way."""
    for k in range(_N_TRIES):
        world = furnished(np.random.default_rng([seed, k]))
        try:
            return list(simulate(world, sensor=sensor, n_scans=n_scans, seed=seed, odometry_noise=None))
        except cs.InvalidArgumentError:
            continue
    raise RuntimeError(f"no room of seed {seed} has a way through it")


def sigma_of_the_end(scans: list[cs.LaserScan]) -> Floats:
    """Return (2,) standard deviations of the last position by the odometry, metres."""
    odometry = cs.Odometry()
    steps = [odometry.add(scan) for scan in scans]
    sigma: Floats = np.sqrt(np.diag(steps[-1].covariance)[:2])
    return sigma


def main() -> None:
    """Print how many drives end sure of the wrong room, and which."""
    parser = argparse.ArgumentParser(prog="python bench/carried.py")
    parser.add_argument("drives", type=int, help="how many")
    parser.add_argument("--first", type=int, default=0, help="seed of the first")
    parser.add_argument("--full", action="store_true", help="a sensor that sees all around, for half a circle")
    given = parser.parse_args()
    sensor, wrong = FULL if given.full else HALF, []
    for seed in range(given.first, given.first + 10 * given.drives, 10):
        scans = [*drive(seed, _N_BEFORE, sensor), *drive(seed + 1, _N_AFTER, sensor)]
        if sigma_of_the_end(scans).max() < KNOWN_M:
            wrong.append(seed)
    sys.stdout.write(f"sure of the wrong room: {len(wrong)} of {given.drives}, seeds {wrong}\n")


if __name__ == "__main__":
    main()
