"""People: where they walk, what they show, how much of the view they take."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan.errors import InvalidArgumentError
from curvescan.simulation import SENSORS, People, World, build_world
from curvescan.simulation.sensing.people import circles_of, crowd, walk
from curvescan.simulation.sensing.sensors import cast_beams

SICK = SENSORS["sick-lms200"]
WORLD = build_world("room")
LEGS = People()
ROBOT = np.tile([0.5, 0.2, 0.3], (80, 1))


def walked(n_people=3, robot=ROBOT, people=LEGS, seed=1, world=WORLD):
    return walk(world, robot, n_people, people, 0.2, np.random.SeedSequence(seed))


def bodies(circles):
    """Middle between the two legs of each walker: (n, p, 2)."""
    half = circles.shape[1] // 2
    return 0.5 * (circles[:, :half, :2] + circles[:, half:, :2])


def test_walkers_stay_clear_of_the_walls_and_of_the_robot():
    circles = walked()
    assert circles.shape == (80, 6, 3)
    places = bodies(circles).reshape(-1, 2)
    assert WORLD.is_free(places, 0.35 - 1e-9).all()
    assert np.hypot(*(places - ROBOT[0, :2]).T).min() >= 0.5
    legs = circles.reshape(-1, 3)
    assert np.all(WORLD.distance(legs[:, :2]) > 0.0)


def test_walkers_walk_at_a_plausible_speed():
    step = np.diff(bodies(walked(n_people=5)), axis=0)
    speed = np.hypot(step[..., 0], step[..., 1]) / 0.2
    assert speed.max() <= 1.5 + 1e-9
    assert np.median(speed) >= 0.4


def test_the_same_seed_gives_the_same_walk_and_fewer_scans_its_beginning():
    assert np.array_equal(walked(), walked())
    assert np.array_equal(walked(robot=ROBOT[:30]), walked()[:30])
    assert not np.array_equal(walked(seed=2), walked())


def test_walkers_make_way_for_a_robot_that_drives_at_them():
    x = np.linspace(-3.0, 3.0, 60)
    robot = np.column_stack([x, np.zeros(60), np.zeros(60)])
    circles = walked(n_people=8, robot=robot)
    gap = np.linalg.norm(bodies(circles) - robot[:, np.newaxis, :2], axis=-1)
    assert gap.min() >= 0.5


def test_where_there_is_no_room_nobody_is_seen():
    crammed = walked(2, np.zeros((2, 3)), world=World(walls=[[-0.3, -0.3, 0.3, 0.3]]))
    assert np.all(np.abs(crammed[..., :2]) > 1e5)


def test_two_legs_or_one_body():
    place, heading, phase = np.array([[1.0, 2.0]]), np.array([0.0]), np.array([0.5 * np.pi])
    legs = circles_of(place, heading, phase, People())
    np.testing.assert_allclose(legs, [[1.25, 2.1, 0.07], [0.75, 1.9, 0.07]], atol=1e-12)
    body = circles_of(place, heading, phase, People(body_radius=0.2))
    assert body.tolist() == [[1.0, 2.0, 0.2]]
    assert walked(people=People(body_radius=0.2)).shape == (80, 3, 3)
    assert walked(n_people=0).shape == (80, 0, 3)


@pytest.mark.parametrize("share", [0.05, 0.15, 0.3])
def test_a_crowd_takes_about_the_wanted_share_of_the_view(share):
    pose, rng = np.array([-2.0, 0.5, 0.1]), np.random.default_rng(3)
    shares = []
    for _ in range(8):
        circles = crowd(WORLD, pose, SICK, share, People(), rng)
        _, hit_idx = cast_beams(WORLD, pose, SICK, range_max=np.inf, people=circles)
        shares.append(np.mean(hit_idx >= WORLD.n_primitives))
    # one more leg nearby is 0.05 of the view: half of it either way, and less on average
    assert np.mean(shares) == pytest.approx(share, abs=0.025)
    assert np.max(np.abs(np.array(shares) - share)) < 0.06


def test_nobody_stands_on_the_sensor():
    people = People(body_radius=1.5)
    circles = crowd(WORLD, ROBOT[0], SICK, 0.5, people, np.random.default_rng(0))
    assert len(circles)
    assert np.all(np.hypot(*(circles[:, :2] - ROBOT[0, :2]).T) > 1.5)


def test_no_share_is_nobody():
    assert crowd(WORLD, ROBOT[0], SICK, 0.0, People(), np.random.default_rng(0)).shape == (0, 3)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"leg_radius": 0.0}, "leg_radius and hip_width must be > 0"),
        ({"body_radius": -1.0}, "body_radius must be > 0, got -1"),
        ({"speed_min": 2.0}, "0 < min <= max"),
    ],
)
def test_impossible_people_are_refused(bad, message):
    with pytest.raises(InvalidArgumentError, match=message):
        People(**bad)
