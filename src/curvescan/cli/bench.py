"""curvescan bench: how fast and how accurate the matchers are, measured here and now."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from collections.abc import Sequence

    from curvescan.io import Log
    from curvescan.types import Floats
    from curvescan.view.table import ResultTable


def bench(
    *,
    pairs: int = 300,
    runs: int = 1000,
    seed: int = 0,
    logs: tuple[Path, ...] = (),
    out: Path | None = None,
) -> int:
    """Measure the matchers: time a match, success and accuracy on pairs, experiment 1, failures on real logs.

    Pairs: two scans of an office, a random motion apart, no guess; a match within 0.1 m and 2 deg is right. The bound is the
    median translation error that the Cramér-Rao bound allows; NEES is 3 where covariances are right.

    Experiment 1: a scan matched with one moved by a random transform (0.1 m on each axis and 15 deg in the mean). Its
    variants: the paper's, where both scans are taken from one place and the second is moved on paper, without and
    with people; and the robot's, where the second is taken from the other place.

    Parameters
    ----------
    pairs
        Pairs of each cell; fewer than 200 are also what the times are taken on.
    runs
        Runs of each variant and world of experiment 1.
    seed
        Seed of all simulated scans; the same seed gives the same errors.
    logs
        Real logs, each of whose scans is matched with the one before; compared with the poses in the log.
    out
        Folder to write bench.md and turns.png (success against turn angle) into; nothing is written without.
    """
    from contextlib import nullcontext

    from curvescan.cli.console import OUT, show
    from curvescan.io import output_folder, read_log

    sources = [read_log(path) for path in logs]
    with nullcontext() if out is None else output_folder(out) as folder:
        tables = [
            _speed(pairs, seed),
            _scaling(pairs, seed),
            _pairs(pairs, seed),
            _experiment_1(runs, seed),
        ]
        if sources:
            tables.append(_real_logs(sources))
        if folder is not None:
            _draw_turns(folder / "turns.png", max(pairs // 5, 1), seed)
            text = "\n".join(table.markdown() for table in tables)
            (folder / "bench.md").write_text(text, encoding="utf-8")
    for table in tables:
        show(table)
    if out is not None:
        OUT.print(f"wrote {out}/bench.md, turns.png", markup=False)
    return 0


def _speed(pairs: int, seed: int) -> ResultTable:
    from curvescan.cli.console import load_kernels
    from curvescan.evaluation.speed import measure_speed
    from curvescan.matching import MATCHERS
    from curvescan.view.table import ResultTable

    rows = []
    for method in MATCHERS:
        load_kernels(method)
        speed = measure_speed(method, n_pairs=min(pairs, 200), seed=seed)
        rows.append(
            (
                method,
                _milliseconds(speed.prepare_seconds),
                _milliseconds(speed.match_seconds),
                _milliseconds(speed.guess_seconds),
            )
        )
    return ResultTable(
        title="Time of a scan of 361 beams, one thread: median (99th percentile)",
        columns=("method", "prepare a scan", "match, no guess", "match, good guess"),
        rows=rows,
    )


def _scaling(pairs: int, seed: int) -> ResultTable:
    import numpy as np

    from curvescan.evaluation.speed import measure_speed, with_beams
    from curvescan.matching import MATCHERS
    from curvescan.view.table import ResultTable

    counts = (181, 361, 721, 1441, 2881, 4001)
    rows = []
    for method in MATCHERS:
        speeds = [
            measure_speed(
                method, sensor=with_beams(n), n_pairs=min(pairs, 10), repeats=3, seed=seed
            )
            for n in counts
        ]
        for what, seconds in (
            ("prepare", [speed.prepare_seconds for speed in speeds]),
            ("match", [speed.match_seconds for speed in speeds]),
        ):
            rows.append((f"{method}, {what}", *(f"{1e3 * np.median(s):.3f} ms" for s in seconds)))
    return ResultTable(
        title="Growth with the number of beams over 180 deg: median",
        columns=("method", *(f"{n:,} beams" for n in counts)),
        rows=rows,
    )


def _draw_turns(path: Path, pairs: int, seed: int) -> None:
    from curvescan.cli.console import progress_bar
    from curvescan.evaluation.turns import TURNS_DEG, success_by_turn
    from curvescan.matching import MATCHERS
    from curvescan.view.turns import draw_turns

    with progress_bar("any turn", pairs * len(TURNS_DEG), "pairs") as advance:
        shares = success_by_turn(tuple(MATCHERS), n_pairs=pairs, seed=seed + 2, on_pair=advance)
    draw_turns(path, shares)


def _pairs(pairs: int, seed: int) -> ResultTable:
    import math

    from curvescan.cli.console import progress_bar
    from curvescan.evaluation.cells import CELLS, score_cell
    from curvescan.matching import MATCHERS
    from curvescan.view.table import ResultTable

    rows = []
    for cell in CELLS:
        with progress_bar(cell.name, pairs, "pairs") as advance:
            scores = score_cell(
                cell, tuple(MATCHERS), n_pairs=pairs, seed=seed + 1, on_pair=advance
            )
        rows += [
            (
                score.cell,
                score.method,
                f"{100 * score.success:.1f} %",
                f"{100 * score.confidently_wrong:.1f} %",
                f"{1e3 * score.median_error:.2f} mm",
                f"{score.median_error / score.bound:.2f}",
                "-" if math.isnan(score.nees) else f"{score.nees:.2f}",
                "-" if math.isnan(score.nees) else f"{100 * score.inside_95:.1f} %",
            )
            for score in scores
        ]
    return ResultTable(
        title=f"Pairs of scans, {pairs:,} a cell, no guess: right within 0.1 m and 2 deg",
        columns=(
            "cell",
            "method",
            "right",
            "ok but wrong",
            "median error",
            "of bound",
            "NEES",
            "in 95 %",
        ),
        rows=rows,
    )


def _open(pairs: int, seed: int) -> ResultTable:
    import math

    from curvescan.evaluation.cells import OPEN_WORLDS, score_open
    from curvescan.matching import MATCHERS
    from curvescan.view.table import ResultTable

    scores = [
        score
        for world in OPEN_WORLDS
        for score in score_open(world, tuple(MATCHERS), n_pairs=pairs, seed=seed + 1)
    ]
    return ResultTable(
        title=f"Where a motion stays open, {pairs:,} pairs each",
        columns=("world", "method", "ok", "names its weak direction", "NEES", "inside 95 %"),
        rows=[
            (
                score.world,
                score.method,
                f"{100 * score.ok:.1f} %",
                *(
                    ("-", "-", "-")
                    if math.isnan(score.nees)
                    else (
                        f"{100 * score.flagged:.1f} %",
                        f"{score.nees:.3g}",
                        f"{100 * score.inside_95:.1f} %",
                    )
                ),
            )
            for score in scores
        ],
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


def _real_logs(sources: Sequence[Log]) -> ResultTable:
    from curvescan.cli.console import progress_bar
    from curvescan.evaluation.real_logs import judge_log
    from curvescan.matching import MATCHERS
    from curvescan.view.experiment_tables import log_table

    judged = []
    for log in sources:
        for method in MATCHERS:
            with progress_bar(f"{log.name}, {method}", len(log) - 1) as advance:
                judged.append(judge_log(log, method, on_step=advance))
    return log_table(judged)


def _milliseconds(seconds: Floats) -> str:
    import numpy as np

    median, p99 = 1e3 * np.percentile(seconds, [50, 99])
    return f"{median:.3f} ms ({p99:.3f} ms)"
