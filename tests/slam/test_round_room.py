"""A round room, seen by half: nothing shows how far the robot turned in it, and the loop closes all the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan.evaluation.trajectory_errors import ate
from curvescan.simulation import SENSORS, build_world


def furthest_off(world: int, seed: int) -> tuple[float, float]:
    """How far odometry and SLAM err at most on one lap, metres."""
    near = replace(SENSORS["urg-04lx"], range_max=4.0)
    lap = cs.simulate(build_world("building", world), sensor=near, seed=seed, odometry_noise=None)
    slam = cs.Slam()
    odometry = np.array([slam.add(scan).pose_odom for scan in lap])
    return ate(odometry, lap.truth.poses).max(), ate(slam.finish().poses, lap.truth.poses).max()


@pytest.mark.slow
def test_laps_close_behind_a_round_room() -> None:
    laps = [furthest_off(world, world + noise) for world in (8808, 8832) for noise in (0, 1, 2)]
    assert min(odometry for odometry, _ in laps) > 5.0
    # the last bits of a processor decide in some: two of ten such laps do not close
    assert sum(slam < 1.5 for _, slam in laps) >= 4
    assert laps[3][1] < 1.5  # the first lap of the second building closes on each that was tried
