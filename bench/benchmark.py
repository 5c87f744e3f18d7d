"""Write bench/bench.md and bench/turns.png: `python bench/benchmark.py [--pairs 300] [--runs 1000] [--logs LOG...]`.

The tables of `curvescan bench`, and with them deceptive worlds, stamps that jitter and success against the turn.
"""

from __future__ import annotations

import argparse
from pathlib import Path

from curvescan.benchmarks.benchmark import run_benchmark
from curvescan.benchmarks.report import benchmark_tables
from curvescan.cli.console import load_usable_methods, progress_bars
from curvescan.io import read_log
from deceptive import DECEPTIONS, deception_table, score_deception
from stamp_jitter import JITTERS, jitter_table, measure_jitter, timed_log
from turns import draw_turns, success_by_turn

HERE = Path(__file__).parent
BEFORE_DECEPTIONS, N_LAST = 5, 1
"""Tables that stand before those of the deceptive worlds, and after those of the jitter."""

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
        results = run_benchmark(
            methods=methods, n_pairs=given.pairs, n_runs=given.runs, logs=logs, seed=seed, progress=progress
        )
    tables = benchmark_tables(results)
    deceptions = [score_deception(world, n_pairs=given.deceptive, seed=seed + 3) for world in DECEPTIONS]
    spreads = [
        measure_jitter(log, name=log.name, jitter=jitter, n_runs=N_JITTERED, seed=seed)
        for log in (timed_log(seed), *logs)
        for jitter in JITTERS
    ]
    tables.insert(BEFORE_DECEPTIONS, deception_table(deceptions))
    tables.insert(len(tables) - N_LAST, jitter_table(spreads))
    text = "\n".join(table.markdown() for table in tables)
    (given.out / "bench.md").write_text(text, encoding="utf-8", newline="\n")
    draw_turns(given.out / "turns.png", success_by_turn(methods, n_pairs=max(given.pairs // 5, 1), seed=seed + 2))


if __name__ == "__main__":
    main()
