"""curvescan bench: how fast and how accurate the matchers are, measured here and now."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from curvescan.types import Floats
    from curvescan.view.table import ResultTable


def bench(
    *, runs: int = 1000, seed: int = 0, logs: tuple[Path, ...] = (), out: Path | None = None
) -> int:
    """Measure the matchers: milliseconds a match, the paper's experiment 1, failures on real logs.

    Experiment 1: a scan matched with one moved by a random transform (0.1 m on each axis and 15 deg in the mean). Its
    variants: the paper's, where both scans are taken from one place and the second is moved on paper, without and
    with people; and the robot's, where the second is taken from the other place.

    Parameters
    ----------
    runs
        Runs of each variant and world.
    seed
        Seed of all simulated scans; the same seed gives the same errors.
    logs
        Real logs to run the odometry on; a matched step more than 0.3 m or 10 deg away from wheel odometry is
        counted as wrong.
    out
        Folder to write bench.md into; nothing is written without.
    """
    from contextlib import nullcontext

    from curvescan.cli.console import OUT, show
    from curvescan.io import output_folder, read_log

    sources = [read_log(path) for path in logs]
    with nullcontext() if out is None else output_folder(out) as folder:
        tables = [_speed(seed), _experiment_1(runs, seed)]
        if sources:
            tables.append(_real_logs(sources))
        if folder is not None:
            text = "\n".join(table.markdown() for table in tables)
            (folder / "bench.md").write_text(text, encoding="utf-8")
    for table in tables:
        show(table)
    if out is not None:
        OUT.print(f"wrote {out}/bench.md")
    return 0


def _speed(seed: int) -> ResultTable:
    from curvescan.cli.console import load_kernels
    from curvescan.evaluation.speed import measure_speed
    from curvescan.matching import MATCHERS
    from curvescan.view.table import ResultTable

    rows = []
    for method in MATCHERS:
        load_kernels(method)
        speed = measure_speed(method, seed=seed)
        rows.append(
            (method, _milliseconds(speed.prepare_seconds), _milliseconds(speed.match_seconds))
        )
    return ResultTable(
        title="Time of a scan of 361 beams, one thread: median (99th percentile)",
        columns=("method", "prepare a scan", "match two prepared scans"),
        rows=rows,
    )


def _experiment_1(runs: int, seed: int) -> ResultTable:
    import numpy as np

    from curvescan.cli.console import progress_bar
    from curvescan.evaluation.random_transform import VARIANTS, run_random_transforms
    from curvescan.view.table import ResultTable

    rows = []
    for world in ("room", "office", "building"):
        for moves, people_share in VARIANTS:
            with progress_bar(f"{world}, the {moves} moved", runs, "runs") as advance:
                result = run_random_transforms(
                    moves=moves,
                    n_runs=runs,
                    world=world,
                    people_share=people_share,
                    seed=seed,
                    on_run=advance,
                )
            found = result.n_matched[result.n_matched > 0]
            rows.append(
                (
                    world,
                    f"the {moves}",
                    f"{100 * people_share:.0f} %",
                    f"{1e3 * np.median(result.translation_error[result.n_matched > 0]):.1f} mm",
                    f"{np.degrees(np.median(result.rotation_error[result.n_matched > 0])):.2f} deg",
                    f"{np.mean(found):.0f}",
                    f"{100 * result.failed_share:.1f} %",
                    f"{100 * result.right_share:.1f} %",
                )
                if found.size
                else (
                    world,
                    f"the {moves}",
                    f"{100 * people_share:.0f} %",
                    *["-"] * 3,
                    "100 %",
                    "0 %",
                )
            )
    return ResultTable(
        title=f"Experiment 1, cfsma, {runs:,} runs each: median errors of the matches that did not fail",
        columns=(
            "world",
            "moved",
            "people",
            "translation",
            "rotation",
            "mean N_t",
            "failed",
            "within 0.1 m, 2 deg",
        ),
        rows=rows,
    )


def _real_logs(sources: Sequence[object]) -> ResultTable:
    from curvescan.cli.console import progress_bar
    from curvescan.evaluation.real_logs import judge_log
    from curvescan.io import Log
    from curvescan.matching import MATCHERS
    from curvescan.view.table import ResultTable

    rows = []
    for log in sources:
        assert isinstance(log, Log)
        for method in MATCHERS:
            with progress_bar(f"{log.name}, {method}", len(log)) as advance:
                judged = judge_log(log, method, on_step=advance)
            n_failed = sum(judged.failures.values())
            reasons = ", ".join(
                f"{outcome.name.lower()} {100 * count / judged.n_steps:.1f} %"
                for outcome, count in judged.failures.items()
            )
            rows.append(
                (
                    log.name,
                    method,
                    f"{judged.n_steps:,}",
                    f"{100 * n_failed / judged.n_steps:.1f} %",
                    reasons or "-",
                    "-"
                    if judged.n_wrong is None
                    else f"{100 * judged.n_wrong / judged.n_steps:.1f} %",
                    f"{judged.median_milliseconds:.3f} ms",
                )
            )
    return ResultTable(
        title="Odometry on real logs, scan to scan, laser alone",
        columns=("log", "method", "steps", "failed", "why", "matched but wrong", "time a scan"),
        rows=rows,
    )


def _milliseconds(seconds: Floats) -> str:
    import numpy as np

    median, p99 = 1e3 * np.percentile(seconds, [50, 99])
    return f"{median:.3f} ms ({p99:.3f} ms)"
