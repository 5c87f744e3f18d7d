"""The paper's five experiments in one go (its sections 3.2 and 3.3): seeded, so that a rerun gives the same numbers."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, is_dataclass

from numpy.typing import ArrayLike

from curvescan.errors import InvalidArgumentError
from curvescan.evaluation.real_logs import LogEvaluation, assign_relations, check_logs, evaluate_log
from curvescan.io.log import Log
from curvescan.io.trajectories.relations import Relations
from curvescan.matchers import MATCHERS, find_matcher
from curvescan.matchers.baselines.config import CoxConfig
from curvescan.matchers.cfsma.config import CfSmaConfig
from curvescan.matchers.registry import MatcherConfig
from curvescan.paper.random_transform import (
    CONDITIONS,
    N_BATCHES,
    N_PAPER_CONDITIONS,
    RandomTransformCondition,
    TransformResult,
    run_random_transforms,
)
from curvescan.paper.scenarios import DRIVES, Condition, DriveExperiment, ScenarioResult, run_scenario
from curvescan.simulation import Simulation

N_SEEDS: dict[Condition, int] = {"paper": 3, "hard": 1}
"""Buildings, and runs of the robot in them, for each of experiments 2 to 4."""

N_RUNS = (1000, 250)  # runs of experiment 1 under each of the paper's conditions, and under each harder one
CONSISTENT = "cfsma, consistency"  # name of cfsma with its consistency test among the methods of a table

PAPER_CONFIGS: dict[str, MatcherConfig] = {"cox": CoxConfig(median_readings=3, has_projection_filter=True)}
"""Parameters of the methods where the paper uses them otherwise than our defaults: Cox after the filters of IDC."""

Progress = Callable[[str, int], Callable[..., None]]
"""Takes what is done and how many steps it has; returns what to call after each step."""


def in_silence(what: str, total: int) -> Callable[..., None]:
    """Tell nobody how far it is."""
    return lambda *_: None


@dataclass(frozen=True, eq=False, kw_only=True)
class ScenarioComparison:
    """One experiment and what each method made of it."""

    experiment: DriveExperiment  # what was done
    log: Simulation  # the scans of the first seed, for the figures
    # for each method one result a seed
    results: dict[str, tuple[ScenarioResult, ...]]
    people_shares: tuple[float, ...]  # share of the beams that hit people, for each seed

    @property
    def first(self) -> dict[str, ScenarioResult]:
        """The results of the first seed."""
        return {method: results[0] for method, results in self.results.items()}


@dataclass(frozen=True, eq=False, kw_only=True)
class Experiments:
    """Results of all experiments."""

    seed: int  # seed of everything
    is_quick: bool  # whether they were cut short: ten runs, one seed, a quarter of the scans
    # experiment 1 by cfsma, as printed
    # and with its consistency test; empty where only logs are evaluated
    random_transforms: dict[RandomTransformCondition, TransformResult]
    drives: tuple[ScenarioComparison, ...]  # experiments 2, 3 and 4, each under both conditions; empty likewise
    # table VI: parameters of each method, counted from its configuration
    n_parameters: dict[str, int]
    logs: tuple[LogEvaluation, ...]  # every method on the real logs that were given


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
    """Return the results of the paper's experiments on simulated scans, and of every method on real logs."""
    if only_logs and not logs:
        raise InvalidArgumentError("there is nothing to run without the simulated scans: give logs")
    check_logs(logs)
    owned = assign_relations(logs, relations)
    conditions, experiments = ((), ()) if only_logs else (CONDITIONS, DRIVES)
    random_transforms = {}
    for k, condition in enumerate(conditions):
        n_runs = 2 * N_BATCHES if is_quick else N_RUNS[k >= N_PAPER_CONDITIONS]
        on_run = progress(f"experiment 1, {condition.title}", n_runs)
        configs = (None, CfSmaConfig(consistency=True))
        plain, consistent = run_random_transforms(condition, n_runs=n_runs, seed=seed, configs=configs, on_run=on_run)
        random_transforms[condition] = plain, consistent
    drives = tuple(_drive(one, methods, is_quick=is_quick, seed=seed, progress=progress) for one in experiments)
    judged = [
        evaluate_log(
            log, method, relations=some, laser_pose=laser_pose, on_step=progress(f"{log.name}, {method}", len(log) - 1)
        )
        for log, some in zip(logs, owned, strict=True)
        for method in methods
    ]
    return Experiments(
        seed=seed,
        is_quick=is_quick,
        random_transforms=random_transforms,
        drives=drives,
        n_parameters={method: count_parameters(find_matcher(method).config) for method in methods},
        logs=tuple(judged),
    )


def _drive(
    experiment: DriveExperiment, methods: Sequence[str], *, is_quick: bool, seed: int, progress: Progress
) -> ScenarioComparison:
    """Return a drive of experiments 2 to 4 by every method, and by cfsma with its consistency test, for all seeds."""
    share = 0.25 if is_quick else 1.0
    n_seeds = 1 if is_quick else N_SEEDS[experiment.condition]
    entries = {method: (method, PAPER_CONFIGS.get(method)) for method in methods}
    if "cfsma" in methods:
        entries[CONSISTENT] = ("cfsma", CfSmaConfig(consistency=True))
    n_steps = max(int(experiment.n_scans * share), 2) * len(entries) * n_seeds
    advance = progress(f"experiment {experiment.name}, {experiment.title}", n_steps)
    logs = [experiment.simulate(seed=seed + k, share=share) for k in range(n_seeds)]
    return ScenarioComparison(
        experiment=experiment,
        log=logs[0],
        results={
            name: tuple(run_scenario(log, method, config, advance) for log in logs)
            for name, (method, config) in entries.items()
        },
        people_shares=tuple(float(log.is_person.mean()) for log in logs),
    )


def count_parameters(config: object) -> int:
    """Return how many values a configuration holds, those of the configurations in it included."""
    if not is_dataclass(config):
        return 1
    return sum(count_parameters(getattr(config, field.name)) for field in fields(config))
