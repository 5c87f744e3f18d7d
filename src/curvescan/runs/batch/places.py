"""The places of a batch's results: a folder of this machine, or a bucket, which several batches may fill together.

An object cannot be appended to, so in a bucket each log has a record of its own, ``manifest/NAME.json``, written when
all its results are there; without it they do not count. manifest.jsonl and fleet.csv gather the records at the end.
"""

import os
import shutil
import socket
import tempfile
import time
from collections import deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing, contextmanager, suppress
from pathlib import Path
from typing import TypeAlias

from curvescan._interrupts import cleaned_up_by
from curvescan.io.files.output import HIDDEN_PREFIX, output_file
from curvescan.runs.batch.logs import name_folders, unique_name
from curvescan.runs.batch.object_store import Bucket, Claims, is_url, split_url
from curvescan.runs.batch.results import (
    FLEET,
    MANIFEST,
    WORKERS_LOG,
    BatchRecord,
    Manifest,
    fleet_table,
    open_manifest,
    parse_record,
    record_line,
)
from curvescan.runs.batch.worker import Task


@contextmanager
def open_results(out: str | os.PathLike[str]) -> "Iterator[Results]":
    """Yield the results in a folder, which nobody else writes meanwhile, or in a bucket, which others may."""
    if is_url(out):
        with open_bucket_results(os.fspath(out)) as results:
            yield results
    else:
        root = Path(out).absolute()
        with open_manifest(root) as manifest, cleaned_up_by(lambda: _remove_leftovers(root)):
            yield FolderResults(root, manifest)


class FolderResults:
    """The results in a folder of this machine; workers_log: file to which goes what the workers print."""

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
    ) -> "Iterator[TaskQueue]":
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
    """Tasks that nobody else takes."""

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


_READERS = 32
_POLL_S = 1.0  # between two looks at what other batches have done, seconds


@contextmanager
def open_bucket_results(url: str) -> "Iterator[BucketResults]":
    """Yield the results in a folder of a bucket; see :func:`open_results`."""
    address, prefix = split_url(url)
    with (
        tempfile.TemporaryDirectory(prefix="curvescan-log-") as scratch,
        cleaned_up_by(lambda: shutil.rmtree(scratch, ignore_errors=True)),
    ):
        yield BucketResults(Bucket(address), prefix, Path(scratch) / WORKERS_LOG)


class BucketResults:
    """The results in a folder of a bucket; records: what is known of each log, by its path or URL."""

    def __init__(self, bucket: Bucket, prefix: str, workers_log: Path) -> None:
        self.workers_log = workers_log
        self._bucket, self._prefix = bucket, f"{prefix}/" if prefix else ""
        self._folders = bucket.list_folders(self._prefix)
        self.records: dict[str, BatchRecord] = {}
        self._tags: dict[str, str] = {}
        self._queue: SharedTasks | None = None
        self.read_new()

    def place(self, folder: str) -> str:
        """Return the URL of a folder of results."""
        return f"{self._bucket.address}/{self._prefix}{folder}"

    def name_folders(self, logs: Sequence[str]) -> dict[str, str]:
        """Return the name of the folder of results of each log, which is the same in every batch."""
        return {log: unique_name(log) for log in logs}

    def holds(self, record: BatchRecord) -> bool:
        """Return whether there was a folder of a record when the batch began."""
        return record.folder in self._folders

    @contextmanager
    def queue(
        self, tasks: Sequence[Task], options: str, on_record: Callable[[BatchRecord], None]
    ) -> "Iterator[TaskQueue]":
        """Give out the logs that no other batch has."""
        with closing(Claims(self._bucket, f"{self._prefix}claims", options)) as claims, cleaned_up_by(claims.close):
            self._queue = SharedTasks(self, claims, tasks, on_record)
            yield self._queue
            self._queue = None

    def append(self, record: BatchRecord) -> bool:
        """Write a record and give up the claim on its log, unless another batch has taken it over."""
        queue = self._queue
        assert queue is not None, "records are written while the queue is open"
        if not queue.is_ours(record.folder):
            return False
        key = self._record_key(record.folder)
        self._tags[key] = self._bucket.write(key, record_line(record))
        self.records[record.input] = record
        queue.release(record.folder)
        return True

    def finish(self, records: Sequence[BatchRecord]) -> None:
        """Write manifest.jsonl and fleet.csv of all that the folder holds, and what the workers said."""
        self.read_new()
        everything = [self.records[log] for log in sorted(self.records)]
        self._bucket.write(f"{self._prefix}{MANIFEST}", b"".join(map(record_line, everything)))
        self._bucket.write(f"{self._prefix}{FLEET}", fleet_table(everything))
        if self.workers_log.exists() and self.workers_log.stat().st_size:
            name = f"workers-{socket.gethostname()}-{os.getpid()}.log"  # others have theirs
            self._bucket.upload(self.workers_log, f"{self._prefix}{name}")

    def read_new(self) -> list[BatchRecord]:
        """Read the records that others have written since the last look, and return them."""
        listed = {found.key: found.tag for found in self._bucket.list(f"{self._prefix}manifest")}
        changed = [key for key, tag in listed.items() if self._tags.get(key) != tag]
        new: list[BatchRecord] = []
        if not changed:
            return new
        with ThreadPoolExecutor(min(_READERS, len(changed))) as pool:
            for key, found in zip(changed, pool.map(self._bucket.read, changed), strict=True):
                self._tags[key] = listed[key]
                record = parse_record(found[0]) if found is not None else None
                if record is not None and self._record_key(record.folder) == key:
                    self.records[record.input] = record
                    new.append(record)
        return new

    def read_changed(self, folder: str) -> BatchRecord | None:
        """Return the record of a log where another batch has written it since the last look, else None."""
        key = self._record_key(folder)
        found = self._bucket.read(key)
        if found is None or self._tags.get(key) == found[1]:
            return None
        self._tags[key] = found[1]
        record = parse_record(found[0])
        if record is not None:
            self.records[record.input] = record
        return record

    def forget(self, folder: str) -> None:
        """Remove the record of a log that is run again: until it is done, what is there is not whole."""
        key = self._record_key(folder)
        if self._tags.pop(key, None) is not None:
            self._bucket.delete(key)

    def _record_key(self, folder: str) -> str:
        return f"{self._prefix}manifest/{folder}.json"


class SharedTasks:
    """Tasks that other batches may take as well."""

    def __init__(
        self, results: BucketResults, claims: Claims, tasks: Sequence[Task], on_record: Callable[[BatchRecord], None]
    ) -> None:
        self._results, self._claims, self._on_record = results, claims, on_record
        self._fresh = deque(tasks)
        self._elsewhere: dict[str, Task] = {}
        self._ours: dict[str, Task] = {}
        self._looked = time.monotonic()

    def n_left(self) -> int:
        """Return how many are neither done nor taken by this batch."""
        return len(self._fresh) + len(self._elsewhere)

    def take(self) -> Task | None:
        """Return a log that is this batch's now; None where others have all that are left."""
        while self._fresh:
            task = self._fresh.popleft()
            if self._claim(task):
                return task
        if self._elsewhere and time.monotonic() - self._looked > _POLL_S:
            self._looked = time.monotonic()
            self._drop_done()
            for task in list(self._elsewhere.values()):
                if self._claim(task):
                    return task
        return None

    def is_ours(self, name: str) -> bool:
        """Return whether a log that was given out is still this batch's; else another one's record is waited for."""
        if self._claims.confirm(name):
            return True
        self._elsewhere[name] = self._ours.pop(name)
        return False

    def release(self, name: str) -> None:
        """Give up the claim on a log, which is done."""
        del self._ours[name]
        self._claims.release(name)

    def _claim(self, task: Task) -> bool:
        """Take a task, unless another batch has it or has just done it."""
        if not self._claims.take(task.name):
            self._elsewhere[task.name] = task
            return False
        record = self._results.read_changed(task.name)  # done between the last look and the claim?
        if record is not None:
            self._claims.release(task.name)
            self._elsewhere.pop(task.name, None)
            self._on_record(record)
            return False
        self._elsewhere.pop(task.name, None)
        self._results.forget(task.name)
        self._ours[task.name] = task
        return True

    def _drop_done(self) -> None:
        for record in self._results.read_new():
            others = len(self._elsewhere) + len(self._fresh)
            self._elsewhere.pop(record.folder, None)
            self._fresh = deque(task for task in self._fresh if task.name != record.folder)
            if self.n_left() < others:
                self._on_record(record)


Results: TypeAlias = FolderResults | BucketResults
TaskQueue: TypeAlias = ListedTasks | SharedTasks
