"""curvescan batch: many logs in, a folder of results for each, and one table."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import TYPE_CHECKING, Annotated, Literal, TypeAlias

import tyro
from rich.progress import BarColumn, MofNCompleteColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

from curvescan._interrupts import reported_as
from curvescan.cli.console import ERR, OUT, table, with_flags
from curvescan.cli.options import Flag, LogFlags, LogUse, MapConfig, OdometryFlags, OdometryRules
from curvescan.configs import counted
from curvescan.io.files.lines import printable
from curvescan.mapping.config import OccupancyConfig
from curvescan.slam.config import SlamConfig

if TYPE_CHECKING:
    from curvescan.runs.batch.batch import BatchDisplay
    from curvescan.runs.batch.jobs import Job
    from curvescan.runs.batch.results import BatchRecord

Patterns: TypeAlias = Annotated[tyro.conf.Positional[tuple[str, ...]], tyro.conf.arg(metavar="PATTERN...")]
"""Paths of logs, or patterns of them."""


@dataclass(frozen=True, kw_only=True)
class WorkFlags:
    """How the logs are run."""

    resume: Flag = False
    """Skip logs whose results are there: same log, same options, same version. Logs that failed are run again."""
    engine: Literal["local", "ray"] = "local"
    """Where the logs are run: on this machine, or on the Ray cluster that RAY_ADDRESS names."""
    workers: int | None = None
    """How many logs to run at once; by default one a core."""
    timeout: float = 3600
    """Longest time that one log may take, seconds; inf for no limit."""


def batch(
    patterns: Patterns,
    /,
    *,
    out: str,
    slam: Flag = False,
    work: Annotated[WorkFlags, tyro.conf.arg(name="")] = WorkFlags(),
    rules: OdometryRules = OdometryFlags(),  # noqa: B008 - frozen
    slam_rules: Annotated[SlamConfig, tyro.conf.arg(name="slam")] = SlamConfig(),  # noqa: B008 - frozen
    use: LogUse = LogFlags(),  # noqa: B008 - frozen
    occupancy: MapConfig = OccupancyConfig(),  # noqa: B008 - frozen
) -> int:
    """Run odometry or SLAM over many logs, on all cores or a Ray cluster; a log that fails does not stop the others.

    Writes a folder of results for each log, as `curvescan odometry` or `curvescan slam` does; manifest.jsonl, a line
    for each log as soon as it is done; fleet.csv, the verdict of each run; workers.log, what went wrong in detail. Exit
    status 1 if any log failed.

    Parameters
    ----------
    patterns
        Logs, or patterns of them in quotes: `'logs/**/*.bag'`, `'s3://bucket/logs/*.mcap'`.
    out
        Folder for the results; made if it is missing. May be one of a bucket: s3://, gs:// or az://.
    slam
        SLAM in place of odometry.
    """
    from curvescan.runs.batch.batch import run_batch

    job = _job(rules, slam_rules if slam else None, use, occupancy)
    listed = f"{out}/manifest{'/' if '://' in out else '.jsonl'}"
    sentence = f"interrupted: the logs listed in {listed} are done; --resume goes on with the others"
    with reported_as(printable(sentence, 1000)), _display() as display:
        result = run_batch(patterns, out=out, job=job, display=display, **vars(work))
    shown = table("batch", "results", "scans", "path", "time", "verdict")
    for record in result.records:
        figures = (f"{record.scans:,}", f"{record.metres:,.1f} m") if record.scans else ("", "")
        shown.add_row(record.folder, *figures, f"{record.seconds:.1f} s", record.verdict)
    OUT.print(shown)
    for record in result.records:
        if record.is_failed:
            ERR.print(f"{record.input}: {with_flags(record.sentence)}", soft_wrap=True)
    OUT.print(f"wrote {out}/fleet.csv, manifest.jsonl and a folder for each log")
    skipped = f" ({result.n_skipped:,} stood from before)" if result.n_skipped else ""
    n_trusted = sum(record.exit == 0 for record in result.records)
    OUT.print(
        f"{counted(len(result.records), 'log')}{skipped}: {n_trusted:,} trusted, "
        f"{len(result.records) - n_trusted - result.n_failed:,} not to be trusted, {result.n_failed:,} failed"
    )
    return 1 if result.n_failed else 0


def _job(rules: OdometryFlags, slam: SlamConfig | None, use: LogFlags, occupancy: OccupancyConfig) -> Job:
    from curvescan.runs.batch.jobs import OdometryJob, SlamJob

    shared = {"occupancy": occupancy, "logs": use.reading.logs(), **use.options(rules.matching)}
    return OdometryJob(config=rules.config(), **shared) if slam is None else SlamJob(config=slam, **shared)


@contextmanager
def _display() -> Iterator[BatchDisplay]:
    """Yield what shows a batch: one bar for the whole, and what has failed so far."""
    from curvescan.runs.batch.batch import BatchDisplay

    progress = Progress(
        SpinnerColumn(),
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        MofNCompleteColumn(),
        TextColumn("{task.fields[said]}", markup=False),
        TimeElapsedColumn(),
        console=ERR,
        refresh_per_second=4,
    )
    task = progress.add_task("batch", total=None, said="")

    class Display(BatchDisplay):
        """Shows a batch."""

        _n_failed = 0

        def begin(self, stage: str, n_logs: int) -> None:
            progress.update(task, description=stage, total=n_logs or None)

        def add(self, record: BatchRecord) -> None:
            self._n_failed += record.is_failed
            said = f"logs, {self._n_failed:,} failed" if self._n_failed else "logs"
            progress.update(task, advance=1, said=said)

    with progress:
        yield Display()
