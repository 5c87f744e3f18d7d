"""curvescan bench: how fast and how accurate the matchers are, measured here and now."""

from __future__ import annotations

from pathlib import Path


def bench(
    *, pairs: int = 300, runs: int = 1000, seed: int = 0, logs: tuple[Path, ...] = (), out: Path | None = None
) -> int:
    """Measure the matchers: time a match, success and accuracy on pairs, experiment 1, failures on real logs, reading.

    Pairs: two scans of an office, a random motion apart, no guess; a match within 0.1 m and 2 deg is a success. The
    bound is the median translation error that the Cramér-Rao bound allows; NEES is 3 where covariances are right.

    Experiment 1: a scan matched with one moved by a random transform (0.1 m on each axis and 15 deg in the mean). Its
    variants: the paper's, where both scans are taken from one place and the second is moved on paper, without and
    with people; and the robot's, where the second is taken from the other place.

    Parameters
    ----------
    pairs
        Pairs of each scenario; fewer than 200 are also what the times are taken on.
    runs
        Runs of each variant and world of experiment 1.
    seed
        Seed of all simulated scans; the same seed gives the same errors.
    logs
        Real logs, each of whose scans is matched with the one before; compared with the poses in the log.
    out
        Folder to write bench.md into; nothing is written without.
    """
    from contextlib import nullcontext

    from curvescan.benchmarks.benchmark import run_benchmark
    from curvescan.benchmarks.report import benchmark_tables, save_benchmark
    from curvescan.cli.console import OUT, load_usable_methods, progress_bars, show
    from curvescan.io import output_folder, read_log

    sources = [read_log(path) for path in logs]
    with nullcontext() if out is None else output_folder(out) as folder:
        methods = load_usable_methods()
        with progress_bars() as progress:
            results = run_benchmark(
                methods=methods, n_pairs=pairs, n_runs=runs, logs=sources, seed=seed, progress=progress
            )
        if folder is not None:
            save_benchmark(folder, results)
    for table in benchmark_tables(results):
        show(table)
    if out is not None:
        OUT.print(f"wrote {out}/bench.md")
    return 0
