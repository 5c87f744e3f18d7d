"""run_batch: one job over many logs, on all cores or a Ray cluster; what ``curvescan batch`` calls."""

import os
from collections.abc import Iterable
from contextlib import closing
from dataclasses import asdict, dataclass
from typing import Any, Literal, TypeAlias

from curvescan._version import __version__
from curvescan.configs import counted
from curvescan.errors import InvalidArgumentError
from curvescan.runs.batch.jobs import Job, OdometryJob, digest_of
from curvescan.runs.batch.logs import LogState, find_logs
from curvescan.runs.batch.places import open_results
from curvescan.runs.batch.ray_cluster import RayPool
from curvescan.runs.batch.results import BatchRecord
from curvescan.runs.batch.worker import Task
from curvescan.runs.batch.workers import Done, ProcessPool, run_tasks

Engine: TypeAlias = Literal["local", "ray"]  # where the workers of a batch run
TIMEOUT_S = 3600.0  # time that a log may take unless the caller says otherwise, seconds


class BatchDisplay:
    """What shows how far a batch has come; this one shows nothing."""

    def begin(self, stage: str, n_logs: int) -> None:
        """Begin a stage over so many logs; 0: its length is not known."""

    def add(self, record: BatchRecord) -> None:
        """Show that a log is done."""


@dataclass(frozen=True, eq=False, kw_only=True)
class BatchResult:
    """What came of a batch.

    Attributes
    ----------
    records : tuple of BatchRecord
        One a log, in the order of their paths.
    n_skipped : int
        How many of them stood from an earlier batch.
    """

    records: tuple[BatchRecord, ...]
    n_skipped: int = 0

    @property
    def n_failed(self) -> int:
        """How many logs failed."""
        return sum(record.is_failed for record in self.records)

    def __repr__(self) -> str:
        n_trusted = sum(record.exit == 0 for record in self.records)
        return f"BatchResult({counted(len(self.records), 'log')}: {n_trusted:,} trusted, {self.n_failed:,} failed)"


def run_batch(
    patterns: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    *,
    out: str | os.PathLike[str],
    job: Job | None = None,
    engine: Engine = "local",
    workers: int | None = None,
    timeout: float = TIMEOUT_S,
    resume: bool = False,
    display: BatchDisplay | None = None,
) -> BatchResult:
    """Run a job over many logs, a worker on each core; a log that fails does not stop the others.

    The folder gets a folder of results for each log; manifest.jsonl, a line for each log as soon as it is done;
    fleet.csv, the same as a table, when all are; and workers.log, what the workers say. A log that breaks its worker,
    or takes too long, has failed, and a new worker is started. Ctrl-C ends the workers; logs in the manifest are done.

    Logs and results may be in buckets: ``s3://BUCKET/KEY``, ``gs://`` and ``az://``. A log is then fetched to a
    temporary file before it is run, and its results are sent when all are there. Several batches may fill one folder of
    a bucket: each log is run by one of them, and all of them end when all logs are done.

    Parameters
    ----------
    patterns : str, path-like or iterable of them
        Paths or URLs of logs, or patterns of them: ``*`` within a folder, ``**`` through folders.
    out : str or path-like
        Folder for the results, made if it is missing; a path or a URL.
    job : Job or None
        What to do with each log: an :class:`OdometryJob`, a :class:`SlamJob` or an own one; None for odometry.
    engine : {"local", "ray"}
        Processes of this machine, or actors of a Ray cluster: the one that RAY_ADDRESS names, or a new one here. Its
        machines need the same version of curvescan, and the paths of logs and results, or URLs.
    workers : int or None
        How many; None for as many as there are cores.
    timeout : float
        Time that one log may take, seconds; inf for any.
    resume : bool
        Whether to leave out logs whose results stand: same size and time of the log, same options, same version. What
        failed is run again.
    display : BatchDisplay or None
        Shows how far the batch has come.

    Raises
    ------
    InvalidArgumentError
        When a pattern matches no log, or an argument is out of range.
    OutputError
        When `out` cannot be written, another batch runs in that folder, or one with other options in that bucket.
    StorageError
        When a bucket cannot be reached.
    MissingPackageError
        When an extra is missing: ``cloud`` for buckets, ``ray`` for clusters.
    WorkerError
        When the workers cannot be started.
    """
    if workers is not None and workers < 1:
        raise InvalidArgumentError(f"workers must be at least 1, got {workers}")
    if not timeout > 0.0:  # also refuses NaN
        raise InvalidArgumentError(f"timeout must be a positive number of seconds, got {timeout}")
    if engine not in ("local", "ray"):
        raise InvalidArgumentError(f"engine must be 'local' or 'ray', got {engine!r}")
    job, shown = job or OdometryJob(), display or BatchDisplay()
    options = digest_of(job)
    logs = find_logs([patterns] if isinstance(patterns, str | os.PathLike) else patterns)
    by_input = {log.input: log for log in logs}
    with open_results(out) as results:
        folders = results.name_folders([*by_input])
        standing = {
            log.input
            for log in logs
            if resume
            and (known := results.records.get(log.input)) is not None
            and known.stands_for(log, options, __version__)
            and results.holds(known)
        }
        tasks = [
            Task(log=log.input, folder=results.place(folders[log.input])) for log in logs if log.input not in standing
        ]
        if tasks:
            with closing(RayPool(workers) if engine == "ray" else ProcessPool(workers, results.workers_log)) as pool:
                shown.begin("loading kernels (compiled in the first run only)", 0)
                pool.warm_up(job)
                shown.begin("batch", len(tasks))
                work = run_tasks(job, results, pool=pool, timeout=timeout, log=results.workers_log)
                with results.giving_out(tasks, options, shown.add), closing(work):
                    for done in work:
                        record = _record(done, by_input[done.task.log], options)
                        if results.append(record):
                            shown.add(record)
        records = tuple(results.records[log.input] for log in logs)
        results.finish()
    return BatchResult(records=records, n_skipped=len(standing))


def _record(done: Done, state: LogState, options: str) -> BatchRecord:
    result = done.result
    if isinstance(result, str):
        found: dict[str, Any] = {"exit": 1, "verdict": "failed", "sentence": result}
    else:
        found = {"exit": 0, "verdict": "trusted"} if result.is_trusted else {"exit": 3, "verdict": "not trusted"}
        found |= {"sentence": result.sentence, "scans": result.n_scans, "metres": round(result.length, 3)}
    seconds = round(done.seconds, 3)
    return BatchRecord(
        **asdict(state), options=options, version=__version__, folder=done.task.name, seconds=seconds, **found
    )
