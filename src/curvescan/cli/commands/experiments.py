"""curvescan experiments and bench: the paper's experiments beside its own figures; matchers measured here and now."""

from __future__ import annotations

from pathlib import Path

from curvescan.cli.options import LaserPose, in_radians


def experiments(
    *,
    out: Path,
    logs: tuple[Path, ...] = (),
    relations: tuple[Path, ...] = (),
    laser_pose: LaserPose = (0.0, 0.0, 0.0),
    only_logs: bool = False,
    quick: bool = False,
    seed: int = 0,
) -> int:
    """Run the paper's five experiments with every method, and report them beside the paper's figures.

    Writes report.html (self-contained), report.md, results.json and the figures. The same seed gives the same numbers
    to the last digit, times aside.

    Parameters
    ----------
    out
        Folder for the report; made if it is missing.
    logs
        Real logs on which every method is run too: errors, failures and milliseconds a scan.
    relations
        Relations of the Freiburg SLAM benchmark; their time stamps tell which log each file belongs to.
    laser_pose
        Pose of the laser on the robot for the relations: metres, metres, degrees.
    only_logs
        Run the methods on the real logs alone, without the paper's experiments on simulated scans.
    quick
        A tenth of the runs and a quarter of the scans, to see that all works.
    seed
        Seed of all simulated scans.
    """
    from curvescan.cli.console import ERR, OUT, load_usable_methods, progress_bars
    from curvescan.io import output_folder, read_log, read_relations
    from curvescan.paper.experiments import run_experiments
    from curvescan.paper.report import save_experiments

    mount = in_radians(laser_pose)
    sources = [read_log(path) for path in logs]
    known = [read_relations(path) for path in relations]
    with output_folder(out) as folder:
        methods = load_usable_methods()
        with progress_bars() as progress:
            results = run_experiments(
                methods=methods,
                logs=sources,
                relations=known,
                laser_pose=mount,
                only_logs=only_logs,
                is_quick=quick,
                seed=seed,
                progress=progress,
            )
        with ERR.status("drawing and writing the report"):
            save_experiments(folder, results)
    OUT.print(f"wrote {out}/report.html, report.md, results.json")
    return 0


def bench(
    *, pairs: int = 300, runs: int = 1000, seed: int = 0, logs: tuple[Path, ...] = (), out: Path | None = None
) -> int:
    """Measure the matchers: time a match, success and accuracy on pairs, experiment 1, failures on real logs.

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

    from curvescan.benchmarks.benchmark import benchmark_tables, run_benchmark, save_benchmark
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
