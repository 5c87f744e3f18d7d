"""Objects: what may move as one, and that what one object or a few people alone fix is open."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.assessment.assessment import assess_pose
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.features.objects import find_objects
from curvescan.matchers.curvescan.features.surfels import SHARED
from curvescan.simulation.buildings.rooms import corridor
from tests.matchers.curvescan.scenes import MOTION, features, pair

CONFIG = CurvescanConfig()


def corridor_with(*people, stamp=0.0, **things):
    """A scan of a corridor with round things of 0.2 m radius in it."""
    world = corridor(40.0, 2.4, **things)
    world += type(world)(circles=np.array([[x, y, 0.2] for x, y in people]).reshape(-1, 3))
    log = cs.simulate(world, poses=np.zeros((1, 3)), n_scans=1, seed=len(people))
    return features(replace(log[0], stamp=stamp))


def test_a_person_in_a_corridor_stands_free_and_a_wall_is_no_object():
    scan = corridor_with((2.5, 0.3), (4.0, -0.6))
    surfels, objects = scan.image.surfels, scan.objects
    assert objects.is_free.sum() == 2
    near = np.hypot(surfels[:, 0] - 2.5, surfels[:, 1] - 0.3) < 0.23
    assert objects.is_free[objects.label[near]].all()
    assert objects.is_small[near].all()
    assert len(set(objects.label[near])) == 1
    walls = np.abs(surfels[:, 1]) > 1.1
    assert (objects.label[walls] == -1).mean() > 0.95
    assert not objects.is_small[walls].any()
    # as a thing may have moved as a whole, many readings of it say no more than a few of them
    shared, n = surfels[:, SHARED], np.bincount(objects.label[objects.label >= 0])
    assert shared[near] == pytest.approx(0.02**2 * n[objects.label[near][0]])
    assert (shared[walls] == 0.0).mean() > 0.95


def test_the_jamb_of_a_door_is_of_the_wall():
    scan = corridor_with(recesses=[(2.5, 1.0, 0.25)])
    surfels, label = scan.image.surfels, scan.objects.label
    jamb = (np.abs(surfels[:, 0] - 3.0) < 0.05) & (surfels[:, 1] > 1.25) & (surfels[:, 1] < 1.4)
    assert jamb.sum() > 3
    assert (label[jamb] == -1).all()


@pytest.mark.parametrize(
    "people",
    [
        ((2.5, 0.3), (4.0, -0.6), (3.2, 0.7)),  # who may walk together
        ((0.7, 0.3),),  # near, and so much of what is seen
    ],
)
def test_what_one_object_or_a_few_people_alone_fix_is_open(people):
    ref, cur = corridor_with(*people), corridor_with(*people)
    assessment = assess_pose(ref, cur, np.zeros(3), CONFIG)
    assert assessment.is_open == (True, False, False)
    assert abs(assessment.weakest[0]) > 0.99


@pytest.mark.parametrize("side", [1, -1])
def test_a_cabinet_at_a_wall_is_a_thing_and_the_jambs_beside_it_are_none(side):
    recesses = [(1.0, 0.8, 0.25 * side), (4.0, 0.8, -0.25 * side)]
    scan = corridor_with(recesses=recesses, pillars=[(3.0, 0.95 * side, 0.5)])
    surfels, objects = scan.image.surfels, scan.objects
    x, y = surfels[:, 0], side * surfels[:, 1]
    front = (np.abs(x - 2.75) < 0.05) & (y > 0.75) & (y < 1.1)
    assert front.sum() > 3
    assert (objects.label[front] == -1).all()
    assert len(set(objects.movable[front])) == 1
    assert objects.movable[front][0] >= 0
    assert not objects.is_free[objects.movable[front][0]]
    for jamb in ((np.abs(x - 1.4) < 0.05) & (y > 1.25) & (y < 1.4), (np.abs(x - 4.4) < 0.05) & (y < -1.25)):
        assert jamb.any()
        assert (objects.movable[jamb] == -1).all()


@pytest.mark.parametrize(
    ("things", "is_open"), [(((2.5, 0.95, 0.5),), True), (((2.5, 0.95, 0.5), (4.0, -0.9, 0.6)), False)]
)
def test_what_one_thing_at_a_wall_fixes_is_open_where_it_may_have_been_moved(things, is_open):
    ref, soon, later = (corridor_with(pillars=things, stamp=stamp) for stamp in (0.0, 30.0, 3_600.0))
    assert not any(assess_pose(ref, soon, np.zeros(3), CONFIG).is_open)
    assert not any(assess_pose(later, later, np.zeros(3), CONFIG).is_open)
    for one, other in ((ref, later), (later, ref)):
        assert assess_pose(one, other, np.zeros(3), CONFIG).is_open == (is_open, False, False)


@pytest.mark.parametrize("stamp", [0.0, 3_600.0])
@pytest.mark.parametrize("doors", [(2.5,), (-4.0, 2.5, 5.0)])
def test_doors_and_rooms_are_measured(doors, stamp):
    recesses = [(x, 1.0, 0.25) for x in doors]
    ref, cur = corridor_with(recesses=recesses), corridor_with(recesses=recesses, stamp=stamp)
    assert not any(assess_pose(ref, cur, np.zeros(3), CONFIG).is_open)
    assert not any(assess_pose(*pair(), MOTION, CONFIG).is_open)


def test_a_scan_without_readings_has_no_objects():
    objects = find_objects(np.empty((0, 10)), np.zeros(1, dtype=np.int64))
    assert all(len(part) == 0 for part in objects)


@pytest.mark.parametrize(("stamp", "may_keep_pace"), [(0.0, True), (30.0, True), (3_600.0, False)])
def test_cabinets_alone_may_have_kept_pace_for_a_minute(stamp, may_keep_pace):
    """A crowd of things that are too near the walls to be two or three walkers."""
    things = [(x, y) for x in (1.5, 2.5, 3.5, 4.5) for y in (-0.8, 0.8)]
    ref, cur = corridor_with(*things), corridor_with(*things, stamp=stamp)
    assessment = assess_pose(ref, cur, np.zeros(3), CONFIG)
    assert assessment.is_open == (False, False, False)
    assert assessment.may_keep_pace is may_keep_pace


def test_walls_keep_no_pace():
    assert not assess_pose(*pair(), MOTION, CONFIG).may_keep_pace


@pytest.mark.parametrize("walked", [-0.2, -0.12, -0.06])
@pytest.mark.parametrize("sensor", ["sick-lms200", "spinning-360"])
def test_somebody_who_passes_close_by_does_not_take_the_pose_along(sensor, walked):
    # most readings are of the person, half a metre away, and two recesses say where the sensor is along the corridor
    def scan_at(x, person, seed):
        world = corridor(40.0, 2.4, recesses=[(3.2, 1.0, 0.25), (-1.5, 0.9, -0.2)])
        world += type(world)(circles=np.array([[*person, 0.2]]))
        return cs.simulate(world, poses=np.array([[x, 0.0, 0.0]]), sensor=sensor, n_scans=1, seed=seed)[0]

    prior = cs.UncertainPose(np.array([0.06, 0.0, 0.0]), np.diag([0.1, 0.05, 0.05]) ** 2)
    errors, squares = [], []
    for seed in range(20):
        one, other = scan_at(0.0, (0.15, 0.55), 2 * seed), scan_at(0.06, (0.15 + walked, 0.55), 2 * seed + 1)
        result = cs.match(one, other, prior=prior)
        off = result.pose - prior.pose
        errors.append(abs(off[0]))
        squares.append(off @ np.linalg.solve(result.covariance, off))
    assert np.mean(errors) < 0.02  # metres; 0.04 where each reading of the person counts as one of a wall
    assert np.median(squares) < 5.0
