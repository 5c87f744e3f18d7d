"""Write bench/bench.md and bench/turns.png: `python bench/benchmark.py [--pairs 300] [--runs 1000] [--logs LOG...]`.

The tables of `curvescan bench`, and with them many matches, the time of each stage, deceptive worlds, stamps that
jitter, the time that reading takes, and success against the turn.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from curvescan.benchmarks.benchmark import run_benchmark
from curvescan.cli.console import load_usable_methods, progress_bars
from curvescan.io import read_log
from curvescan.matchers import DEFAULT_METHOD
from deceptive import DECEPTIONS, deception_table, score_deception
from many_matches import many_table, measure_many
from reading_speed import measure_reading, reading_table
from stages import measure_stages, stage_table
from stamp_jitter import JITTERS, jitter_table, measure_jitter, timed_log
from turns import draw_turns, success_by_turn

HERE = Path(__file__).parent
STAGED = (DEFAULT_METHOD, "cfsma")
"""Methods whose times are measured stage by stage."""

AFTER_SPEED, BEFORE_DECEPTIONS = 1, 6
"""Tables that stand before those of many matches and of stages, and then before those of the deceptive worlds."""

N_JITTERED = 5
"""Runs of each log with jittered stamps."""


def main() -> None:
    """Measure, and write the tables and the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--pairs", type=int, default=300)
    parser.add_argument("--runs", type=int, default=1000)
    parser.add_argument("--deceptive", type=int, default=100, help="pairs of each deceptive world")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--logs", type=Path, nargs="*", default=[])
    parser.add_argument("--out", type=Path, default=HERE)
    given = parser.parse_args()
    logs, seed = [read_log(path) for path in given.logs], given.seed
    methods = load_usable_methods()
    with progress_bars() as progress:
        tables = run_benchmark(
            methods=methods, n_pairs=given.pairs, n_runs=given.runs, logs=logs, seed=seed, progress=progress
        )
    deceptions = [score_deception(world, n_pairs=given.deceptive, seed=seed + 3) for world in DECEPTIONS]
    spreads = [
        measure_jitter(log, name=log.name, jitter=jitter, n_runs=N_JITTERED, seed=seed)
        for log in (timed_log(seed), *logs)
        for jitter in JITTERS
    ]
    n_pairs = min(given.pairs, 200)
    stages = [stage for method in STAGED for stage in measure_stages(method, n_pairs=n_pairs, seed=seed)]
    many = measure_many(50 * n_pairs, n_pairs=n_pairs, seed=seed)
    tables[AFTER_SPEED:AFTER_SPEED] = [many_table(many), stage_table(stages)]
    tables.insert(BEFORE_DECEPTIONS, deception_table(deceptions))
    tables += [jitter_table(spreads), reading_table(measure_reading(n_scans=min(given.runs, 500), seed=seed))]
    text = "\n".join(table.markdown() for table in tables)
    (given.out / "bench.md").write_text(text, encoding="utf-8", newline="\n")
    draw_turns(given.out / "turns.png", success_by_turn(methods, n_pairs=max(given.pairs // 5, 1), seed=seed + 2))


if __name__ == "__main__":
    main()
