"""All that `curvescan bench` measures: time, success, accuracy and consistency of every method."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from curvescan.benchmarks.io_speed import N_FORMATS, ReadingSpeed, measure_reading
from curvescan.benchmarks.profile import StageTime, measure_stages
from curvescan.benchmarks.scenarios import OPEN_WORLDS, SCENARIOS, OpenScore, ScenarioScore, score_open, score_scenario
from curvescan.benchmarks.speed import Speed, measure_many, measure_speed, with_beams
from curvescan.evaluation.real_logs import LogEvaluation, evaluate_log
from curvescan.io.log import Log
from curvescan.matchers import DEFAULT_METHOD, MATCHERS
from curvescan.paper.experiments import Progress, in_silence
from curvescan.paper.random_transform import (
    CONDITIONS,
    RandomTransformCondition,
    RandomTransformRuns,
    run_random_transforms,
)

BEAM_COUNTS = (181, 361, 721, 1441, 2881, 4001)  # beams over 180 degrees for which times are taken
STAGED = (DEFAULT_METHOD, "cfsma")  # methods whose times are measured stage by stage
EXPERIMENT_1_WORLDS = ("room", "office", "building")  # simulated worlds of experiment 1

EXPERIMENT_1_SENSOR = "sick-lms200"
"""Conditions of experiment 1 with this sensor are run, the one of all other benchmarks: 10 mm of noise."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Benchmark:
    """What was measured."""

    # pairs of a scenario, and runs of experiment 1
    n_pairs: int
    n_runs: int
    speeds: tuple[Speed, ...]  # of 361 beams, one a method
    many: dict[str, float]  # seconds of each of many matches, by how they are called
    stages: tuple[StageTime, ...]  # of the methods STAGED, stage by stage
    growth: dict[str, tuple[Speed, ...]]  # for each method, one a number of BEAM_COUNTS
    scenarios: tuple[ScenarioScore, ...]  # scenario by scenario, one a method
    open_worlds: tuple[OpenScore, ...]  # world by world, one a method
    # the paper's experiment 1
    experiment_1: dict[tuple[str, RandomTransformCondition], RandomTransformRuns]
    logs: tuple[LogEvaluation, ...]  # log by log, one a method
    reading: tuple[ReadingSpeed, ...]  # how fast logs are read, one a format


def run_benchmark(
    *,
    methods: Sequence[str] = tuple(MATCHERS),
    n_pairs: int = 300,
    n_runs: int = 1000,
    logs: Sequence[Log] = (),
    seed: int = 0,
    progress: Progress = in_silence,
) -> Benchmark:
    """Return time, success, accuracy and consistency of methods on simulated pairs and real logs."""
    speeds, stages, growth = _times(methods, min(n_pairs, 200), seed, progress)
    many = measure_many(50 * min(n_pairs, 200), n_pairs=min(n_pairs, 200), seed=seed)
    scenarios, open_worlds = _scores(methods, n_pairs, seed, progress)
    experiment_1 = _experiment_1(n_runs, seed, progress)
    judged = [
        evaluate_log(log, method, on_step=progress(f"{log.name}, {method}", len(log) - 1))
        for log in logs
        for method in methods
    ]
    reading = measure_reading(n_scans=min(n_runs, 500), seed=seed, on_format=progress("reading of logs", N_FORMATS))
    return Benchmark(
        n_pairs=n_pairs,
        n_runs=n_runs,
        speeds=speeds,
        many=many,
        stages=stages,
        growth=growth,
        scenarios=scenarios,
        open_worlds=open_worlds,
        experiment_1=experiment_1,
        logs=tuple(judged),
        reading=reading,
    )


def _times(
    methods: Sequence[str], n_pairs: int, seed: int, progress: Progress
) -> tuple[tuple[Speed, ...], tuple[StageTime, ...], dict[str, tuple[Speed, ...]]]:
    """Return times of methods: a match, its stages, and how both grow with the beams."""
    speeds: list[Speed] = []
    stages: list[StageTime] = []
    growth: dict[str, tuple[Speed, ...]] = {}
    for method in methods:
        advance = progress(f"time of {method}", 2 + len(BEAM_COUNTS))
        speeds.append(measure_speed(method, n_pairs=n_pairs, seed=seed))
        advance()
        if method in STAGED:
            stages += measure_stages(method, n_pairs=n_pairs, seed=seed)
        advance()
        series = []
        for n_beams in BEAM_COUNTS:
            sensor = with_beams(n_beams)
            series.append(measure_speed(method, sensor=sensor, n_pairs=min(n_pairs, 10), repeats=3, seed=seed))
            advance()
        growth[method] = tuple(series)
    return tuple(speeds), tuple(stages), growth


def _scores(
    methods: Sequence[str], n_pairs: int, seed: int, progress: Progress
) -> tuple[tuple[ScenarioScore, ...], tuple[OpenScore, ...]]:
    """Return how methods do on simulated pairs: scenarios, worlds with an unobservable direction."""
    scenarios = [
        score
        for one in SCENARIOS
        for score in score_scenario(one, methods, n_pairs=n_pairs, seed=seed + 1, on_pair=progress(one.name, n_pairs))
    ]
    open_worlds = [
        score
        for world in OPEN_WORLDS
        for score in score_open(world, methods, n_pairs=n_pairs, seed=seed + 1, on_pair=progress(world, n_pairs))
    ]
    return tuple(scenarios), tuple(open_worlds)


def _experiment_1(
    n_runs: int, seed: int, progress: Progress
) -> dict[tuple[str, RandomTransformCondition], RandomTransformRuns]:
    """Return the paper's experiment 1 in several worlds."""
    return {
        (world, condition): run_random_transforms(
            condition,
            n_runs=n_runs,
            world=world,
            seed=seed,
            on_run=progress(f"experiment 1, {world}, {condition.title}", n_runs),
        )[0]
        for world in EXPERIMENT_1_WORLDS
        for condition in CONDITIONS
        if condition.sensor == EXPERIMENT_1_SENSOR
    }
