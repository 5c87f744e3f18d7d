"""Matchers on thousands of simulated pairs, scenario by scenario: how far the motion, how many people, which sensor.

The Cramér-Rao bound of a pair of scans: no unbiased matcher can do better on them.

A. Censi, "On achievable accuracy for range-finder localization", ICRA 2007: the information that a beam holds on the
pose is the square of how its range changes with the pose, over the noise. There the map is known; here it is the
other scan, as noisy as the first, so that each beam that both scans can compare carries the noise twice.
"""

import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeAlias

import numpy as np

from curvescan import se2
from curvescan.matchers import MatchResult, match
from curvescan.paper.random_transform import is_success
from curvescan.simulation import SENSORS, ScanPair, Sensor, World, simulate_pairs
from curvescan.simulation.sensing.sensors import cast_beams
from curvescan.types import Bools, Cov, Floats, Ints, Points, Pose

OnPair: TypeAlias = Callable[[], object]  # called after each pair

_CHI2_95 = 7.815  # 95 % of a chi-square of three degrees of freedom


class Scenario(NamedTuple):
    """One kind of pair."""

    name: str  # for tables
    sensor: str  # name of a simulated sensor
    # motion, uniform within: metres, degrees
    translation_max: float
    rotation_max_deg: float
    people_share: float = 0.0  # share of the beams on people who differ between the scans


_SIZES = {"small": (0.1, 5.0), "medium": (0.3, 15.0), "large": (0.6, 40.0)}
_PEOPLE = 0.15

SCENARIOS = (
    *(Scenario(name, "sick-lms200", *size) for name, size in _SIZES.items()),
    *(Scenario(f"{name}, people", "sick-lms200", *size, _PEOPLE) for name, size in _SIZES.items()),
    Scenario("360 deg, small", "spinning-360", *_SIZES["small"]),
    Scenario("360 deg, large, people", "spinning-360", *_SIZES["large"], _PEOPLE),
    Scenario("270 deg, small", "hokuyo-270", *_SIZES["small"]),
    Scenario("270 deg, large, people", "hokuyo-270", *_SIZES["large"], _PEOPLE),
    Scenario("360 deg, any turn", "spinning-360", 0.3, 180.0),
)


@dataclass(frozen=True, kw_only=True)
class Score:
    """How one method did on pairs of one scenario, or in a world where a direction of the pose is unobservable."""

    # names
    method: str
    scenario: str
    # share of the pairs with a pose, and of these the share that names its degenerate direction
    ok: float
    flagged: float
    success: float  # share of pairs matched within 0.1 m and 2 degrees
    false_positives: float  # share of pairs that are ``ok`` and not within
    # the same without those that name a degenerate direction, along which their covariance is wide
    unflagged_false_positives: float
    # median translation error of the matches, and what the Cramér-Rao bound allows, metres
    median_error: float
    bound: float
    # normalised estimation error squared, mean and median, of right matches, where a direction is open of all: 3 when
    # the covariance is right. A motion along an arc is linear to first order only: a few large ones decide the mean
    nees: float
    nees_median: float
    inside_95: float  # share of these inside the 95 % ellipsoid of their covariance


def score_scenario(
    scenario: Scenario, methods: Sequence[str], *, n_pairs: int = 300, seed: int = 1, on_pair: OnPair = lambda: None
) -> list[Score]:
    """Return how each method does on the same pairs of one scenario, each pair in a fresh office, without a guess."""
    sensor = SENSORS[scenario.sensor]
    pairs = simulate_pairs(
        "office",
        sensor=sensor,
        n_pairs=n_pairs,
        translation_max=scenario.translation_max,
        rotation_max=np.radians(scenario.rotation_max_deg),
        people_share=scenario.people_share,
        seed=seed,
    )
    tried = _tried(pairs, methods, on_pair)
    bound = median_error([pair_bound(one.pair, sensor) for one in tried[methods[0]]])
    return [_score(method, scenario.name, tried[method], bound) for method in methods]


OPEN_WORLDS = ("bare-corridor", "round-room")
"""Simulated worlds that leave a motion open: along the corridor, around the room."""


def score_open(
    world: str, methods: Sequence[str], *, n_pairs: int = 300, seed: int = 1, on_pair: OnPair = lambda: None
) -> list[Score]:
    """Return how each method does on small motions (0.1 m, 5 degrees) in a world that leaves one open."""
    pairs = simulate_pairs(world, n_pairs=n_pairs, translation_max=0.1, rotation_max=np.radians(5.0), seed=seed)
    pairs = replace(pairs, sight_share=0.3)
    tried = _tried(pairs, methods, on_pair)
    return [_score(method, world, tried[method]) for method in methods]


def _tried(pairs: Iterable[ScanPair], methods: Sequence[str], on_pair: OnPair) -> "dict[str, list[_Try]]":
    """Return what each method makes of each pair."""
    tried: dict[str, list[_Try]] = {method: [] for method in methods}
    for pair in pairs:
        for method in methods:
            result = match(pair.reference, pair.current, method=method)
            tried[method].append(_Try(pair=pair, result=result))
        on_pair()
    return tried


@dataclass(frozen=True, eq=False, kw_only=True)
class _Try:
    pair: ScanPair
    result: MatchResult

    @property
    def error(self) -> Floats:
        """(3,) pose found minus true pose; NaN without a pose."""
        difference = self.result.pose - self.pair.pose
        return np.array([difference[0], difference[1], float(se2.wrap(difference[2]))])

    @property
    def nees(self) -> float:
        return float(self.error @ np.linalg.solve(self.result.covariance, self.error))

    @property
    def is_right(self) -> bool:
        return self.result.ok and bool(is_success(self.error))


def _score(method: str, scenario: str, tries: list[_Try], bound: float | None = None) -> Score:
    """Return the score of a method; without a bound a direction is open, and all matches are judged."""
    matched = [one for one in tries if one.result.ok]
    right = [one for one in matched if one.is_right]
    unflagged = [one for one in matched if one.result.degenerate_direction is None]
    distances = np.array([np.hypot(*one.error[:2]) for one in matched])
    nees = np.array([one.nees for one in (matched if bound is None else right)])
    return Score(
        method=method,
        scenario=scenario,
        ok=len(matched) / len(tries),
        flagged=(len(matched) - len(unflagged)) / len(matched) if matched else math.nan,
        success=len(right) / len(tries),
        false_positives=(len(matched) - len(right)) / len(tries),
        unflagged_false_positives=sum(not one.is_right for one in unflagged) / len(tries),
        median_error=float(np.median(distances)) if matched else math.nan,
        bound=math.nan if bound is None else bound,
        nees=float(nees.mean()) if nees.size else math.nan,
        nees_median=float(np.median(nees)) if nees.size else math.nan,
        inside_95=float(np.mean(nees < _CHI2_95)) if nees.size else math.nan,
    )


_SAME_SURFACE = 0.05  # two readings this near to one another, metres, are of one surface


def range_gradient(world: World, pose: Pose, sensor: Sensor) -> tuple[Floats, Floats]:
    """Return the (n,) exact ranges of a sweep, inf for none, and their (n, 3) change with the sensor's pose."""
    ranges, hit_idx = cast_beams(world, pose, sensor)
    angles = sensor.angle_min + sensor.angle_increment * np.arange(sensor.n_beams)
    beams = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        normals = _normals(world, pose, ranges[:, np.newaxis] * beams, hit_idx)
        along = np.sum(normals * beams, axis=1)
        across = normals[:, 1] * beams[:, 0] - normals[:, 0] * beams[:, 1]
        gradient = -np.column_stack([normals, ranges * across]) / along[:, np.newaxis]
    gradient[hit_idx < 0] = np.nan
    return ranges, gradient


def pair_bound(pair: ScanPair, sensor: Sensor) -> Cov:
    """Return the least (3, 3) covariance that an unbiased estimate of a pair's pose can have, by shared surfaces."""
    poses = (pair.reference_pose, se2.compose(pair.reference_pose, pair.pose))
    usable = (pair.reference.valid & ~pair.is_person_ref, pair.current.valid & ~pair.is_person_cur)
    swept = [range_gradient(pair.world, pose, sensor) for pose in poses]
    information = np.zeros((3, 3))
    for own, other in ((0, 1), (1, 0)):
        ranges, gradient = swept[own]
        counts = usable[own] & ~np.isnan(gradient).any(axis=1)
        counts &= _is_seen(ranges, se2.between(poses[other], poses[own]), swept[other][0], usable[other], sensor)
        seen = gradient[counts]
        half = 0.5 * seen.T @ seen / (2.0 * sensor.sigma_range**2)
        if own == 0:
            # moving the reference by d moves the current scan, seen from it, by -d brought into its frame
            change = _adjoint(se2.inverse(pair.pose))
            back = np.linalg.inv(change)
            half = back.T @ half @ back
        information += half
    if np.linalg.eigvalsh(information)[0] <= 1e-6 * np.trace(information):
        return np.full((3, 3), np.nan)
    turn = _adjoint(pair.pose * [0.0, 0.0, 1.0])
    return np.asarray(turn @ np.linalg.inv(information) @ turn.T)


def median_error(bounds: list[Cov], *, seed: int = 0) -> float:
    """Return the median translation error of matches at their bounds (one a pair, NaN ones left out), metres."""
    rng = np.random.default_rng(seed)
    errors = [
        np.hypot(*rng.multivariate_normal(np.zeros(2), bound[:2, :2], 200, method="cholesky").T)
        for bound in bounds
        if np.isfinite(bound).all()
    ]
    return float(np.median(errors)) if errors else math.nan


def _normals(world: World, pose: Pose, points: Points, hit_idx: Ints) -> Points:
    """Return the unit normal, in the sensor frame, of the surface at each point that is hit."""
    segments, curves = world.segments, world.curves
    straight = np.stack([segments[:, 1] - segments[:, 3], segments[:, 2] - segments[:, 0]], axis=1)
    is_straight = (hit_idx >= 0) & (hit_idx < len(segments))
    is_curved = hit_idx >= len(segments)
    normals = np.full_like(points, np.nan)
    normals[is_straight] = straight[hit_idx[is_straight]] @ se2.rotation(-pose[2]).T
    centres = se2.transform(se2.inverse(pose), curves[hit_idx[is_curved] - len(segments), :2])
    normals[is_curved] = points[is_curved] - centres
    return np.asarray(normals / np.hypot(normals[:, 0], normals[:, 1])[:, np.newaxis])


def _is_seen(ranges: Floats, pose: Pose, other_ranges: Floats, other_usable: Bools, sensor: Sensor) -> Bools:
    """Return (n,) whether the other scan has a usable reading next to each exact reading of this one."""
    angles = sensor.angle_min + sensor.angle_increment * np.arange(sensor.n_beams)
    is_hit = np.isfinite(ranges)
    reach = np.where(is_hit, ranges, 0.0)
    own = np.stack([reach * np.cos(angles), reach * np.sin(angles)], axis=1)
    x, y = se2.transform(pose, own).T
    distance = np.hypot(x, y)
    turn = np.sign(sensor.angle_increment) * (np.arctan2(y, x) - sensor.angle_min)
    beam = np.round(np.remainder(turn, 2.0 * np.pi) / abs(sensor.angle_increment)).astype(np.int64)
    n = sensor.n_beams
    is_closed = n * abs(sensor.angle_increment) > 2.0 * np.pi - 1.5 * abs(sensor.angle_increment)
    beam = beam % n if is_closed else beam
    seen = np.zeros(n, dtype=np.bool_)
    for step in (-1, 0, 1):
        near = (beam + step) % n if is_closed else np.clip(beam + step, 0, n - 1)
        near = np.minimum(near, n - 1)
        with np.errstate(invalid="ignore"):
            same = np.abs(other_ranges[near] - distance) < _SAME_SURFACE
        seen |= same & other_usable[near]
    return np.asarray(seen & is_hit & (beam < n))


def _adjoint(pose: Pose) -> Floats:
    """Return (3, 3) how a small motion in frame b reads in frame a, for the pose of b in a."""
    matrix = np.eye(3)
    matrix[:2, :2] = se2.rotation(pose[2])
    matrix[:2, 2] = pose[1], -pose[0]
    return matrix
