"""The paper's experiment 1: a scan moved by a random transform, a thousand times (its section 3.2).

As the paper has it, both scans are taken from the same place, differ by noise and by the people who walked on between
them, and the second is moved on paper. Harder variants stand beside it: more noise, other people at other places in the
second scan, and a sensor that is moved itself, so that surfaces hide and show and are sampled anew.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeAlias

import numpy as np

from curvescan import se2
from curvescan.errors import require
from curvescan.matchers.cfsma.config import CfSmaConfig
from curvescan.matchers.cfsma.matcher import CfSmaMatcher
from curvescan.scan import LaserScan
from curvescan.simulation import simulate, simulate_pairs
from curvescan.types import Bools, Floats, Ints, Pose

TRANSLATION_MEAN, TRANSLATION_STD = 0.100, 0.050  # random translation on each axis, metres
ROTATION_MEAN, ROTATION_STD = np.radians(15.0), np.radians(5.0)  # random rotation, radians
SUCCESS = (0.1, np.radians(2.0))  # a match counts as right within this translation, metres, and rotation, radians


def is_success(errors: Floats) -> Bools:
    """Return (...,) whether (..., 3) errors of poses lie within SUCCESS; NaN does not."""
    distance = np.hypot(errors[..., 0], errors[..., 1])
    return np.asarray((distance < SUCCESS[0]) & (np.abs(errors[..., 2]) < SUCCESS[1]))


N_BATCHES = 5  # seeds the runs of a condition are spread over; what differs between them is the spread that is reported

Moves: TypeAlias = Literal["scan", "sensor"]
"""What is moved by the random transform: the points of the second scan, or the sensor that takes it."""


@dataclass(frozen=True, kw_only=True)
class RandomTransformCondition:
    """Circumstances of experiment 1."""

    title: str  # what they are
    sensor: str = "sick-lms200-5mm"  # name of the simulated sensor
    # the paper's variant, both scans from one place and the points of the second moved; or the
    # robot's, the second scan taken from the other place
    moves: Moves = "scan"
    n_walkers: int = 0  # people who walk on between the two scans, a sweep's period apart
    # share of the beams, 0 to 1, that hit people who stand at other places in each of the two scans
    people_share: float = 0.0
    # whether all runs of a seed are at one place of one world; else each has a world of its own
    is_one_place: bool = False


CONDITIONS: tuple[RandomTransformCondition, ...] = (
    RandomTransformCondition(title="5 mm, one place a seed", is_one_place=True),
    RandomTransformCondition(title="5 mm, one place a seed, 3 walkers", n_walkers=3, is_one_place=True),
    RandomTransformCondition(title="5 mm"),
    RandomTransformCondition(title="5 mm, 3 walkers", n_walkers=3),
    RandomTransformCondition(title="10 mm", sensor="sick-lms200"),
    RandomTransformCondition(title="5 mm, 15 % of beams on other people", people_share=0.15),
    RandomTransformCondition(title="10 mm, 15 % of beams on other people", sensor="sick-lms200", people_share=0.15),
    RandomTransformCondition(title="5 mm, the sensor moved", moves="sensor"),
    RandomTransformCondition(title="10 mm, the sensor moved", sensor="sick-lms200", moves="sensor"),
)
"""The paper's conditions first: a real LMS200's noise and few people; then harder ones."""

N_PAPER_CONDITIONS = 4  # the first of CONDITIONS, which are the paper's


@dataclass(frozen=True, eq=False, kw_only=True)
class RandomTransformRuns:
    """Results of experiment 1, one row a run."""

    # (n, 3): absolute error of x, y, theta in the true frame: metres, metres, radians; NaN where the match failed
    errors: Floats
    n_matched: Ints  # (n,): matched pairs of readings N_t; 0 where the match failed
    batch: Ints  # (n,): which seed each run belongs to, from 0

    @property
    def translation_error(self) -> Floats:
        """(n,) distance from the true translation, metres; NaN where the match failed."""
        return np.hypot(self.errors[:, 0], self.errors[:, 1])

    @property
    def rotation_error(self) -> Floats:
        """(n,) radians, absolute; NaN where the match failed."""
        return self.errors[:, 2]

    @property
    def is_right(self) -> Bools:
        """(n,) whether a run ended within SUCCESS of the truth."""
        return is_success(self.errors)

    @property
    def failed_share(self) -> float:
        """Share of the runs whose match failed, 0 to 1."""
        return float(_mean_or_nan(np.isnan(self.errors))[0])

    @property
    def right_share(self) -> float:
        """Share of all runs that ended within SUCCESS of the truth, 0 to 1."""
        return float(_mean_or_nan(self.is_right[:, np.newaxis])[0])

    @property
    def right_spread(self) -> float:
        """Standard deviation of that share from seed to seed."""
        shares = [self.is_right[self.batch == b].mean() for b in np.unique(self.batch)]
        return float(np.std(shares)) if shares else math.nan

    @property
    def mean_of_right(self) -> Floats:
        """(3,) mean absolute errors of x, y, theta of the right runs; NaN without any."""
        return _mean_or_nan(self.errors[self.is_right])

    @property
    def mean_of_all(self) -> Floats:
        """(3,) the same of all runs that gave a pose, right or wrong, which is what the paper prints."""
        return _mean_or_nan(self.errors[~np.isnan(self.errors[:, 0])])

    @property
    def mean_n_matched(self) -> float:
        """Mean N_t of the runs that gave a pose; NaN without any."""
        return float(_mean_or_nan(self.n_matched[self.n_matched > 0, np.newaxis])[0])


TransformResult: TypeAlias = tuple[RandomTransformRuns, RandomTransformRuns]
"""Experiment 1 under one condition: by cfsma as printed, and with its consistency test."""


def _mean_or_nan(rows: Floats | Ints | Bools) -> Floats:
    return np.asarray(rows.mean(axis=0) if len(rows) else np.full(rows.shape[1], np.nan))


def random_transforms(n: int, rng: np.random.Generator) -> Pose:
    """Return (n, 3) random poses of the paper's spread, each component of either sign."""
    moved = rng.normal(TRANSLATION_MEAN, TRANSLATION_STD, (n, 2))
    size = np.column_stack([moved, rng.normal(ROTATION_MEAN, ROTATION_STD, n)])
    return np.asarray(size * rng.choice([-1.0, 1.0], (n, 3)))


class TransformedPair(NamedTuple):
    """Two scans of experiment 1 and the true pose of the second, once moved, in the first."""

    reference: LaserScan
    current: LaserScan
    pose: Pose


def transformed_pairs(
    condition: RandomTransformCondition, n_pairs: int, seed: int, *, world: str = "office"
) -> Iterator[TransformedPair]:
    """Yield the scan pairs of one seed; where the scan is moved, that is left to :func:`match_transformed`."""
    transforms = random_transforms(n_pairs, np.random.default_rng(seed))
    motions = transforms if condition.moves == "sensor" else np.zeros_like(transforms)
    pairs = simulate_pairs(
        world, sensor=condition.sensor, motions=motions, people_share=condition.people_share, seed=seed
    )
    first = pairs[0] if condition.is_one_place else None
    for k, pose in enumerate(transforms):
        pair = first or pairs[k]
        if first is None and condition.n_walkers == 0:
            yield TransformedPair(pair.reference, pair.current, pose)
            continue
        log = simulate(
            pair.world,
            sensor=condition.sensor,
            poses=np.array([pair.reference_pose, pair.reference_pose]),
            n_people=condition.n_walkers,
            odometry_noise=None,
            seed=1_000_003 * (seed + 1) + k,
        )
        yield TransformedPair(log[0], log[1], pose)


def match_transformed(
    pairs: list[TransformedPair], moves: Moves, config: CfSmaConfig | None = None, batch: int = 0
) -> RandomTransformRuns:
    """Return CF-SMA's errors on pairs, current points moved first with `moves` "scan"; config None: the defaults."""
    matcher = CfSmaMatcher(config or CfSmaConfig())
    errors = np.full((len(pairs), 3), np.nan)
    n_matched = np.zeros(len(pairs), dtype=np.int64)
    for run, pair in enumerate(pairs):
        reference, current = matcher.prepare(pair.reference), matcher.prepare(pair.current)
        if moves == "scan":
            current = replace(current, points=se2.transform(se2.inverse(pair.pose), current.points))
        result = matcher.match(reference, current, None)
        if result.ok:
            errors[run] = np.abs(se2.between(pair.pose, result.pose))
            n_matched[run] = result.n_matched
    return RandomTransformRuns(errors=errors, n_matched=n_matched, batch=np.full(len(pairs), batch))


def check_n_runs(n_runs: int) -> None:
    """Raise InvalidArgumentError unless every seed has the same number of runs, at least one."""
    rule = f"runs of experiment 1 must be a multiple of its {N_BATCHES} seeds, at least {N_BATCHES}"
    require(n_runs >= N_BATCHES and n_runs % N_BATCHES == 0, rule, n_runs)


def run_random_transforms(
    condition: RandomTransformCondition = CONDITIONS[2],
    *,
    n_runs: int = 1000,
    world: str = "office",
    seed: int = 0,
    configs: tuple[CfSmaConfig | None, ...] = (None,),
    on_run: Callable[[], object] = lambda: None,
) -> tuple[RandomTransformRuns, ...]:
    """Return CF-SMA's errors over random transforms of N_BATCHES seeds; configs (None: defaults) share the pairs."""
    check_n_runs(n_runs)
    batches: list[list[RandomTransformRuns]] = [[] for _ in configs]
    for b in range(N_BATCHES):
        pairs = []
        for pair in transformed_pairs(condition, n_runs // N_BATCHES, seed + b, world=world):
            pairs.append(pair)
            on_run()
        for one, config in zip(batches, configs, strict=True):
            one.append(match_transformed(pairs, condition.moves, config, b))
    return tuple(_joined(one) for one in batches)


def _joined(batches: list[RandomTransformRuns]) -> RandomTransformRuns:
    names = ("errors", "n_matched", "batch")
    return RandomTransformRuns(**{name: np.concatenate([getattr(one, name) for one in batches]) for name in names})
