"""Where a robot drives: round the route of a world, to random places, or about a start and home again.

The drives are smooth, within the limits of :class:`Drive`, and clear of everything that stands still. Robot and
sensor frame are one.
"""

import heapq
import itertools
import math
from collections.abc import Iterator
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike

from curvescan.errors import InvalidArgumentError
from curvescan.simulation.buildings.world import World
from curvescan.simulation.driving.pursuit import Drive, at_start, follow, smooth
from curvescan.types import Bools, Floats, Points, Pose

CELL = 0.1  # side of a grid cell, metres
_COMFORT = 0.8  # metres of clearance beyond which a walk gains nothing by keeping farther away
_SHY = 3.0  # how much longer a cell without clearance counts than one with `_COMFORT`
_MOVES = tuple((i, j, float(np.hypot(i, j))) for i in (-1, 0, 1) for j in (-1, 0, 1) if i or j)


class Grid:
    """Clearance of a world on a square grid: 0 off the floor."""

    def __init__(self, world: World) -> None:
        self._origin = world.bounds[:2]
        n_columns, n_rows = np.ceil((world.bounds[2:] - self._origin) / CELL).astype(int) + 1
        rows, columns = np.mgrid[:n_rows, :n_columns]
        centres = self._centres(np.column_stack([rows.ravel(), columns.ravel()]))
        clearance = np.where(world.on_floor(centres), world.distance(centres), 0.0)
        self.clearance: Floats = clearance.reshape(n_rows, n_columns)

    def _centres(self, cells: ArrayLike) -> Points:
        rows_columns = np.asarray(cells, dtype=np.float64).reshape(-1, 2)
        return np.asarray(self._origin + CELL * rows_columns[:, ::-1])

    def reachable(self, start: ArrayLike, clearance: float) -> Points:
        """Return the (n, 2) cell centres that can be reached from a place with some clearance, metres."""
        from scipy.ndimage import label  # loaded when a robot wanders

        is_open = self.clearance >= clearance
        pieces, _ = label(is_open)  # cells that share a side belong together
        return self._centres(np.argwhere(pieces == pieces[self._nearest_open(start, is_open)]))

    def plan(self, start: ArrayLike, goal: ArrayLike, clearance: float) -> Points | None:
        """Return a walk of (n, 2) cell centres from start to goal, metres (A*; near things counts longer), or None."""
        is_open = self.clearance >= clearance
        first, last = (self._nearest_open(start, is_open), self._nearest_open(goal, is_open))
        weight = 1.0 + _SHY * np.maximum(1.0 - self.clearance / _COMFORT, 0.0)
        n_rows, n_columns = is_open.shape
        weights, opens = weight.ravel().tolist(), is_open.ravel().tolist()
        start_id, goal_id = first[0] * n_columns + first[1], last[0] * n_columns + last[1]
        cost, queue = {start_id: 0.0}, [(0.0, start_id)]
        parent: dict[int, int] = {}
        done: set[int] = set()
        while queue:
            _, here = heapq.heappop(queue)
            if here == goal_id:
                cells = [here]
                while cells[-1] in parent:
                    cells.append(parent[cells[-1]])
                return self._centres([divmod(cell, n_columns) for cell in reversed(cells)])
            if here in done:
                continue
            done.add(here)
            row, column = divmod(here, n_columns)
            for d_row, d_column, length in _MOVES:
                r, c = row + d_row, column + d_column
                there = r * n_columns + c
                if not (0 <= r < n_rows and 0 <= c < n_columns and opens[there]):
                    continue
                whole = cost[here] + length * weights[there]
                if whole < cost.get(there, np.inf):
                    cost[there], parent[there] = whole, here
                    ahead = np.hypot(r - last[0], c - last[1])
                    heapq.heappush(queue, (whole + float(ahead), there))
        return None

    def _nearest_open(self, place: ArrayLike, is_open: Bools) -> tuple[int, int]:
        cells = np.argwhere(is_open)
        if not len(cells):
            raise InvalidArgumentError("the world has no free place for a robot: it is too small or too full")
        offsets = self._centres(cells) - np.asarray(place, dtype=np.float64)
        row, column = cells[np.argmin(np.sum(offsets**2, axis=1))].tolist()
        return row, column


@lru_cache(maxsize=8)
def grid_of(world: World) -> Grid:
    """Return the grid of a world; the last few are kept."""
    return Grid(world)


_STEP = 0.05  # seconds between two control steps, at most
_HOME_RADIUS = 1.0  # metres: how far the small moves about a start lead
_NEAR_ROUTE = 2.0  # metres: by so much a drive about a start may lie beside the corners of the route


def drive_route(
    world: World, drive: Drive, period: float, rng: np.random.Generator, n_poses: int | None = None
) -> Pose:
    """Return the (n, 3) poses of a drive round the world's route, or to random places in a world without one.

    n_poses: how many, over as many laps as it takes; fewer are the first of more. None: one lap of the route.
    """
    if len(world.route) > 1:
        lap = _lap(world, drive)
        legs = iter([lap]) if n_poses is None else itertools.repeat(lap)
    elif n_poses is None:
        raise InvalidArgumentError(f"{world.name!r} has no route to make a lap of: give n_scans")
    else:
        legs = _wander(world, drive, rng, _roomiest(world, rng), np.inf)
    poses: list[Floats] = []
    n_steps, step = _steps(period)
    state, n_states = None, 0
    for leg in legs:
        state = at_start(leg) if state is None else state
        for after in follow(leg, state, drive, step):
            if n_states % n_steps == 0:
                poses.append(after[:3])
                if len(poses) == n_poses:
                    return np.array(poses)
            n_states += 1
            state = after
    return np.array(poses).reshape(-1, 3)


def drive_home(world: World, drive: Drive, period: float, rng: np.random.Generator, n_poses: int) -> Pose:
    """Return the (n_poses, 3) poses of small moves about a start (the paper's second experiment).

    The robot comes to rest within some centimetres of the start, with any heading, unless the poses are too few.
    """
    n_steps, step = _steps(period)
    start = _roomiest(world, rng)
    states: list[Floats] = []
    # twice the time for a straight way home and a turn on the spot
    margin = int(2.0 * (2.0 * _HOME_RADIUS / drive.speed + np.pi / drive.turn_rate + 2.0) / step)
    n_states = (n_poses - 1) * n_steps + 1
    for leg in _wander(world, drive, rng, start, _HOME_RADIUS):
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
    return np.array(states[::n_steps])[:, :3]


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
    """Return the (2,) random place, near the route if any, that is farthest from everything."""
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
