"""Where the results of a batch go: a folder of this machine; :mod:`.bucket_results` has the other place."""

from __future__ import annotations

import csv
import io
import os
import shutil
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import fields
from pathlib import Path
from typing import Protocol

from curvescan._interrupts import cleaned_up_by
from curvescan.io.files.output import HIDDEN_PREFIX, output_file
from curvescan.runs.batch.logs import name_folders
from curvescan.runs.batch.manifest import MANIFEST, BatchRecord, Manifest, open_manifest
from curvescan.runs.batch.object_store import is_url
from curvescan.runs.batch.worker import Task

FLEET = "fleet.csv"
WORKERS_LOG = "workers.log"


class TaskQueue(Protocol):
    """The logs that a batch has to run."""

    def take(self) -> Task | None:
        """Return the next one, or None where there is none at the moment."""
        ...

    def n_left(self) -> int:
        """Return how many may still come."""
        ...


class Results(Protocol):
    """The results of a batch, and the records of what became of each log."""

    workers_log: Path
    """File to which goes what the workers print."""
    records: dict[str, BatchRecord]
    """What is known of each log, by its path or URL."""

    def place(self, folder: str) -> str:
        """Return the path or URL of a folder of results."""
        ...

    def name_folders(self, logs: Sequence[str]) -> dict[str, str]:
        """Return the name of the folder of results of each log."""
        ...

    def holds(self, record: BatchRecord) -> bool:
        """Return whether the results of a record are there."""
        ...

    def queue(
        self, tasks: Sequence[Task], options: str, on_record: Callable[[BatchRecord], None]
    ) -> AbstractContextManager[TaskQueue]:
        """Give out logs; `on_record` is called for those that another batch has run meanwhile."""
        ...

    def append(self, record: BatchRecord) -> bool:
        """Keep a record, and return whether it was still this batch's to write."""
        ...

    def finish(self, records: Sequence[BatchRecord]) -> None:
        """Write the table of all."""
        ...


@contextmanager
def open_results(out: str | os.PathLike[str]) -> Iterator[Results]:
    """Yield the results in a folder, which nobody else writes meanwhile, or in a bucket, which others may.

    Raises
    ------
    OutputError
        When a folder cannot be written, or another batch runs in it.
    StorageError, MissingPackageError
        When a bucket cannot be reached.
    """
    if is_url(out):
        from curvescan.runs.batch.bucket_results import open_bucket_results

        with open_bucket_results(os.fspath(out)) as results:
            yield results
    else:
        root = Path(out).absolute()
        with open_manifest(root) as manifest, cleaned_up_by(lambda: _remove_leftovers(root)):
            yield FolderResults(root, manifest)


class FolderResults:
    """The results in a folder of this machine; see :class:`Results`."""

    def __init__(self, root: Path, manifest: Manifest) -> None:
        self.workers_log = root / WORKERS_LOG
        self._root, self._manifest = root, manifest
        self.records = manifest.records
        _remove_leftovers(root)

    def place(self, folder: str) -> str:
        """Return the path of a folder of results."""
        return str(self._root / folder)

    def name_folders(self, logs: Sequence[str]) -> dict[str, str]:
        """Return the name of the folder of results of each log; a log keeps the one it has."""
        known = {log: record.folder for log, record in self.records.items()}
        return name_folders(logs, known, (MANIFEST, FLEET, WORKERS_LOG))

    def holds(self, record: BatchRecord) -> bool:
        """Return whether the folder of a record is there."""
        return (self._root / record.folder).is_dir()

    @contextmanager
    def queue(
        self, tasks: Sequence[Task], options: str, on_record: Callable[[BatchRecord], None]
    ) -> Iterator[TaskQueue]:
        """Give out logs in their order."""
        yield ListedTasks(tasks)

    def append(self, record: BatchRecord) -> bool:
        """Write a record, and wait until it is on the disk."""
        self._manifest.append(record)
        return True

    def finish(self, records: Sequence[BatchRecord]) -> None:
        """Write fleet.csv."""
        with output_file(self._root / FLEET) as temporary:
            temporary.write_bytes(fleet_table(records))
        _remove_leftovers(self._root)


class ListedTasks:
    """Tasks that nobody else takes; see :class:`TaskQueue`."""

    def __init__(self, tasks: Sequence[Task]) -> None:
        self._waiting = deque(tasks)

    def take(self) -> Task | None:
        """Return the next one, or None after the last."""
        return self._waiting.popleft() if self._waiting else None

    def n_left(self) -> int:
        """Return how many wait."""
        return len(self._waiting)


def fleet_table(records: Sequence[BatchRecord]) -> bytes:
    """Return records as a CSV table, in UTF-8."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    names = [field.name for field in fields(BatchRecord)]
    writer.writerow(names)
    writer.writerows([getattr(record, name) for name in names] for record in records)
    return text.getvalue().encode("utf-8")


def _remove_leftovers(root: Path) -> None:
    """Remove the half-written results of workers that were killed; the manifest's lock says that nobody writes them."""
    for folder in root.glob(f"{HIDDEN_PREFIX}*"):
        shutil.rmtree(folder, ignore_errors=True)
    log = root / WORKERS_LOG
    with suppress(OSError):  # on Windows, where a worker is still ending
        if log.exists() and not log.stat().st_size:
            log.unlink()
