"""People who walk through a world, and the child seeds that keep one random thing from shifting another.

A walker holds a heading for a while, turns at random and away from what is in the way, and steps aside for the robot.
One that the robot would run over, or that falls far behind, appears elsewhere, as if through a door.
"""

from dataclasses import dataclass

import numpy as np

from curvescan.errors import require
from curvescan.simulation.buildings.world import World
from curvescan.simulation.sensing.sensors import Sensor, cast_beams
from curvescan.types import Floats, Points, Pose

WORLD, PATH, NOISE, PEOPLE, ODOMETRY, PAIR = range(6)
"""The purposes. Their numbers are part of the simulated data: never renumber, only add."""


def child(seed: int | np.random.SeedSequence, *key: int) -> np.random.SeedSequence:
    """Return the seed of one purpose (and index): a function of the root seed and the key alone."""
    if isinstance(seed, np.random.SeedSequence):
        return np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, *key))
    is_seed = isinstance(seed, int | np.integer) and not isinstance(seed, bool) and seed >= 0
    require(is_seed, "seed must be an integer >= 0", seed)
    return np.random.SeedSequence(int(seed), spawn_key=key)


_STEP_LENGTH = 0.7  # metres from one footfall to the next
_SWING = 0.25  # metres a shin swings before and behind the body
_BODY = 0.35  # metres a walker keeps from things
_KEEP_OFF = 0.7  # metres at which a walker turns away from the robot
_TOO_NEAR = 0.5  # metres at which a walker is taken away
_TOO_FAR = 8.0  # metres from the robot beyond which a walker is taken away
_CROWD_ATTEMPTS = 80  # places tried for the people around one scan


@dataclass(frozen=True, kw_only=True)
class People:
    """What walkers look like and how they walk."""

    leg_radius: float = 0.07  # metres; each walker shows two legs, unless `body_radius` is given
    hip_width: float = 0.2  # distance between the legs across the walking direction, metres
    # radius of the one circle a walker shows to a sensor at body height, metres; None: two legs
    body_radius: float | None = None
    # each walker's speed is drawn between them, m/s
    speed_min: float = 0.5
    speed_max: float = 1.5

    def __post_init__(self) -> None:
        require(self.leg_radius > 0.0 and self.hip_width > 0.0, "leg_radius and hip_width must be > 0", self)
        require(self.body_radius is None or self.body_radius > 0.0, "body_radius must be > 0", self.body_radius)
        require(0.0 < self.speed_min <= self.speed_max, "speeds must satisfy 0 < min <= max", self)


def circles_of(places: Points, headings: Floats, phases: Floats, people: People) -> Floats:
    """Return the circles that walkers show. places (p, 2); headings (p,); phases (p,); result (2 p, 3)."""
    if people.body_radius is not None:
        return np.column_stack([places, np.full(len(places), people.body_radius)])
    ahead = np.column_stack([np.cos(headings), np.sin(headings)])
    side = 0.5 * people.hip_width * np.column_stack([-ahead[:, 1], ahead[:, 0]])
    swing = _SWING * np.sin(phases)[:, np.newaxis] * ahead
    legs = np.vstack([places + side + swing, places - side - swing])
    return np.column_stack([legs, np.full(len(legs), people.leg_radius)])


def walk(
    world: World, robot: Pose, n_people: int, people: People, period: float, seed: np.random.SeedSequence
) -> Floats:
    """Return the circles that walkers show at each scan. robot (n, 3); result (n, c, 3)."""
    rng = np.random.default_rng(seed)
    n_steps = max(int(np.ceil(period / 0.1)), 1)
    step = period / n_steps
    speeds = rng.uniform(people.speed_min, people.speed_max, n_people)
    headings, phases = rng.uniform(-np.pi, np.pi, (2, n_people))
    places = np.full((n_people, 2), np.inf)
    frames = []
    for pose in robot:
        at = pose[:2]
        for _ in range(n_steps):
            headings = headings + rng.normal(0.0, 0.6 * np.sqrt(step), n_people)
            turns = rng.uniform(0.5, np.pi, n_people) * rng.choice([-1.0, 1.0], n_people)
            ahead = np.column_stack([np.cos(headings), np.sin(headings)])
            moved = places + (speeds * step)[:, np.newaxis] * ahead
            nearer = (_gap(moved, at) < _KEEP_OFF) & (_gap(moved, at) < _gap(places, at))
            is_blocked = nearer | ~np.isfinite(moved).all(axis=1)  # those who are nowhere yet
            is_blocked[~is_blocked] = ~world.is_free(moved[~is_blocked], _BODY)
            places = np.where(is_blocked[:, np.newaxis], places, moved)
            headings = np.where(is_blocked, headings + turns, headings)
            phases = phases + np.where(is_blocked, 0.0, np.pi * speeds * step / _STEP_LENGTH)
        gap = _gap(places, at)
        for i in np.flatnonzero((gap < _TOO_NEAR) | ~(gap < _TOO_FAR)):
            places[i] = _elsewhere(world, at, rng)
        frames.append(circles_of(places, headings, phases, people))
    n_circles = n_people if people.body_radius is not None else 2 * n_people
    return np.array(frames).reshape(len(robot), n_circles, 3)


def _gap(places: Points, at: Floats) -> Floats:
    return np.asarray(np.hypot(places[:, 0] - at[0], places[:, 1] - at[1]))


def _elsewhere(world: World, at: Floats, rng: np.random.Generator) -> Floats:
    """Return a free place 1.5 to 6 m from the robot, (2,) metres; none found: far away, out of sight."""
    bearing, distance = rng.uniform(-np.pi, np.pi, 30), rng.uniform(1.5, 6.0, 30)
    places = at + distance[:, np.newaxis] * np.column_stack([np.cos(bearing), np.sin(bearing)])
    is_free = world.is_free(places, _BODY)
    return places[int(np.argmax(is_free))] if is_free.any() else np.array([1e6, 1e6])


def crowd(world: World, pose: Pose, sensor: Sensor, share: float, people: People, rng: np.random.Generator) -> Floats:
    """Return (c, 3) circles of people around a sensor so that about a wanted share of its beams meets them."""
    circles, reached = np.empty((0, 3)), 0.0
    for _ in range(_CROWD_ATTEMPTS if share > 0.0 else 0):
        bearing = pose[2] + sensor.angle_min + rng.random() * sensor.n_beams * sensor.angle_increment
        distance, heading, phase = rng.uniform(0.7, 4.0), *rng.uniform(-np.pi, np.pi, 2)
        place = pose[:2] + distance * np.array([np.cos(bearing), np.sin(bearing)])
        if not world.is_free(place, _BODY)[0]:
            continue
        one = circles_of(place[np.newaxis], np.array([heading]), np.array([phase]), people)
        if np.any(_gap(one[:, :2], pose) < one[:, 2] + 0.1):
            continue
        more = np.vstack([circles, one])
        _, hit_idx = cast_beams(world, pose, sensor, people=more)
        new = float(np.mean(hit_idx >= world.n_primitives))
        if new > reached and abs(new - share) < abs(reached - share):
            circles, reached = more, new
        if reached >= share - 0.01:
            break
    return circles
