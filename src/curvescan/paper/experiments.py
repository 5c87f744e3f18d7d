"""The paper's five experiments in one go (its sections 3.2 and 3.3): seeded, so that a rerun gives the same numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass

from numpy.typing import ArrayLike

from curvescan.errors import InvalidArgumentError
from curvescan.evaluation.real_logs import LogEvaluation, assign_relations, evaluate_log
from curvescan.io.log import Log
from curvescan.io.trajectories.relations import Relations
from curvescan.matchers import MATCHERS, find_matcher
from curvescan.paper.random_transform import (
    VARIANTS,
    Moves,
    RandomTransformRuns,
    run_random_transforms,
)
from curvescan.paper.scenarios import (
    DYNAMIC,
    RETURN_HOME,
    STATIC,
    DriveExperiment,
    ScenarioResult,
    run_drive,
)
from curvescan.simulation import Simulation

DRIVES = (RETURN_HOME, STATIC, DYNAMIC)

Progress = Callable[[str, int], Callable[..., None]]
"""Takes what is done and how many steps it has; returns what to call after each step."""


def in_silence(what: str, total: int) -> Callable[..., None]:
    """Tell nobody how far it is."""
    return lambda *_: None


@dataclass(frozen=True, eq=False, kw_only=True)
class ScenarioComparison:
    """One drive and what each method made of it."""

    experiment: DriveExperiment
    log: Simulation
    results: dict[str, ScenarioResult]


@dataclass(frozen=True, eq=False, kw_only=True)
class Experiments:
    """Results of all experiments.

    Attributes
    ----------
    seed : int
        Seed of everything.
    is_quick : bool
        Whether they were cut short: a tenth of the runs, a quarter of the scans.
    random_transforms : dict of (what moved, share of people) to RandomTransformRuns
        Experiment 1; empty where only logs were asked for.
    drives : tuple of ScenarioComparison
        Experiments 2, 3 and 4; empty likewise.
    n_parameters : dict of str to int
        Table VI: parameters of each method, counted from its configuration.
    logs : tuple of LogEvaluation
        Every method on the real logs that were given.
    """

    seed: int
    is_quick: bool
    random_transforms: dict[tuple[Moves, float], RandomTransformRuns]
    drives: tuple[ScenarioComparison, ...]
    n_parameters: dict[str, int]
    logs: tuple[LogEvaluation, ...]


def run_experiments(
    *,
    methods: Sequence[str] = tuple(MATCHERS),
    logs: Sequence[Log] = (),
    relations: Sequence[Relations] = (),
    laser_pose: ArrayLike = (0.0, 0.0, 0.0),
    only_logs: bool = False,
    is_quick: bool = False,
    seed: int = 0,
    progress: Progress = in_silence,
) -> Experiments:
    """Return the results of the paper's experiments on simulated scans, and of every method on real logs.

    Parameters
    ----------
    methods : sequence of str
        Names of matchers.
    logs : sequence of Log
        Real logs.
    relations : sequence of Relations
        Of the robots of these logs; their stamps tell which log each belongs to.
    laser_pose : (3,) array_like
        Pose of the sensor on the robot, for the relations.
    only_logs : bool
        Leave out what is simulated.
    is_quick : bool
        A tenth of the runs and a quarter of the scans, to see that all works.
    seed : int
        The same seed gives the same numbers to the last digit, times aside.
    progress : callable
        Tells how far it is; silent by default.

    Raises
    ------
    InvalidArgumentError
        When relations belong to none of the logs, or there is nothing to run.
    """
    if only_logs and not logs:
        raise InvalidArgumentError("there is nothing to run without the simulated scans: give logs")
    owned = assign_relations(logs, relations)
    n_runs, share = (100, 0.25) if is_quick else (1000, 1.0)
    random_transforms = {
        (moves, people_share): run_random_transforms(
            moves=moves,
            n_runs=n_runs,
            people_share=people_share,
            seed=seed,
            on_run=progress(f"experiment 1, {100 * people_share:.0f} % people", n_runs),
        )
        for moves, people_share in (() if only_logs else VARIANTS)
    }
    drives = []
    for experiment in () if only_logs else DRIVES:
        log = experiment.simulate(seed=seed, share=share)
        advance = progress(
            f"experiment {experiment.number}, {experiment.title}", len(log) * len(methods)
        )
        drives.append(
            ScenarioComparison(
                experiment=experiment, log=log, results=run_drive(log, methods, on_step=advance)
            )
        )
    judged = [
        evaluate_log(
            log,
            method,
            relations=some,
            laser_pose=laser_pose,
            on_step=progress(f"{log.name}, {method}", len(log) - 1),
        )
        for log, some in zip(logs, owned, strict=True)
        for method in methods
    ]
    return Experiments(
        seed=seed,
        is_quick=is_quick,
        random_transforms=random_transforms,
        drives=tuple(drives),
        n_parameters={method: count_parameters(find_matcher(method).config) for method in methods},
        logs=tuple(judged),
    )


def count_parameters(config: object) -> int:
    """Return how many values a configuration holds, those of the configurations in it included."""
    if not is_dataclass(config):
        return 1
    return sum(count_parameters(getattr(config, field.name)) for field in fields(config))
