"""Where a robot drives: round the route of a world, to random places, or about a start and home again.

The drives are smooth, within the limits of :class:`Drive`, and clear of everything that stands still. Robot and
sensor frame are one.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator

import numpy as np

from curvescan.errors import InvalidArgumentError
from curvescan.simulation.buildings.world import World
from curvescan.simulation.driving.planning import grid_of
from curvescan.simulation.driving.pursuit import Drive, at_start, follow, smooth
from curvescan.types import Floats, Points, Pose

_STEP = 0.05  # seconds between two control steps, at most
_NEAR_ROUTE = 2.0  # metres: by so much a drive about a start may lie beside the corners of the route


def drive_route(
    world: World, drive: Drive, period: float, rng: np.random.Generator, n_poses: int | None = None
) -> Pose:
    """Return the poses of a drive round the world's route, or to random places in a world without one.

    n_poses: How many poses, over as many laps as it takes; fewer poses are the first of more. None: one lap of the
    route; result (n, 3). Raises InvalidArgumentError.
    """
    if len(world.route) > 1:
        lap = _lap(world, drive)
        legs = iter([lap]) if n_poses is None else itertools.repeat(lap)
    elif n_poses is None:
        raise InvalidArgumentError(f"{world.name!r} has no route to make a lap of: give n_scans")
    else:
        start = _roomiest(world, rng)
        legs = _wander(world, drive, rng, start, np.inf)
    poses: list[Floats] = []
    n_steps, step = _steps(period)
    state, n_states = None, 0
    for leg in legs:
        state = at_start(leg) if state is None else state
        for after in follow(leg, state, drive, step):
            if n_states % n_steps == 0:
                poses.append(after[:3])
                if len(poses) == n_poses:
                    return _as_poses(poses)
            n_states += 1
            state = after
    return _as_poses(poses)


def drive_home(
    world: World, drive: Drive, period: float, rng: np.random.Generator, n_poses: int, radius: float
) -> Pose:
    """Return the poses of small moves about a start that end near it, where the robot stops.

    The paper's second experiment. The robot comes to rest within some centimetres of the first pose, with any
    heading; with too few poses for the way home it ends on the way.

    result (n_poses, 3).
    """
    n_steps, step = _steps(period)
    start = _roomiest(world, rng)
    states: list[Floats] = []
    wander = _wander(world, drive, rng, start, radius)
    # twice the time for a straight way home and a turn on the spot
    margin = int(2.0 * (2.0 * radius / drive.speed + np.pi / drive.turn_rate + 2.0) / step)
    n_states = (n_poses - 1) * n_steps + 1
    for leg in wander:
        state = states[-1] if states else at_start(leg)
        states += follow(leg, state, drive, step)
        if len(states) > n_states - margin:
            break
    states = states[: max(n_states - margin, 1)]
    way = grid_of(world).plan(states[-1][:2], start, drive.clearance)
    if way is not None:
        states += follow(smooth(way), states[-1], drive, step)
    states = states[:n_states]
    rest = states[-1] * [1.0, 1.0, 1.0, 0.0, 0.0]
    states += [rest] * (n_states - len(states))
    return _as_poses([state[:3] for state in states[::n_steps]])


def _lap(world: World, drive: Drive) -> Points:
    """Return one round of the route as a smooth line; places that cannot be reached are left out."""
    grid = grid_of(world)
    walks: list[Points] = []
    here = world.route[0]
    for goal in [*world.route[1:], world.route[0]]:
        walk = grid.plan(here, goal, drive.clearance)
        if walk is not None and len(walk) > 1:
            walks.append(walk[1:] if walks else walk)
            here = goal
    if not walks:
        raise InvalidArgumentError(
            f"no way along the route of {world.name!r} leaves a clearance of {drive.clearance} m"
        )
    return smooth(np.vstack(walks))


def _wander(world: World, drive: Drive, rng: np.random.Generator, start: Floats, radius: float) -> Iterator[Points]:
    """Yield walks between random reachable places within `radius` metres of a start, for ever."""
    grid = grid_of(world)
    places = grid.reachable(start, drive.clearance)
    offsets = places - start
    places = places[np.hypot(offsets[:, 0], offsets[:, 1]) <= radius]
    if len(places) < 10:
        raise InvalidArgumentError(f"a robot that keeps {drive.clearance} m clear has nowhere to go in {world.name!r}")
    here = start
    while True:
        goal = places[int(rng.integers(len(places)))]
        walk = grid.plan(here, goal, drive.clearance)
        if walk is not None and len(walk) > 2:
            yield smooth(walk)
            here = goal


def _roomiest(world: World, rng: np.random.Generator) -> Floats:
    """Return the (2,) place, of some random ones (near the route, if any), that is farthest from everything.

    A route leaves out what a laser cannot see its way in, as the round room of "office-floor".
    """
    places = rng.uniform(world.bounds[:2], world.bounds[2:], (64, 2))
    if len(world.route) > 1:
        from_route = np.linalg.norm(places[:, None] - world.route[None], axis=2).min(axis=1)
        is_near = from_route < _NEAR_ROUTE
        places = places[is_near] if is_near.any() else places
    distance = np.where(world.on_floor(places), world.distance(places), -1.0)
    return np.asarray(places[int(np.argmax(distance))])


def _steps(period: float) -> tuple[int, float]:
    n_steps = max(math.ceil(period / _STEP - 1e-9), 1)
    return n_steps, period / n_steps


def _as_poses(rows: list[Floats]) -> Pose:
    return np.array(rows).reshape(-1, 3)
