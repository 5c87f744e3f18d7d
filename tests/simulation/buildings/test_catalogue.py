"""Every named world: the same for the same seed, closed, with room to drive; offices one can walk through."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan.configs import look_up
from curvescan.errors import InvalidArgumentError
from curvescan.simulation import SENSORS, WORLDS, Sensor, World, build_world
from curvescan.simulation.buildings.rooms import corridor
from curvescan.simulation.driving.motion import Grid
from curvescan.simulation.driving.pursuit import Drive
from curvescan.simulation.sensing.people import child
from curvescan.simulation.sensing.raycast import cast_rays

ARRAYS = ("walls", "boxes", "circles", "arcs", "floor", "route")
RANDOM = {"clutter", "office", "building", "office-floor"}


@pytest.mark.parametrize("name", WORLDS)
def test_each_world_is_decided_by_its_seed(name):
    world, again, other = (build_world(name, seed) for seed in (5, 5, 6))
    assert isinstance(world, World)
    assert world.name in (name, "corridor", "room")  # of what it is made
    for array in ARRAYS:
        assert np.array_equal(getattr(world, array), getattr(again, array))
    is_same = all(np.array_equal(getattr(world, a), getattr(other, a)) for a in ARRAYS)
    assert is_same == (name not in RANDOM)


@pytest.mark.parametrize("name", sorted(set(WORLDS) - {"bare-corridor"}))
def test_no_ray_leaves_a_world(name):
    world = build_world(name, 11)
    low, high = world.bounds[:2], world.bounds[2:]
    rng = np.random.default_rng(0)
    places = rng.uniform(low, high, (40, 2))
    places = places[world.is_free(places, 0.2)][:6]
    assert len(places) == 6
    for x, y in places:
        ranges, _ = cast_rays(world, [x, y, 0.123], angle_min=0.0, angle_increment=0.0171, n_beams=368)
        assert np.isfinite(ranges).all()


def test_a_bare_corridor_is_two_parallel_walls():
    world = build_world("bare-corridor")
    assert world.walls[:, [1, 3]].tolist() == [[1.0, 1.0], [-1.0, -1.0]]
    assert world.n_primitives == 2


def test_a_corridor_with_niches_and_pillars():
    world = corridor(10.0, 2.0, recesses=[(2.0, 1.0, 0.3)], pillars=[(-2.0, 0.9, 0.2)])
    up = {"angle_min": 0.5 * np.pi, "angle_increment": 0.1, "n_beams": 1}
    at = {x: cast_rays(world, [x, 0.0, 0.0], **up)[0][0] for x in (0.0, 2.0, -2.0)}
    assert at[0.0] == pytest.approx(1.0, abs=1e-12)
    assert at[2.0] == pytest.approx(1.3, abs=1e-12)
    assert at[-2.0] == pytest.approx(0.8, abs=1e-12)


@pytest.mark.parametrize("name", ["office", "building", "office-floor"])
@pytest.mark.parametrize("seed", range(6))
def test_every_place_of_the_route_can_be_reached(name, seed):
    world = build_world(name, child(seed, 0))
    grid = Grid(world)
    places = grid.reachable(world.route[0], Drive().clearance)
    for goal in world.route:
        # a waypoint in a doorway or a crammed room may lie up to 0.3 m from the nearest place to stand
        assert np.hypot(*(places - goal).T).min() < 0.3
    route = np.vstack([world.route, world.route[:1]])
    length = np.hypot(*np.diff(route, axis=0).T).sum()
    assert name != "building" or 60.0 < length < 85.0


@pytest.mark.parametrize("seed", range(6))
def test_doorways_are_clear_of_furniture(seed):
    world = build_world("office", seed)
    # the route of an office goes room, door, room, door: doors are 0.95 m wide or more
    doors = world.route[1::2]
    assert np.all(world.distance(doors) >= 0.47)


def test_sensors_are_what_their_names_say():
    for name, sensor in SENSORS.items():
        assert isinstance(sensor, Sensor)
        assert sensor.name == name
    sick = SENSORS["sick-lms200"]
    assert sick.n_beams == 361
    last = sick.angle_min + (sick.n_beams - 1) * sick.angle_increment
    assert last == pytest.approx(0.5 * np.pi, abs=1e-12)


def test_an_unknown_name_is_answered_with_the_nearest():
    with pytest.raises(InvalidArgumentError, match="unknown world 'ofice': did you mean 'office'"):
        build_world("ofice")
    with pytest.raises(InvalidArgumentError, match="unknown sensor 'lms200': did you mean 'sick-lms200'"):
        look_up(SENSORS, "lms200", "sensor")
    with pytest.raises(InvalidArgumentError, match="seed must be an integer >= 0, got -1"):
        child(-1, 0)
