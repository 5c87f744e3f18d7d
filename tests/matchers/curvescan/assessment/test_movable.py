"""Movable things: what stands free, and that few such things do not fix a direction alone."""

from __future__ import annotations

import numpy as np

import curvescan as cs
from curvescan.matchers.curvescan.assessment.assessment import assess_pose
from curvescan.matchers.curvescan.assessment.movable import free_standing, without_movable
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.simulation.buildings.rooms import corridor
from tests.matchers.curvescan.scenes import MOTION, features, pair

CONFIG = CurvescanConfig()


def corridor_with(*people):
    """A scan of a bare corridor with round things of 0.2 m radius in it."""
    world = corridor(40.0, 2.4)
    world += type(world)(circles=np.array([[x, y, 0.2] for x, y in people]).reshape(-1, 3))
    log = cs.simulate(world, poses=np.zeros((1, 3)), n_scans=1, seed=len(people))
    return features(log[0])


def test_a_person_in_a_corridor_stands_free_and_a_wall_does_not():
    scan = corridor_with((2.5, 0.3), (4.0, -0.6))
    surfels = scan.image.surfels
    is_free, n_things = free_standing(surfels, scan.bounds, np.ones(len(surfels), dtype=np.uint8))
    assert n_things == 2
    near = np.hypot(surfels[:, 0] - 2.5, surfels[:, 1] - 0.3) < 0.23
    assert is_free[near].all()
    assert not is_free[np.abs(surfels[:, 1]) > 1.1].any()
    _, n_agreeing = free_standing(surfels, scan.bounds, np.zeros(len(surfels), dtype=np.uint8))
    assert n_agreeing == 0


def test_few_people_alone_do_not_fix_the_way_along_a_corridor():
    people = (2.5, 0.3), (4.0, -0.6), (3.2, 0.7)
    ref, cur = corridor_with(*people), corridor_with(*people)
    assessment = assess_pose(ref, cur, np.zeros(3), CONFIG)
    left = without_movable(ref, cur, np.zeros(3), assessment, CONFIG)
    assert left is not assessment
    assert left.information[0] < 0.01 * assessment.information[0]
    assert abs(left.weakest[0]) > 0.99


def test_a_room_is_fixed_by_its_walls():
    ref, cur = pair()
    assessment = assess_pose(ref, cur, MOTION, CONFIG)
    assert without_movable(ref, cur, MOTION, assessment, CONFIG) is assessment
