"""Ray casting against its slow twin, against worked cases, and against its own laws."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from curvescan import se2
from curvescan.errors import InvalidArgumentError
from curvescan.simulation import World, build_world
from curvescan.simulation.buildings.rooms import room, round_room
from curvescan.simulation.sensing.raycast import cast_rays
from tests.reference.raycast import cast_all

FULL = {"angle_min": -np.pi, "angle_increment": np.radians(1.0), "n_beams": 360}


@st.composite
def worlds(draw):
    """Random primitives around the origin: crossing, touching, far and near."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    n_walls, n_boxes, n_circles, n_arcs = (draw(st.integers(0, 5)) for _ in range(4))
    return World(
        walls=rng.uniform(-6.0, 6.0, (n_walls, 4)),
        boxes=np.column_stack(
            [
                rng.uniform(-6.0, 6.0, (n_boxes, 2)),
                rng.uniform(0.05, 2.0, (n_boxes, 2)),
                rng.uniform(-7.0, 7.0, n_boxes),
            ]
        ),
        circles=np.column_stack([rng.uniform(-6.0, 6.0, (n_circles, 2)), rng.uniform(0.02, 3.0, n_circles)]),
        arcs=np.column_stack(
            [
                rng.uniform(-6.0, 6.0, (n_arcs, 2)),
                rng.uniform(0.5, 8.0, n_arcs),
                rng.uniform(-7.0, 7.0, n_arcs),
                rng.uniform(0.01, 2.0 * np.pi, n_arcs),
            ]
        ),
    )


fans = st.sampled_from(
    [
        (-0.5 * np.pi, np.radians(3.0), 61),
        (-np.pi, np.radians(7.0), 52),  # the turn is no whole number of steps
        (2.5, -np.radians(5.0), 72),  # clockwise
        (0.3, np.radians(11.0), 70),  # more than two turns
        (1.0, 0.1, 1),
    ]
)
coordinates = st.floats(-6.0, 6.0)


@settings(max_examples=60, deadline=None)
@given(worlds(), fans, coordinates, coordinates, st.floats(-10.0, 10.0))
def test_agrees_with_the_slow_twin(world, fan, x, y, theta):
    angle_min, step, n_beams = fan
    pose, angles = np.array([x, y, theta]), angle_min + step * np.arange(n_beams)
    ranges, hit_idx = cast_rays(world, pose, angle_min=angle_min, angle_increment=step, n_beams=n_beams)
    table = cast_all(world.walls, world.boxes, world.circles, world.arcs, pose, angles)
    assert ranges.shape == hit_idx.shape == (n_beams,)
    assert np.array_equal(hit_idx == -1, np.isinf(ranges))
    nearest = table.distance.min(axis=1, initial=np.inf)
    is_confident = ~table.is_doubtful.any(axis=1)
    assert np.array_equal(np.isinf(nearest)[is_confident], np.isinf(ranges)[is_confident])
    for j in np.flatnonzero(is_confident & (hit_idx >= 0)):
        # a rounding error of the beam's direction (some 1e-15 rad, 20 m away) grows as 1 / sine
        limit = 1e-12 / table.sine[j, hit_idx[j]]
        assert abs(ranges[j] - table.distance[j, hit_idx[j]]) <= limit
        assert ranges[j] <= nearest[j] + limit


@pytest.mark.parametrize("name", ["office", "building", "clutter"])
def test_agrees_with_the_slow_twin_in_a_built_world(name):
    world = build_world(name, 7)
    low, high = world.bounds[:2], world.bounds[2:]
    for share in (0.23, 0.61):
        pose = np.array([*(low + share * (high - low)), 0.4])
        angles = -np.pi + np.radians(9.0) * np.arange(40)
        ranges, _ = cast_rays(world, pose, angle_min=-np.pi, angle_increment=np.radians(9.0), n_beams=40)
        table = cast_all(world.walls, world.boxes, world.circles, world.arcs, pose, angles)
        is_confident = ~table.is_doubtful.any(axis=1)
        assert is_confident.sum() >= 35
        np.testing.assert_allclose(ranges[is_confident], table.distance.min(axis=1)[is_confident], rtol=0, atol=1e-10)


def test_a_square_room_from_its_middle():
    ranges, hit_idx = cast_rays(room(6.0, 6.0), [0, 0, 0], angle_min=0.0, angle_increment=0.25 * np.pi, n_beams=8)
    expected = np.tile([3.0, 3.0 * np.sqrt(2.0)], 4)
    np.testing.assert_allclose(ranges, expected, rtol=0, atol=1e-14)  # corners leave no slit
    assert np.array_equal(hit_idx[::2], [1, 2, 3, 0])


def test_corners_leave_no_slit():
    world = room(6.0, 4.0).moved([0.3, -0.2, 0.7])
    corners = world.walls[:, :2]
    for place in ([0.1, 0.1], [-1.0, 0.9], [1.234, -1.1]):
        for corner in corners:
            angle = np.arctan2(*(corner - place)[::-1])
            ranges, _ = cast_rays(world, [*place, 0.0], angle_min=angle, angle_increment=1e-16, n_beams=1)
            np.testing.assert_allclose(ranges, np.linalg.norm(corner - place), rtol=0, atol=1e-9)


def test_a_round_room_off_its_middle():
    x, radius = 1.0, 4.0
    ranges, _ = cast_rays(round_room(radius), [x, 0.0, 0.0], **FULL)
    angles = FULL["angle_min"] + FULL["angle_increment"] * np.arange(360)
    expected = -x * np.cos(angles) + np.sqrt(radius**2 - (x * np.sin(angles)) ** 2)
    np.testing.assert_allclose(ranges, expected, rtol=0, atol=1e-13)


def test_a_circle_from_outside_and_inside():
    world = World(circles=[[3.0, 0.0, 1.0]])
    step = {"angle_min": 0.0, "angle_increment": 0.5 * np.pi, "n_beams": 4}
    assert cast_rays(world, [0, 0, 0], **step)[0][0] == 2.0
    assert np.isinf(cast_rays(world, [0, 0, 0], **step)[0][1:]).all()
    np.testing.assert_allclose(cast_rays(world, [3.0, 0, 0.3], **step)[0], 1.0, atol=1e-15)


def test_half_an_arc_is_seen_from_both_sides_and_open_elsewhere():
    world = World(arcs=[[0.0, 0.0, 2.0, -0.5 * np.pi, np.pi]])
    step = {"angle_min": 0.0, "angle_increment": np.pi, "n_beams": 2}
    ranges, _ = cast_rays(world, [0, 0, 0], **step)
    assert ranges[0] == 2.0
    assert ranges[1] == np.inf
    ranges, _ = cast_rays(world, [5, 0, 0], **step)
    assert ranges[0] == np.inf
    assert ranges[1] == pytest.approx(3.0, abs=1e-14)
    ranges, _ = cast_rays(world, [-5, 0, 0], **step)  # past the open side to the far wall
    assert ranges[0] == pytest.approx(7.0, abs=1e-14)


def test_range_max_is_inclusive_and_beyond_it_is_nothing():
    world = World(walls=[[4.0, -1.0, 4.0, 1.0]])
    step = {"angle_min": 0.0, "angle_increment": 0.1, "n_beams": 1}
    assert cast_rays(world, [0, 0, 0], range_max=4.0, **step)[0][0] == 4.0
    ranges, hit_idx = cast_rays(world, [0, 0, 0], range_max=3.999, **step)
    assert ranges[0] == np.inf
    assert hit_idx[0] == -1


def test_an_empty_world_and_no_beams():
    assert np.isinf(cast_rays(World(), [0, 0, 0], **FULL)[0]).all()
    ranges, hit_idx = cast_rays(room(), [0, 0, 0], angle_min=0, angle_increment=0.1, n_beams=0)
    assert ranges.shape == hit_idx.shape == (0,)


def test_to_turn_the_sensor_is_to_shift_the_beams():
    world = build_world("office", 1)
    pose = np.array([*world.route[0], 0.0])
    n_turned = 37
    turned = np.add(pose, [0.0, 0.0, n_turned * FULL["angle_increment"]])
    ranges, hit_idx = cast_rays(world, pose, **FULL)
    ranges_turned, hit_turned = cast_rays(world, turned, **FULL)
    # directions differ by rounding alone; at the edge of a thing a beam may then pass or not
    is_same = np.roll(hit_idx, -n_turned) == hit_turned
    assert is_same.mean() > 0.98
    np.testing.assert_allclose(np.roll(ranges, -n_turned)[is_same], ranges_turned[is_same], rtol=0, atol=1e-10)


def test_to_move_world_and_sensor_together_changes_nothing():
    world = build_world("building", 2)
    pose = np.array([*world.route[4], 0.4])
    move = np.array([-31.0, 7.5, 2.2])
    ranges, hit_idx = cast_rays(world, pose, **FULL)
    ranges_moved, hit_moved = cast_rays(world.moved(move), se2.compose(move, pose), **FULL)
    is_same = hit_idx == hit_moved
    assert is_same.mean() > 0.98
    np.testing.assert_allclose(ranges[is_same], ranges_moved[is_same], rtol=0, atol=1e-10)


def test_a_mirrored_fan_sees_the_same_backwards():
    world, pose = build_world("office", 1), np.array([*build_world("office", 1).route[1], 0.2])
    forth, _ = cast_rays(world, pose, angle_min=-1.5, angle_increment=0.01, n_beams=301)
    back, _ = cast_rays(world, pose, angle_min=1.5, angle_increment=-0.01, n_beams=301)
    np.testing.assert_allclose(forth, back[::-1], rtol=0, atol=1e-10)


def test_people_occlude_and_are_named():
    world, pose = room(8.0, 6.0), np.array([0.2, -0.1, 0.3])
    people = np.array([[1.5, 0.4, 0.1], [-2.0, 1.0, 0.08], [9.0, 0.0, 0.5]])  # the last: outside
    without, _ = cast_rays(world, pose, **FULL)
    ranges, hit_idx = cast_rays(world, pose, people=people, **FULL)
    is_person = hit_idx >= world.n_primitives
    assert set(hit_idx[is_person] - world.n_primitives) == {0, 1}
    assert np.all(ranges[is_person] < without[is_person])
    assert np.array_equal(ranges[~is_person], without[~is_person])


def test_a_step_of_zero_is_refused():
    with pytest.raises(InvalidArgumentError, match="angle_increment must not be 0"):
        cast_rays(room(), [0, 0, 0], angle_min=0.0, angle_increment=0.0, n_beams=3)
