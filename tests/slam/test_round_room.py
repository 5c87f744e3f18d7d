"""A round room, seen by half: nothing shows how far the robot turned in it, and the loop closes all the same."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan.evaluation.trajectory_errors import ate
from curvescan.simulation import SENSORS, build_world


@pytest.mark.parametrize("seed", [8808, 8832])
def test_a_lap_closes_behind_a_round_room(seed: int) -> None:
    near = replace(SENSORS["urg-04lx"], range_max=4.0)
    lap = cs.simulate(build_world("building", seed), sensor=near, seed=seed, odometry_noise=None)
    slam = cs.Slam()
    odometry = np.array([slam.add(scan).pose_odom for scan in lap])
    assert ate(odometry, lap.truth.poses).max() > 5.0
    assert ate(slam.finish().poses, lap.truth.poses).max() < 1.5
