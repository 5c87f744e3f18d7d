"""A map of today for the readers of tomorrow: `python -m tests.slam.map_example` writes maps/room-v1.csmap.

The file is kept when the program changes: it is to be read for good. A later version of the format gets an example of
its own.
"""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

import curvescan as cs
from curvescan.simulation import World
from curvescan.types import Pose

FILE = Path(__file__).parent / "maps" / "room-v1.csmap"

ROOM = World(
    name="room of the example",
    walls=np.array(
        [
            [0.0, 0.0, 9.0, 0.0],
            [9.0, 0.0, 9.0, 4.0],
            [9.0, 4.0, 6.5, 4.0],
            [6.5, 4.0, 6.5, 7.0],
            [6.5, 7.0, 0.0, 7.0],
            [0.0, 7.0, 0.0, 0.0],
            [3.0, 7.0, 3.0, 5.6],
        ]
    ),
    boxes=np.array(
        [
            [1.0, 0.6, 1.2, 0.6, 0.3],
            [4.4, 0.5, 0.8, 0.5, 0.0],
            [8.2, 0.7, 0.7, 0.9, 0.5],
            [0.5, 3.2, 0.5, 1.4, 0.0],
            [5.7, 6.3, 0.9, 0.6, -0.2],
            [1.7, 6.4, 0.8, 0.7, 0.1],
        ]
    ),
    circles=np.array([[3.4, 3.4, 0.25], [7.6, 3.4, 0.2]]),
)


def lap(n: int = 150, start: float = 0.0) -> Pose:
    """Return n poses once round the round pillar, looking ahead."""
    angle = start + np.linspace(0.0, 2.0 * np.pi, n)
    x, y = 3.6 + 1.9 * np.cos(angle), 3.3 + 1.6 * np.sin(angle)
    ahead = np.arctan2(1.6 * np.cos(angle), -1.9 * np.sin(angle))
    return np.column_stack((x, y, ahead))


def scans(poses: Pose, *, world: World = ROOM, seed: int = 0) -> list[cs.LaserScan]:
    """Return what a laser of 180 beams sees from there."""
    return list(cs.simulate(world, poses=poses, seed=seed, odometry_noise=None))


def main() -> None:
    """Write the example."""
    slam = cs.Slam()
    for scan in scans(lap()):
        slam.add(scan)
    slam.finish()
    found = slam.map
    FILE.parent.mkdir(exist_ok=True)
    replace(found, grid=found.occupancy()).save(FILE)


if __name__ == "__main__":
    main()
