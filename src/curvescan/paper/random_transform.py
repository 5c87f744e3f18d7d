"""The paper's experiment 1: a scan moved by a random transform, a thousand times (section 5).

As the paper has it, both scans are taken from the same place, differ by noise and by people, and the second is
moved on paper. A robot's scans are taken from two places, where surfaces hide and show and are sampled anew:
that is the harder variant, ``moves="sensor"``.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, TypeAlias

import numpy as np

from curvescan import se2
from curvescan.matchers.cfsma.config import CfSmaConfig
from curvescan.matchers.cfsma.matcher import CfSmaMatcher
from curvescan.matchers.result import Outcome
from curvescan.simulation import simulate_pairs
from curvescan.types import Bools, Floats, Ints, Pose

TRANSLATION_MEAN, TRANSLATION_STD = 0.100, 0.050
"""Random translation on each axis, metres."""

ROTATION_MEAN, ROTATION_STD = np.radians(15.0), np.radians(5.0)
"""Random rotation, radians."""

SUCCESS = (0.1, np.radians(2.0))
"""A match counts as right within this translation, metres, and rotation, radians."""


Moves: TypeAlias = Literal["scan", "sensor"]
"""What is moved by the random transform: the points of the second scan, or the sensor that takes it."""

VARIANTS: tuple[tuple[Moves, float], ...] = (("scan", 0.0), ("scan", 0.15), ("sensor", 0.0))
"""What is moved, and the share of beams that hit people: the paper's two variants, and the robot's."""


@dataclass(frozen=True, eq=False, kw_only=True)
class RandomTransformRuns:
    """Results of experiment 1, one row a run.

    Attributes
    ----------
    errors : (n, 3) float64
        Absolute error of x, y, theta in the true frame: metres, metres, radians; NaN where the match failed.
    n_matched : (n,) int64
        Matched pairs of readings N_t; 0 where the match failed.
    failures : dict of Outcome to int
        Failed runs by reason, most frequent first.
    """

    errors: Floats
    n_matched: Ints
    failures: dict[Outcome, int]

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
        right: Bools = (self.translation_error < SUCCESS[0]) & (self.rotation_error < SUCCESS[1])
        return right

    @property
    def failed_share(self) -> float:
        """Share of the runs whose match failed, 0 to 1."""
        return float(np.mean(np.isnan(self.translation_error)))

    @property
    def right_share(self) -> float:
        """Share of all runs that ended within SUCCESS of the truth, 0 to 1."""
        return float(np.mean(self.is_right))


def random_transforms(n: int, rng: np.random.Generator) -> Pose:
    """Return (n, 3) random poses of the paper's spread, each component of either sign."""
    size = np.column_stack(
        [
            rng.normal(TRANSLATION_MEAN, TRANSLATION_STD, (n, 2)),
            rng.normal(ROTATION_MEAN, ROTATION_STD, n),
        ]
    )
    poses: Pose = size * rng.choice([-1.0, 1.0], (n, 3))
    return poses


def run_random_transforms(
    *,
    moves: Moves = "scan",
    n_runs: int = 1000,
    world: str = "office",
    people_share: float = 0.0,
    seed: int = 0,
    config: CfSmaConfig | None = None,
    on_run: Callable[[], None] | None = None,
) -> RandomTransformRuns:
    """Return the errors of CF-SMA over random transforms, each in a fresh world.

    Parameters
    ----------
    moves : {"scan", "sensor"}
        The paper's variant: both scans from one place, the points of the second moved. Or the robot's: the
        second scan taken from the other place.
    n_runs : int
        Number of pairs.
    world : str
        Name of a simulated world; another one of its kind is built for each run.
    people_share : float
        Share of the beams that hit people who differ between the scans, 0 to 1.
    seed : int
        The same seed gives the same numbers to the last digit.
    config : CfSmaConfig or None
        None for the defaults.
    on_run : callable or None
        Called after each run, for a progress bar say.
    """
    matcher = CfSmaMatcher(config or CfSmaConfig())
    transforms = random_transforms(n_runs, np.random.default_rng(seed))
    true_motions = transforms if moves == "sensor" else np.zeros_like(transforms)
    errors = np.full((n_runs, 3), np.nan)
    n_matched = np.zeros(n_runs, dtype=np.int64)
    failures: Counter[Outcome] = Counter()
    pairs = simulate_pairs(
        world, n_pairs=n_runs, motions=true_motions, people_share=people_share, seed=seed
    )
    for run, (pair, pose) in enumerate(zip(pairs, transforms, strict=True)):
        reference, current = matcher.prepare(pair.reference), matcher.prepare(pair.current)
        if moves == "scan":
            moved = se2.transform(se2.inverse(pose), current.points)
            current = replace(current, points=moved)
        result = matcher.match(reference, current, None)
        if result.ok:
            errors[run] = np.abs(se2.between(pose, result.pose))
            n_matched[run] = result.n_matched
        else:
            failures[result.outcome] += 1
        if on_run:
            on_run()
    return RandomTransformRuns(
        errors=errors,
        n_matched=n_matched,
        failures=dict(failures.most_common()),
    )
