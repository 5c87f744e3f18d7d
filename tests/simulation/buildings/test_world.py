"""World: distances and freedom against a dense sampling of its own outline, moves, sums, bad input."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan import se2
from curvescan.errors import InvalidArgumentError
from curvescan.simulation import World, build_world
from curvescan.simulation.buildings.rooms import columns, corridor, room, round_room
from curvescan.simulation.buildings.world import full_circles

MIXED = World(
    name="mixed",
    walls=[[-4.0, -3.0, 5.0, -2.0], [1.0, 1.0, 1.0, 1.0]],  # the second is but a point
    boxes=[[-2.0, 1.0, 1.0, 0.4, 0.6]],
    circles=[[2.0, 2.0, 0.7]],
    arcs=[[0.0, 0.0, 5.0, 1.0, 2.0], [1.0, -6.0, 2.0, -3.0, 2.0 * np.pi]],
)


def outline(world: World) -> np.ndarray:
    """Points some 2 mm apart on every primitive."""
    share = np.linspace(0.0, 1.0, 5001)[:, np.newaxis]
    parts = [s[:2] + share * (s[2:] - s[:2]) for s in world.segments]
    for x, y, r, start, extent in [*[(*c, 0.0, 2 * np.pi) for c in world.circles], *world.arcs]:
        angles = start + extent * share[:, 0]
        parts.append(np.column_stack([x + r * np.cos(angles), y + r * np.sin(angles)]))
    return np.vstack(parts)


def test_distance_agrees_with_a_sampled_outline():
    points = np.random.default_rng(0).uniform(-7.0, 7.0, (60, 2))
    sampled = np.array([np.hypot(*(outline(MIXED) - p).T).min() for p in points])
    distance = MIXED.distance(points)
    is_inside = distance == 0.0
    # samples lie within 6 mm of each other (an arc of 5 m over 5000 steps is the coarsest)
    np.testing.assert_allclose(distance[~is_inside], sampled[~is_inside], rtol=0, atol=2e-3)


def test_distance_does_not_depend_on_how_many_points_are_asked_at_once():
    points = np.random.default_rng(1).uniform(-7.0, 7.0, (5000, 2))
    assert np.array_equal(MIXED.distance(points)[4990:], MIXED.distance(points[4990:]))


def test_inside_of_solids_is_not_free():
    assert np.array_equal(MIXED.distance([[-2.0, 1.0], [2.0, 2.3]]), [0.0, 0.0])
    assert not MIXED.is_free([[-2.0, 1.0], [2.0, 2.3]]).any()


def test_clearance_is_kept():
    world = room(8.0, 6.0) + columns([[1.0, 0.0]], radius=0.25)
    points = [[0.0, 0.0], [0.3, 0.0], [3.6, 0.0], [3.4, 0.0], [5.0, 0.0]]
    assert world.is_free(points, 0.5).tolist() == [True, False, False, True, False]


def test_the_floor_bounds_what_is_free():
    assert build_world("l-hall").on_floor([[1.0, 9.0], [9.0, 1.0], [9.0, 9.0]]).tolist() == [True, True, False]
    assert corridor().is_free([[0.0, 0.0], [16.0, 0.0]]).tolist() == [True, False]
    assert round_room(4.0).is_free([[2.7, 2.7], [3.0, 3.0]]).tolist() == [True, False]
    assert World(walls=[[0, 0, 1, 1]]).on_floor([[0.5, 0.2], [1.5, 0.2]]).tolist() == [True, False]


def test_an_empty_world_is_far_from_everything():
    assert np.array_equal(World().distance([[0.0, 0.0]]), [np.inf])
    assert np.array_equal(World().bounds, np.zeros(4))


def test_a_sum_has_the_things_of_both_and_the_name_of_the_first():
    both = room() + MIXED
    assert both.name == "room"
    assert both.n_primitives == room().n_primitives + MIXED.n_primitives
    assert np.array_equal(both.floor, room().floor)
    assert np.array_equal((World() + corridor()).route, corridor().route)
    assert room().n_primitives == 4  # the parts are as they were


def test_a_moved_world_keeps_its_distances():
    pose = np.array([3.0, -1.0, 2.5])
    points = np.random.default_rng(2).uniform(-6.0, 6.0, (50, 2))
    moved = MIXED.moved(pose)
    np.testing.assert_allclose(moved.distance(se2.transform(pose, points)), MIXED.distance(points), rtol=0, atol=1e-12)
    route = corridor().moved(pose).route
    np.testing.assert_allclose(route, se2.transform(pose, corridor().route), atol=1e-12)


def test_bounds_hold_everything():
    low, high = MIXED.bounds[:2], MIXED.bounds[2:]
    points = outline(MIXED)
    assert np.all(points >= low - 1e-9)
    assert np.all(points <= high + 1e-9)


def test_arrays_are_read_only():
    with pytest.raises(ValueError, match="read-only"):
        room().walls[0, 0] = 1.0


def test_full_circles_pass_every_direction():
    assert np.array_equal(full_circles(np.array([[1.0, 2.0, 3.0]])), [[1, 2, 3, 1, 0, -1]])


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"walls": [[0, 0, 1]]}, r"walls must have shape \(n, 4\), got \(1, 3\)"),
        ({"circles": [1.0, 2.0, 3.0]}, r"circles must have shape \(n, 3\), got \(3,\)"),
        ({"walls": [[0, 0, 1, np.nan]]}, "walls must be finite"),
        ({"circles": [[0, 0, 0]]}, "circle radii must be > 0, got 0"),
        ({"boxes": [[0, 0, 1, -1, 0]]}, "box sides must be > 0, got -1"),
        ({"arcs": [[0, 0, 1, 0, 7.0]]}, "arc extents must be at most 2 pi, got 7"),
    ],
)
def test_bad_shapes_and_sizes_are_refused(bad, message):
    with pytest.raises(InvalidArgumentError, match=message):
        World(**bad)
