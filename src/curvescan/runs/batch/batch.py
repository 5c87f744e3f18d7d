"""run_batch: one job over many logs, on all cores; what ``curvescan batch`` calls."""

from __future__ import annotations

import csv
import glob
import os
import re
import shutil
from collections.abc import Iterable, Iterator, Sequence
from contextlib import closing
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Protocol

from curvescan import __version__
from curvescan._interrupts import cleaned_up_by
from curvescan.errors import InvalidArgumentError, LogFileError, LogFormatError
from curvescan.io.files.output import HIDDEN_PREFIX, output_file
from curvescan.io.ros.bag_files import storage_files
from curvescan.runs.batch.job import Job, digest_of
from curvescan.runs.batch.jobs import OdometryJob
from curvescan.runs.batch.manifest import MANIFEST, BatchRecord, LogState, open_manifest
from curvescan.runs.batch.worker import Task
from curvescan.runs.batch.workers import Done, run_tasks

FLEET = "fleet.csv"
WORKERS_LOG = "workers.log"
TIMEOUT_S = 3600.0
"""Time that a log may take unless the caller says otherwise, seconds."""


class BatchDisplay(Protocol):
    """What shows how far a batch has come."""

    def begin(self, stage: str, n_logs: int) -> None:
        """Begin a stage over so many logs; 0: its length is not known."""
        ...

    def add(self, record: BatchRecord) -> None:
        """Show that a log is done."""
        ...


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
        return f"BatchResult({len(self.records):,} logs: {n_trusted:,} trusted, {self.n_failed:,} failed)"


def run_batch(
    patterns: str | os.PathLike[str] | Iterable[str | os.PathLike[str]],
    *,
    out: str | os.PathLike[str],
    job: Job | None = None,
    workers: int | None = None,
    timeout: float = TIMEOUT_S,
    resume: bool = False,
    display: BatchDisplay | None = None,
) -> BatchResult:
    """Run a job over many logs, a worker process on each core; one bad log stops no other.

    The folder gets a folder of results for each log; manifest.jsonl, a line for each log as soon as it is done;
    fleet.csv, the same as a table, when all are; and workers.log, what the workers say. A log that breaks its worker, or
    takes too long, has failed; the worker is started anew. Ctrl-C ends the workers; what is in the manifest stands.

    Parameters
    ----------
    patterns : str, path-like or iterable of them
        Paths of logs, or patterns of paths: ``*`` within a folder, ``**`` through folders.
    out : str or path-like
        Folder for the results, made if it is missing.
    job : Job or None
        What to do with each log: an :class:`OdometryJob`, a :class:`SlamJob` or an own one; None for odometry.
    workers : int or None
        How many processes; None for as many as there are cores.
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
        When `out` cannot be written, or another batch runs in it.
    WorkerError
        When the worker processes cannot be started.
    """
    if workers is not None and workers < 1:
        raise InvalidArgumentError(f"workers must be at least 1, got {workers}")
    if not timeout > 0.0:  # also refuses NaN
        raise InvalidArgumentError(f"timeout must be a positive number of seconds, got {timeout}")
    _refuse_url(out)
    job, shown = job or OdometryJob(), display or _Silent()
    root, options = Path(out).absolute(), digest_of(job)
    logs = find_logs([patterns] if isinstance(patterns, str | os.PathLike) else patterns)
    with open_manifest(root) as manifest, cleaned_up_by(lambda: _remove_leftovers(root)):
        _remove_leftovers(root)
        states = {log: LogState.of(log) for log in logs}
        known = {k: r.folder for k, r in manifest.records.items()}
        folders = name_folders(logs, known)
        standing = [
            log
            for log in logs
            if resume
            and (record := manifest.records.get(str(log))) is not None
            and record.stands_for(states[log], options, __version__)
            and (root / record.folder).is_dir()
        ]
        tasks = [Task(log=log, folder=root / folders[log]) for log in logs if log not in standing]
        if tasks:
            shown.begin("loading kernels (compiled in the first run only)", 0)
            job.warm_up()
            shown.begin("batch", len(tasks))
        n_workers = min(workers or _n_cores(), len(tasks))
        log_file = root / WORKERS_LOG
        work = run_tasks(job, tasks, n_workers=n_workers, timeout=timeout, log=log_file)
        with closing(work):
            for done in work:
                record = _record(done, states[done.task.log], options)
                manifest.append(record)
                shown.add(record)
        records = tuple(manifest.records[str(log)] for log in logs)
        _write_fleet(root / FLEET, records)
        _remove_leftovers(root)
    return BatchResult(records=records, n_skipped=len(standing))


def find_logs(patterns: Iterable[str | os.PathLike[str]]) -> tuple[Path, ...]:
    """Return the logs that patterns match, each once, in the order of their absolute paths.

    Of folders those that hold a ROS 2 bag are logs, and the files in them are not logs of their own. A path without
    wildcards is taken as it is: whether it is a log will be seen.

    Raises
    ------
    InvalidArgumentError
        When a pattern matches nothing.
    """
    logs: dict[Path, None] = {}
    for pattern in patterns:
        _refuse_url(pattern)
        text = os.path.expanduser(os.fspath(pattern))  # noqa: PTH111 - a pattern is no path
        if Path(text).exists():
            found = [Path(text)]
        else:
            matches = map(Path, glob.glob(text, recursive=True))  # noqa: PTH207 - of absolute patterns too
            found = [path for path in matches if not path.is_dir() or _is_bag(path)]
        if not found:
            raise InvalidArgumentError(
                f"no log matches {os.fspath(pattern)!r}: give the path of a log, or a pattern such as 'logs/**/*.bag'"
            )
        logs |= dict.fromkeys(Path(os.path.abspath(path)) for path in found)  # noqa: PTH100 - keeps links
    bags = {path for path in logs if path.is_dir()}
    return tuple(sorted(path for path in logs if path.parent not in bags))


def name_folders(logs: Sequence[Path], known: dict[str, str]) -> dict[Path, str]:
    """Return the name of the results' folder of each log: the log's own, with folders above it where it is taken.

    Parameters
    ----------
    logs : sequence of Path
        Absolute paths.
    known : dict of str to str
        The folders that logs have from earlier batches, by path: they keep them.
    """
    taken = {name.casefold() for name in (*known.values(), MANIFEST, FLEET, WORKERS_LOG)}
    folders: dict[Path, str] = {}
    for log in logs:
        name = known.get(str(log))
        if name is None:
            name = next(name for name in _names(log) if name.casefold() not in taken)
            taken.add(name.casefold())
        folders[log] = name
    return folders


def _names(log: Path) -> Iterator[str]:
    stem = log.name if log.is_dir() else re.sub(r"(\.\w{1,6})?(\.gz)?$", "", log.name)
    name = (stem or log.name).lstrip(".") or "log"
    yield name
    for parent in log.parents:
        if parent.name:
            name = f"{parent.name.lstrip('.')}-{name}"
            yield name
    for k in range(2, 1_000_000):
        yield f"{name}-{k}"


def _is_bag(folder: Path) -> bool:
    try:
        return bool(storage_files(folder))
    except (LogFileError, LogFormatError):
        return False


def _refuse_url(path: str | os.PathLike[str]) -> None:
    if re.match(r"[A-Za-z][A-Za-z0-9+.-]+://", os.fspath(path)):
        raise InvalidArgumentError(
            f"{os.fspath(path)!r} is not on this machine, and object stores are not supported: copy the logs first"
        )


def _record(done: Done, state: LogState, options: str) -> BatchRecord:
    result = done.result
    is_failed = isinstance(result, str)
    is_trusted = not isinstance(result, str) and result.is_trusted
    return BatchRecord(
        **asdict(state),
        options=options,
        version=__version__,
        folder=done.task.folder.name,
        exit=1 if is_failed else 0 if is_trusted else 3,
        verdict="failed" if is_failed else "trusted" if is_trusted else "not trusted",
        sentence=result if isinstance(result, str) else result.sentence,
        seconds=round(done.seconds, 3),
        scans=0 if isinstance(result, str) else result.n_scans,
        metres=0.0 if isinstance(result, str) else round(result.length, 3),
    )


def _write_fleet(path: Path, records: Sequence[BatchRecord]) -> None:
    with (
        output_file(path) as temporary,
        temporary.open("w", encoding="utf-8", newline="") as file,
    ):
        writer = csv.writer(file, lineterminator="\n")
        names = [field.name for field in fields(BatchRecord)]
        writer.writerow(names)
        writer.writerows([getattr(record, name) for name in names] for record in records)


def _remove_leftovers(root: Path) -> None:
    """Remove the half-written results of workers that were killed; the manifest's lock says that nobody writes them."""
    for folder in root.glob(f"{HIDDEN_PREFIX}*"):
        shutil.rmtree(folder, ignore_errors=True)
    log = root / WORKERS_LOG
    if log.exists() and not log.stat().st_size:
        log.unlink()


def _n_cores() -> int:
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


class _Silent:
    """Shows nothing."""

    def begin(self, stage: str, n_logs: int) -> None: ...

    def add(self, record: BatchRecord) -> None: ...
