"""The results of a batch in a folder of this machine, or, by its URL, in a bucket."""

from __future__ import annotations

import os
import shutil
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from curvescan._interrupts import cleaned_up_by
from curvescan.io.files.output import HIDDEN_PREFIX, output_file
from curvescan.runs.batch.logs import name_folders
from curvescan.runs.batch.object_store import is_url
from curvescan.runs.batch.results import (
    FLEET,
    MANIFEST,
    WORKERS_LOG,
    BatchRecord,
    Manifest,
    Results,
    TaskQueue,
    fleet_table,
    open_manifest,
)
from curvescan.runs.batch.worker import Task


@contextmanager
def open_results(out: str | os.PathLike[str]) -> Iterator[Results]:
    """Yield the results in a folder, which nobody else writes meanwhile, or in a bucket, which others may."""
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
        """Write a record, and wait until the results, and then it, are on the disk."""
        if not record.is_failed:
            _sync(self._root / record.folder)
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


def _sync(folder: Path) -> None:
    """Wait until a folder of results is on the disk: a power cut must not leave a record without what it lists."""
    is_windows = os.name == "nt"  # there a folder cannot be opened, and a file must be writable
    for path in (*folder.rglob("*"), folder, folder.parent):
        if is_windows and path.is_dir():
            continue
        with suppress(OSError):  # somebody else's file, or one that a system cannot wait for
            number = os.open(path, os.O_RDWR if is_windows else os.O_RDONLY)
            try:
                os.fsync(number)
            finally:
                os.close(number)


def _remove_leftovers(root: Path) -> None:
    """Remove the half-written results of workers that were killed; the manifest's lock says that nobody writes them."""
    for folder in (*root.glob(f"{HIDDEN_PREFIX}*"), *root.glob(f"*/{HIDDEN_PREFIX}*")):
        shutil.rmtree(folder, ignore_errors=True)
    log = root / WORKERS_LOG
    with suppress(OSError):  # on Windows, where a worker is still ending
        if log.exists() and not log.stat().st_size:
            log.unlink()
