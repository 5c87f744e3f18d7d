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
from typing import BinaryIO, TypeAlias

from curvescan._interrupts import cleaned_up_by
from curvescan._processes import lock
from curvescan.errors import OutputError
from curvescan.io.files.output import HIDDEN_PREFIX, output_file
from curvescan.runs.batch.logs import name_folders, unique_name
from curvescan.runs.batch.object_store import Bucket, Claims, is_url, split_url
from curvescan.runs.batch.results import (
    FLEET,
    MANIFEST,
    WORKERS_LOG,
    BatchRecord,
    fleet_table,
    parse_record,
    read_manifest,
    record_line,
)
from curvescan.runs.batch.worker import Task


@contextmanager
def open_results(out: str | os.PathLike[str]) -> "Iterator[Results]":
    """Yield the results in a folder, which nobody else writes meanwhile, or in a bucket, which others may."""
    if is_url(out):
        address, prefix = split_url(os.fspath(out))
        with (
            tempfile.TemporaryDirectory(prefix="curvescan-log-") as scratch,
            cleaned_up_by(lambda: shutil.rmtree(scratch, ignore_errors=True)),
        ):
            yield BucketResults(Bucket(address), prefix, Path(scratch) / WORKERS_LOG)
        return
    root = Path(out).absolute()
    try:
        root.mkdir(parents=True, exist_ok=True)
        file = (root / MANIFEST).open("ab", buffering=0)
    except OSError as error:
        raise OutputError(f"cannot write results to {str(root)!r}: {error.strerror}; choose another folder") from error
    with file:
        try:
            lock(file)  # while the process lives: a second batch in the folder is refused
        except OSError as error:
            raise OutputError(
                f"another batch writes to {str(root)!r}: wait for it, or choose another folder"
            ) from error
        with cleaned_up_by(lambda: _remove_leftovers(root)):
            yield FolderResults(root, file)


class FolderResults:
    """The results in a folder of this machine, and the logs that are left to run.

    workers_log: file to which goes what the workers print; records: what is known of each log, by its path.
    """

    def __init__(self, root: Path, manifest: BinaryIO) -> None:
        self.workers_log = root / WORKERS_LOG
        self._root, self._manifest = root, manifest
        self.records = read_manifest(root / MANIFEST)
        text = (root / MANIFEST).read_bytes()
        self._before = b"\n" if text and not text.endswith(b"\n") else b""  # the last line may have been cut short
        self._waiting: deque[Task] = deque()
        _remove_leftovers(root)

    def place(self, folder: str) -> str:
        """Return the path of a folder of results."""
        return str(self._root / folder)

    def name_folders(self, logs: Sequence[str]) -> dict[str, str]:
        """Return the name of each log's results folder. A log that has a folder already keeps it."""
        known = {log: record.folder for log, record in self.records.items()}
        return name_folders(logs, known, (MANIFEST, FLEET, WORKERS_LOG))

    def holds(self, record: BatchRecord) -> bool:
        """Return whether the folder of a record is there."""
        return (self._root / record.folder).is_dir()

    @contextmanager
    def giving_out(
        self, tasks: Sequence[Task], options: str, on_record: Callable[[BatchRecord], None]
    ) -> Iterator[None]:
        """Give out tasks, in their order."""
        self._waiting.extend(tasks)
        yield

    def take(self) -> Task | None:
        """Return the next task, or None after the last."""
        return self._waiting.popleft() if self._waiting else None

    def n_left(self) -> int:
        """Return how many tasks wait."""
        return len(self._waiting)

    def append(self, record: BatchRecord) -> bool:
        """Write a record, and wait until the results, and then it, are on the disk."""
        if not record.is_failed:
            _sync(self._root / record.folder)
        path = self._root / MANIFEST
        try:
            self._manifest.write(self._before + record_line(record))
            os.fsync(self._manifest.fileno())
        except OSError as error:
            raise OutputError(
                f"cannot write {path}: {error.strerror}; the results that are listed in it stand"
            ) from error
        self._before = b""
        self.records[record.input] = record
        return True

    def finish(self) -> None:
        """Write fleet.csv of all that the manifest has, by the newest record of each log."""
        with output_file(self._root / FLEET) as temporary:
            temporary.write_bytes(fleet_table([self.records[log] for log in sorted(self.records)]))
        _remove_leftovers(self._root)


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


class BucketResults:
    """The results in a folder of a bucket, and the logs that are left to run, which other batches may take as well.

    workers_log: file to which goes what the workers print; records: what is known of each log, by its path or URL.
    """

    _claims: Claims
    _on_record: Callable[[BatchRecord], None]

    def __init__(self, bucket: Bucket, prefix: str, workers_log: Path) -> None:
        self.workers_log = workers_log
        self._bucket, self._prefix = bucket, f"{prefix}/" if prefix else ""
        self._folders = bucket.list_folders(self._prefix)
        self.records: dict[str, BatchRecord] = {}
        self._tags: dict[str, str] = {}
        # tasks by the names of their folders: not asked for yet, of other batches, given out
        self._fresh: dict[str, Task] = {}
        self._elsewhere: dict[str, Task] = {}
        self._ours: dict[str, Task] = {}
        self._looked = time.monotonic()
        self._read_new()

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
    def giving_out(
        self, tasks: Sequence[Task], options: str, on_record: Callable[[BatchRecord], None]
    ) -> Iterator[None]:
        """Give out the tasks that no other batch has, and tell of those that another one has done."""
        with closing(Claims(self._bucket, f"{self._prefix}claims", options)) as claims, cleaned_up_by(claims.close):
            self._claims, self._on_record = claims, on_record
            self._fresh = {task.name: task for task in tasks}
            yield

    def n_left(self) -> int:
        """Return how many tasks are neither done nor taken by this batch."""
        return len(self._fresh) + len(self._elsewhere)

    def take(self) -> Task | None:
        """Return a task that is this batch's now; None where others have all that are left."""
        while self._fresh:
            task = self._fresh.pop(next(iter(self._fresh)))
            if self._claim(task):
                return task
        if self._elsewhere and time.monotonic() - self._looked > _POLL_S:
            self._looked = time.monotonic()
            for record in self._read_new():
                if self._elsewhere.pop(record.folder, None) is not None:
                    self._on_record(record)
            return next((task for task in list(self._elsewhere.values()) if self._claim(task)), None)
        return None

    def append(self, record: BatchRecord) -> bool:
        """Write a record and give up the claim on its log, unless another batch has taken it over."""
        if not self._claims.confirm(record.folder):
            self._elsewhere[record.folder] = self._ours.pop(record.folder)  # the other one's record is waited for
            return False
        key = self._record_key(record.folder)
        self._tags[key] = self._bucket.write(key, record_line(record))
        self.records[record.input] = record
        del self._ours[record.folder]
        self._claims.release(record.folder)
        return True

    def finish(self) -> None:
        """Write manifest.jsonl and fleet.csv of all that the folder holds, and what the workers said."""
        self._read_new()
        everything = [self.records[log] for log in sorted(self.records)]
        self._bucket.write(f"{self._prefix}{MANIFEST}", b"".join(map(record_line, everything)))
        self._bucket.write(f"{self._prefix}{FLEET}", fleet_table(everything))
        if self.workers_log.exists() and self.workers_log.stat().st_size:
            name = f"workers-{socket.gethostname()}-{os.getpid()}.log"  # others have theirs
            self._bucket.upload(self.workers_log, f"{self._prefix}{name}")

    def _claim(self, task: Task) -> bool:
        """Take a task, unless another batch has it or has just done it."""
        if not self._claims.take(task.name):
            self._elsewhere[task.name] = task
            return False
        self._elsewhere.pop(task.name, None)
        key = self._record_key(task.name)
        if new := self._read([key]):  # done between the last look and the claim
            self._claims.release(task.name)
            self._on_record(new[0])
            return False
        # until the log is done, what is there is not whole
        if self._tags.pop(key, None) is not None:
            self._bucket.delete(key)
        self._ours[task.name] = task
        return True

    def _read_new(self) -> list[BatchRecord]:
        """Read the records that others have written since the last look, and return them."""
        listed = self._bucket.list(f"{self._prefix}manifest")
        return self._read([found.key for found in listed if self._tags.get(found.key) != found.tag])

    def _read(self, keys: Sequence[str]) -> list[BatchRecord]:
        """Read records, and return those that others have written since the last look."""
        new: list[BatchRecord] = []
        with ThreadPoolExecutor(_READERS) as pool:
            for key, found in zip(keys, pool.map(self._bucket.read, keys), strict=True):
                if found is None or self._tags.get(key) == found[1]:
                    continue
                self._tags[key] = found[1]
                record = parse_record(found[0])
                if record is not None and self._record_key(record.folder) == key:
                    self.records[record.input] = record
                    new.append(record)
        return new

    def _record_key(self, folder: str) -> str:
        return f"{self._prefix}manifest/{folder}.json"


Results: TypeAlias = FolderResults | BucketResults
