"""Deceptive scan pairs: places that look alike, scans that share nothing, things that move as the robot does.

Each deception has a name and a rule for pairs. Its truth is known, and so is whether the two scans show anything of the
same place: a matcher that answers with another pose, and does not say what it leaves open, is sure and wrong.
`python bench/deceptive.py [--pairs 100] [WORLD...]` counts how often the default matcher is.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan.configs import look_up
from curvescan.errors import InvalidArgumentError
from curvescan.matchers import DEFAULT_METHOD, match
from curvescan.paper.random_transform import SUCCESS
from curvescan.runs.document import ResultTable
from curvescan.scan import LaserScan
from curvescan.simulation.buildings.catalogue import building, office
from curvescan.simulation.buildings.rooms import columns, corridor, room
from curvescan.simulation.buildings.world import World
from curvescan.simulation.recording import as_scan, observe
from curvescan.simulation.sensing.people import PAIR, People, child, crowd
from curvescan.simulation.sensing.sensors import SENSORS, Sensor
from curvescan.types import Floats, Pose

HALF, FULL, SHORT = "sick-lms200", "spinning-360", "urg-04lx"
"""Names of the sensors: one that sees half a circle, one that sees all of it, one that sees 5.6 m far."""

_ATTEMPTS = 2000  # places tried for one pair
_SIGHT = 0.3  # least share of beams that meet something
_NOBODY: Floats = np.empty((0, 3))


@dataclass(frozen=True, eq=False, kw_only=True)
class DeceptivePair:
    """Two scans and the truth about them."""

    # the earlier and the later scan
    reference: LaserScan
    current: LaserScan
    # (3,): true pose of `current` in `reference`, metres, metres, radians; None where the scans show nothing of the
    # same place, so that every pose is wrong
    pose: Pose | None
    guess: Pose | None = None  # (3,): what the matcher is given to start from


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """Where a pair is taken: the world at each of both scans, the two sensor poses in it, and people."""

    worlds: tuple[World, World]  # tuple of two World: at the reference scan, at the current scan
    poses: Pose  # (2, 3): of the sensor, world frame, metres, metres, radians
    # tuple of two (p, 3) float64: circles [x, y, r], world frame, metres
    people: tuple[Floats, Floats] = (_NOBODY, _NOBODY)
    is_shared: bool = True  # whether the scans show anything of the same place
    is_guessed: bool = False  # whether the true pose is the matcher's guess


@dataclass(frozen=True, kw_only=True)
class Deception:
    """One kind of deceptive pair."""

    name: str  # for tables
    summary: str  # what deceives, in a sentence
    sensor: str  # name of a simulated sensor
    scene: Callable[[np.random.Generator, Sensor], Scene]  # scene of a random generator and the sensor


def deceptive_pairs(name: str, *, n_pairs: int = 500, seed: int = 0) -> Iterator[DeceptivePair]:
    """Yield pairs of one kind; pair i is the same whatever n_pairs is.

    Raises InvalidArgumentError.
    """
    kind = look_up(DECEPTIONS, name, "deception")
    sensor = SENSORS[kind.sensor]
    for i in range(n_pairs):
        root = child(seed, PAIR, i)
        scene = kind.scene(np.random.default_rng(root), sensor)
        scans = []
        for k in range(2):
            ranges, _, _ = observe(
                scene.worlds[k], scene.poses[k : k + 1], sensor, scene.people[k][np.newaxis], child(root, k)
            )
            scans.append(as_scan(ranges[0], sensor, k * sensor.period))
        pose = se2.between(scene.poses[0], scene.poses[1])
        yield DeceptivePair(
            reference=scans[0],
            current=scans[1],
            pose=pose if scene.is_shared else None,
            guess=pose if scene.is_guessed else None,
        )


def _place(world: World, rng: np.random.Generator, sensor: Sensor, clearance: float = 0.4) -> Pose:
    """Return a free pose from which enough of the world is in sight."""
    for _ in range(_ATTEMPTS):
        xy = rng.uniform(world.bounds[:2], world.bounds[2:])
        pose = np.array([*xy, rng.uniform(-math.pi, math.pi)])
        if world.is_free(xy, clearance)[0] and _sees_enough(world, pose, sensor):
            return pose
    raise InvalidArgumentError(f"no free place in {world.name!r}")


def _sees_enough(world: World, pose: Pose, sensor: Sensor) -> bool:
    _, exact, _ = observe(world, pose[np.newaxis], sensor, np.empty((1, 0, 3)), 0)
    return bool(np.mean(exact <= sensor.range_max) >= _SIGHT)


def _moved(
    world: World, start: Pose, rng: np.random.Generator, sensor: Sensor, reach: float, turn: tuple[float, float]
) -> Pose:
    """Return a free pose within `reach` metres of another, turned by an angle between the two, to either side."""
    for _ in range(_ATTEMPTS):
        radius, bearing = reach * math.sqrt(rng.random()), rng.uniform(-math.pi, math.pi)
        angle = rng.uniform(*turn) * rng.choice([-1.0, 1.0])
        motion = np.array([radius * math.cos(bearing), radius * math.sin(bearing), angle])
        pose = se2.compose(start, motion)
        if world.is_free(pose[:2], 0.25)[0] and _sees_enough(world, pose, sensor):
            return pose
    raise InvalidArgumentError(f"no free place in {world.name!r} near {start.round(2).tolist()}")


def _two(
    world: World,
    rng: np.random.Generator,
    sensor: Sensor,
    reach: float,
    turn_deg: tuple[float, float],
    start: Pose | None = None,
) -> Scene:
    """Return two scans of one world, the second moved by up to `reach` metres and turned."""
    low, high = math.radians(turn_deg[0]), math.radians(turn_deg[1])
    for _ in range(100):
        first = _place(world, rng, sensor) if start is None else start
        try:
            second = _moved(world, first, rng, sensor, reach, (low, high))
        except InvalidArgumentError:
            continue
        return Scene(worlds=(world, world), poses=np.array([first, second]))
    raise InvalidArgumentError(f"no two free places in {world.name!r}")


def _another_room(rng: np.random.Generator, sensor: Sensor) -> Scene:
    worlds = office(int(rng.integers(1 << 30))), office(int(rng.integers(1 << 30)))
    poses = np.array([_place(world, rng, sensor) for world in worlds])
    return Scene(worlds=worlds, poses=poses, is_shared=False)


def _turned_away(world_of: Callable[[np.random.Generator], World]) -> Callable[[np.random.Generator, Sensor], Scene]:
    def scene(rng: np.random.Generator, sensor: Sensor) -> Scene:
        world = world_of(rng)
        first = _place(world, rng, sensor)
        second = first + np.array([0.0, 0.0, math.pi])
        for _ in range(_ATTEMPTS):
            if _sees_enough(world, second, sensor):
                break
            first = _place(world, rng, sensor)
            second = first + np.array([0.0, 0.0, math.pi])
        return Scene(worlds=(world, world), poses=np.array([first, second]), is_shared=False)

    return scene


def _doored_corridor(rng: np.random.Generator, pitch: float = 3.0) -> World:
    """Return a corridor with niches of doors at a fixed pitch, on both sides, one width and one depth."""
    width, depth = rng.uniform(1.8, 2.4), rng.uniform(0.1, 0.25)
    offset = rng.uniform(0.0, pitch)
    at = np.arange(-18.0, 18.0, pitch)
    niches = [(x, 1.0, depth) for x in at] + [(x + offset, 1.0, -depth) for x in at]
    return corridor(44.0, width, recesses=niches)


def _plain_office(rng: np.random.Generator) -> World:
    return office(int(rng.integers(1 << 30)))


def _plain_building(rng: np.random.Generator) -> World:
    return building(int(rng.integers(1 << 30)))


def _pillars(rng: np.random.Generator, sensor: Sensor) -> Scene:
    """Return a hall too wide to see its walls, with square or round pillars every 1.5 m both ways."""
    at = np.arange(-10.5, 10.6, 1.5)
    x, y = (axis.ravel() for axis in np.meshgrid(at, at))
    if rng.random() < 0.5:
        world = columns(np.column_stack([x, y]), rng.uniform(0.1, 0.2))
    else:
        side = np.full(x.size, rng.uniform(0.2, 0.35))
        world = World(name="pillars", boxes=np.column_stack([x, y, side, side, 0.0 * side]))
    start = np.array([*rng.uniform(-1.0, 1.0, 2), rng.uniform(-math.pi, math.pi)])
    while not world.is_free(start[:2], 0.25)[0]:
        start[:2] = rng.uniform(-1.0, 1.0, 2)
    return _two(world, rng, sensor, 1.1, (0.0, 40.0), start)


def _pillared_hall(rng: np.random.Generator, sensor: Sensor) -> Scene:
    """Return a corridor 4 m wide with a pillar every 1.5 m along both walls."""
    at = np.arange(-18.0, 18.1, 1.5)
    side, y = rng.uniform(0.2, 0.4), 2.0
    pillars = [(x, k * (y - 0.5 * side), side) for x in at for k in (-1.0, 1.0)]
    world = corridor(44.0, 2.0 * y, pillars=pillars)
    start = np.array([*rng.uniform(-1.0, 1.0, 2), rng.choice([0.0, math.pi]) + rng.normal() * 0.3])
    return _two(world, rng, sensor, 1.1, (0.0, 40.0), start)


def _shelves(rng: np.random.Generator, sensor: Sensor) -> Scene:
    """Return rows of shelves 0.4 m deep every 1.2 m; the robot moves 1.1 m, about as far as from one to the next."""
    at = np.arange(-9.6, 9.7, 1.2)
    length = rng.uniform(2.0, 4.0)
    boxes = [(x, k * (0.8 + 0.5 * length), 0.4, length, 0.0) for x in at for k in (-1.0, 1.0)]
    world = World(name="shelves", boxes=np.array(boxes))
    start = np.array([rng.uniform(-0.6, 0.6), rng.uniform(-0.2, 0.2), rng.normal() * 0.2])
    way = rng.choice([-1.1, 1.1])
    second = start + np.array([way, rng.uniform(-0.1, 0.1), rng.uniform(-0.17, 0.17)])
    return Scene(worlds=(world, world), poses=np.array([start, second]))


def _elevator(rng: np.random.Generator, sensor: Sensor) -> Scene:
    """Return an elevator cabin whose open door shows one floor to the first scan, another to the second."""
    length, width, door = rng.uniform(1.4, 2.2), rng.uniform(1.3, 2.0), rng.uniform(0.8, 1.1)
    x, y, d = 0.5 * length, 0.5 * width, 0.5 * door
    walls = [[-x, -y, x, -y], [-x, y, x, y], [-x, -y, -x, y], [x, -y, x, -d], [x, d, x, y]]
    cabin = World(name="elevator", walls=np.array(walls))
    worlds = []
    for _ in range(2):
        deep, left, right = rng.uniform(1.5, 7.0), rng.uniform(0.8, 6.0), rng.uniform(0.8, 6.0)
        far = x + 0.2 + deep
        lobby = [[x + 0.2, d, x + 0.2, left], [x + 0.2, -d, x + 0.2, -right]]
        lobby += [[far, -right, far, left], [x + 0.2, left, far, left]]
        lobby += [[x + 0.2, -right, far, -right], [x, d, x + 0.2, d], [x, -d, x + 0.2, -d]]
        n = int(rng.integers(0, 4))
        places = np.column_stack([rng.uniform(x + 0.6, far, n), rng.uniform(-right, left, n)])
        worlds.append(cabin + World(walls=np.array(lobby)) + columns(places, rng.uniform(0.05, 0.3)))
    first, second = (
        np.array([*rng.uniform(-1.0, 1.0, 2) * (x - 0.4, y - 0.4), rng.uniform(-math.pi, math.pi)]) for _ in range(2)
    )
    return Scene(worlds=(worlds[0], worlds[1]), poses=np.array([first, second]))


def _doors_half_turn(rng: np.random.Generator, sensor: Sensor) -> Scene:
    world = _doored_corridor(rng)
    start = np.array([rng.uniform(-1.5, 1.5), rng.uniform(-0.3, 0.3), rng.choice([0.0, math.pi]) + 0.1 * rng.normal()])
    return _two(world, rng, sensor, 0.5, (170.0, 180.0), start)


def _doors(rng: np.random.Generator, sensor: Sensor) -> Scene:
    world = _doored_corridor(rng, rng.uniform(2.5, 4.0))
    start = np.array([rng.uniform(-1.5, 1.5), rng.uniform(-0.3, 0.3), rng.choice([0.0, math.pi]) + 0.3 * rng.normal()])
    return _two(world, rng, sensor, 1.0, (0.0, 40.0), start)


def _company(rng: np.random.Generator, sensor: Sensor) -> Scene:
    """Return a bare corridor down which four people walk with the robot: they stand still in its frame."""
    world = corridor(44.0, rng.uniform(1.8, 2.6))
    heading = rng.normal() * 0.05
    start = np.array([rng.uniform(-2.0, 2.0), rng.uniform(-0.2, 0.2), heading])
    step = np.array([rng.uniform(0.3, 0.8), 0.0, 0.0])
    people = np.column_stack([rng.uniform(0.8, 4.0, 4), rng.uniform(-0.7, 0.7, 4), rng.uniform(0.15, 0.22, 4)])
    people[:, 0] += start[0]
    later = people + [step[0], 0.0, 0.0] + rng.normal(size=(4, 3)) * [0.005, 0.005, 0.0]
    return Scene(worlds=(world, world), poses=np.array([start, start + step]), people=(people, later))


def _walkers(rng: np.random.Generator, sensor: Sensor) -> Scene:
    """Return a corridor, bare or with a door now and then, and the legs of two people in front who go their own ways."""
    doors = [(x, 1.0, rng.uniform(0.08, 0.2)) for x in np.arange(-20.0, 20.0, rng.uniform(5.0, 9.0))]
    world = corridor(44.0, rng.uniform(1.8, 2.6), recesses=doors if rng.random() < 0.5 else [])
    start = np.array([rng.uniform(-3.0, 3.0), rng.uniform(-0.3, 0.3), rng.normal() * 0.1])
    end = start + np.array([rng.uniform(0.05, 0.5), rng.normal() * 0.02, rng.normal() * 0.05])
    scenes = []
    bodies = np.column_stack([start[0] + rng.uniform(0.7, 2.5, 2), rng.uniform(-0.5, 0.5, 2)])
    steps = np.column_stack([rng.uniform(-0.3, 0.6, 2), rng.normal(size=2) * 0.05])
    for places in (bodies, bodies + steps):
        stride = rng.uniform(-0.3, 0.3, 2)
        legs = [places + np.column_stack([side * stride, np.full(2, side * 0.1)]) for side in (-1.0, 1.0)]
        scenes.append(np.column_stack([np.concatenate(legs), np.full(4, rng.uniform(0.05, 0.1))]))
    return Scene(worlds=(world, world), poses=np.array([start, end]), people=(scenes[0], scenes[1]))


def _walls_out_of_reach(rng: np.random.Generator, sensor: Sensor) -> Scene:
    """Return a wide bare hall with a door now and then: of a short laser the ends of the walls in sight are its range."""
    doors = [(x, 1.0, rng.uniform(0.08, 0.2)) for x in np.arange(-20.0, 20.0, rng.uniform(6.0, 10.0))]
    width = rng.uniform(2.0, 6.0)
    world = corridor(44.0, width, recesses=doors if rng.random() < 0.5 else [])
    start = np.array([rng.uniform(-3.0, 3.0), rng.uniform(-0.3, 0.3) * (width - 1.0), rng.normal() * 0.3])
    end = start + np.array([rng.uniform(0.05, 1.5), rng.normal() * 0.03, rng.normal() * 0.1])
    return Scene(worlds=(world, world), poses=np.array([start, end]))


def _identical_offices(rng: np.random.Generator, sensor: Sensor) -> Scene:
    """Return a row of offices with the same furniture in each; the robot moves within one of them."""
    length, depth = rng.uniform(3.0, 4.5), rng.uniform(3.5, 5.0)
    desk = (0.7, 0.25 * depth, rng.uniform(1.2, 1.6), 0.7, 0.5 * math.pi)
    shelf = (length - 0.3, 0.7 * depth, 0.4, rng.uniform(0.6, 1.2), 0.0)
    bin_ = (rng.uniform(1.2, length - 1.2), depth - 0.4, 0.3, 0.3, 0.0)
    walls, boxes = [], []
    for k in range(-3, 4):
        x = k * length
        walls += [[x, 0.0, x, depth], [x, depth, x + length, depth]]
        walls += [[x, 0.0, x + 1.2, 0.0], [x + 2.2, 0.0, x + length, 0.0]]
        boxes += [(x + b[0], *b[1:]) for b in (desk, shelf, bin_)]
    walls += [[4 * length, 0.0, 4 * length, depth], [-9 * length, -2.0, 9 * length, -2.0]]
    inside = World(
        name="identical offices",
        walls=np.array(walls),
        boxes=np.array(boxes),
        floor=np.array([[0.0, 0.0], [length, 0.0], [length, depth], [0.0, depth]]),
    )
    first = _place(inside, rng, sensor)
    while not inside.on_floor(first[:2])[0]:
        first = _place(inside, rng, sensor)
    return _two(inside, rng, sensor, 0.6, (0.0, 40.0), first)


def _small_room(rng: np.random.Generator, sensor: Sensor) -> Scene:
    return _two(room(6.0, 4.0), rng, sensor, 0.6, (0.0, 180.0))


def _bare_corridor(rng: np.random.Generator, sensor: Sensor) -> Scene:
    world = corridor(44.0, rng.uniform(1.6, 3.0))
    start = np.array([0.0, rng.uniform(-0.3, 0.3), rng.uniform(-math.pi, math.pi)])
    return _two(world, rng, sensor, 0.6, (0.0, 180.0), start)


def _empty_room_guessed(rng: np.random.Generator, sensor: Sensor) -> Scene:
    world = room(rng.uniform(4.0, 7.5), rng.uniform(3.0, 6.0))
    scene = _two(world, rng, sensor, 0.6, (70.0, 180.0))
    return Scene(worlds=scene.worlds, poses=scene.poses, is_guessed=True)


def _crowded_corridor(rng: np.random.Generator, sensor: Sensor) -> Scene:
    """Return a corridor with doors at random places, other people in each scan."""
    width, at = rng.uniform(1.8, 2.6), -18.0
    niches, side = [], 1.0
    while at < 18.0:
        at += rng.uniform(1.2, 3.5)
        side = -side if rng.random() < 0.6 else side
        niches.append((at, rng.uniform(0.85, 1.1), side * rng.uniform(0.08, 0.25)))
    right = [n for n in niches if n[2] < 0.0]
    left = [n for n in niches if n[2] > 0.0]
    world = corridor(44.0, width, recesses=[*left, *right])
    start = np.array([rng.uniform(-3.0, 3.0), rng.uniform(-0.3, 0.3), rng.choice([0.0, math.pi]) + 0.3 * rng.normal()])
    scene = _two(world, rng, sensor, 0.6, (0.0, 40.0), start)
    body = People(body_radius=0.2)
    people = tuple(crowd(world, pose, sensor, 0.15, body, rng) for pose in scene.poses)
    return Scene(worlds=scene.worlds, poses=scene.poses, people=(people[0], people[1]))


def _kinds() -> Iterator[Deception]:
    for sensor, tag in ((HALF, "180 deg"), (FULL, "360 deg")):
        yield Deception(
            name=f"another room, {tag}",
            summary="The second scan was taken in another office.",
            sensor=sensor,
            scene=_another_room,
        )
    for place, world_of in (("office", _plain_office), ("building", _plain_building), ("doors", _doored_corridor)):
        yield Deception(
            name=f"turned away, {place}",
            summary="Turned by 180 degrees on the spot, a sensor that sees half a circle shares nothing.",
            sensor=HALF,
            scene=_turned_away(world_of),
        )
    rows: tuple[tuple[str, str, str, Callable[[np.random.Generator, Sensor], Scene]], ...] = (
        ("small room", "A bare room of 6 by 4 m, any turn.", HALF, _small_room),
        ("pillars, 180 deg", "Pillars every 1.5 m, both ways.", HALF, _pillars),
        ("pillars, 360 deg", "Pillars every 1.5 m, both ways.", FULL, _pillars),
        ("pillared hall", "A pillar every 1.5 m along both walls.", HALF, _pillared_hall),
        ("shelves", "Shelves every 1.2 m, the robot moves 1.1 m.", HALF, _shelves),
        ("elevator", "The open door of a cabin shows another floor.", FULL, _elevator),
        ("elevator, 180 deg", "The open door of a cabin shows another floor.", HALF, _elevator),
        ("doors, half turn", "Doors every 3 m and a turn by 180 degrees.", FULL, _doors_half_turn),
        ("doors", "Doors at one pitch, up to 1 m and 40 degrees.", HALF, _doors),
        ("crowded corridor", "Doors at random, other people in each scan.", HALF, _crowded_corridor),
        ("company", "Four people walk with the robot, the corridor is bare.", HALF, _company),
        ("walkers", "Two people walk in front of the sensor in a corridor.", HALF, _walkers),
        ("short range", "Walls seen as far as the laser reaches.", SHORT, _walls_out_of_reach),
        ("identical offices", "The same room again and again.", HALF, _identical_offices),
        ("bare corridor", "Two walls; the heading may be half a turn off.", FULL, _bare_corridor),
        (
            "empty room, guessed",
            "A bare room, turned by more than 70 degrees; the true pose is the guess.",
            HALF,
            _empty_room_guessed,
        ),
    )
    for name, summary, sensor, scene in rows:
        yield Deception(name=name, summary=summary, sensor=sensor, scene=scene)


DECEPTIONS = {kind.name: kind for kind in _kinds()}
"""Name -> deception."""


@dataclass(frozen=True, kw_only=True)
class DeceptionScore:
    """How a matcher did in one deceptive world."""

    world: str  # name of the deception
    n_pairs: int  # how many pairs
    right: float  # share of pairs matched within 0.1 m and 2 degrees
    sure_and_wrong: float  # share matched elsewhere, without naming a degenerate direction
    flagged_and_wrong: float  # share matched elsewhere, naming one

    @property
    def unmatched(self) -> float:
        """Share of pairs with no pose."""
        return 1.0 - self.right - self.sure_and_wrong - self.flagged_and_wrong


def score_deception(
    world: str,
    *,
    method: str = DEFAULT_METHOD,
    n_pairs: int = 100,
    seed: int = 1,
    on_pair: Callable[[], None] | None = None,
) -> DeceptionScore:
    """Return how a method does in one deceptive world."""
    right = sure = flagged = 0
    for pair in deceptive_pairs(world, n_pairs=n_pairs, seed=seed):
        result = match(pair.reference, pair.current, method=method, guess=pair.guess)
        if result.ok and is_right(result.pose, pair.pose):
            right += 1
        elif result.ok and result.degenerate_direction is None:
            sure += 1
        elif result.ok:
            flagged += 1
        if on_pair:
            on_pair()
    return DeceptionScore(
        world=world,
        n_pairs=n_pairs,
        right=right / n_pairs,
        sure_and_wrong=sure / n_pairs,
        flagged_and_wrong=flagged / n_pairs,
    )


def is_right(pose: Pose, true: Pose | None) -> bool:
    """Return whether a (3,) pose lies within 0.1 m and 2 degrees of the true one; never where nothing is shared."""
    if true is None:
        return False
    x, y, theta = se2.between(true, pose)
    return bool(np.hypot(x, y) < SUCCESS[0] and abs(theta) < SUCCESS[1])


def deception_table(scores: Sequence[DeceptionScore]) -> ResultTable:
    """Return the table of the deceptive worlds, one row a world."""
    return ResultTable(
        title="Deceptive worlds, the default matcher, no guess but where the world gives one: share of pairs",
        columns=(
            "world",
            "pairs",
            "success",
            "false positives",
            "false positives with a degenerate direction",
            "no match",
        ),
        rows=[
            (
                score.world,
                f"{score.n_pairs:,}",
                f"{100 * score.right:.1f} %",
                f"{100 * score.sure_and_wrong:.1f} %",
                f"{100 * score.flagged_and_wrong:.1f} %",
                f"{100 * score.unmatched:.1f} %",
            )
            for score in scores
        ],
    )


def main() -> None:
    """Print the table of all worlds, or of those that are named."""
    parser = argparse.ArgumentParser(description="How often the default matcher is wrong in deceptive worlds.")
    parser.add_argument("worlds", nargs="*", default=list(DECEPTIONS), help=", ".join(DECEPTIONS))
    parser.add_argument("--pairs", type=int, default=100, help="pairs of each world")
    parser.add_argument("--seed", type=int, default=3)
    given = parser.parse_args()
    scores = [score_deception(world, n_pairs=given.pairs, seed=given.seed) for world in given.worlds]
    print(deception_table(scores).markdown())


if __name__ == "__main__":
    main()
