"""A worker of a batch: a process that runs one job over one log after another, driven by pipes.

Messages are pickled: first the job, answered by the version, then tasks, each answered by a JobResult or a Failure.
When the supervisor is gone the pipe ends, and the worker with it. Logs and results may be in buckets.
"""

import os
import pickle
import re
import shutil
import signal
import tempfile
import threading
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import BinaryIO, TypeAlias

from curvescan._version import __version__
from curvescan.errors import CurvescanError, LogFileError, StorageError
from curvescan.io.files.output import hidden_folder
from curvescan.runs.batch.jobs import Job, JobResult
from curvescan.runs.batch.logs import BAG_MARK
from curvescan.runs.batch.object_store import Bucket, is_url, split_url


def run_job(job: Job, log: str, folder: str) -> JobResult:
    """Run a job over a log, either of them here or in a bucket. Raises CurvescanError."""
    if not is_url(log) and not is_url(folder):
        return job(Path(log), Path(folder))
    with scratch_folder() as scratch:
        source = download(log, scratch / "log") if is_url(log) else Path(log)
        results = scratch / "results" if is_url(folder) else Path(folder)
        result = job(source, results)
        if is_url(folder):
            upload(results, folder)
    return result


def download(url: str, folder: Path) -> Path:
    """Fetch a log, an object or all those of a ROS 2 bag, into a new folder, and return its path there."""
    address, key = split_url(url)
    bucket = Bucket(address)
    folder.mkdir()
    one = bucket.find(key)
    parts = [one] if one is not None else [o for o in bucket.list(key) if o.key.rpartition("/")[0] == key]
    if one is None and not any(part.key == f"{key}/{BAG_MARK}" for part in parts):
        raise LogFileError(f"{url} is gone: list the logs again")
    size, free = sum(part.size for part in parts), shutil.disk_usage(folder).free
    if size > free:
        raise StorageError(
            f"{url} has {size / 1e6:,.0f} MB, and {folder.parent.parent} has room for {free / 1e6:,.0f} MB: "
            "set TMPDIR to a folder with more"
        )
    target = folder / _safe_name(key)
    if one is None:
        target.mkdir()
    try:
        for part in parts:
            bucket.download(part, target if one is not None else target / _safe_name(part.key))
    except OSError as error:
        if isinstance(error, StorageError):
            raise
        raise StorageError(
            f"cannot fetch {url} to {folder.parent.parent}: {error.strerror or error}; set TMPDIR to another folder"
        ) from error
    return target


def upload(folder: Path, url: str) -> None:
    """Make a folder of a bucket hold the files of a folder and no others; run.json comes last."""
    address, prefix = split_url(url)
    bucket = Bucket(address)
    files = [path for path in folder.rglob("*") if path.is_file()]
    sent = set()
    for file in sorted(files, key=lambda path: (path.name == "run.json", path)):
        key = f"{prefix}/{file.relative_to(folder).as_posix()}"
        bucket.upload(file, key)
        sent.add(key)
    for old in bucket.list(prefix):  # of an earlier run with other options
        if old.key not in sent:
            bucket.delete(old.key)


@contextmanager
def scratch_folder() -> Iterator[Path]:
    """Yield a temporary folder for nobody else's eyes; those of processes that were killed are removed on the way."""
    with hidden_folder(Path(tempfile.gettempdir())) as folder:
        folder.chmod(0o700)
        yield folder


def _safe_name(key: str) -> str:
    """Return the last part of a key as the name of a file; the names of objects may be no names of files."""
    name = key.rpartition("/")[2].replace("\\", "_").replace("\x00", "_")
    return name if name not in ("", ".", "..") else "log"


@dataclass(frozen=True, kw_only=True)
class Task:
    """One log for a worker."""

    log: str  # path or URL of the file or folder
    folder: str  # path or URL of the folder where its results go

    @property
    def name(self) -> str:
        """Name of the folder of results."""
        return re.split(r"[/\\]", self.folder)[-1]


@dataclass(frozen=True, kw_only=True)
class Failure:
    """There are no results."""

    sentence: str  # why
    traceback: str = ""  # where in the program, when nobody expected it; else empty


Reply: TypeAlias = str | JobResult | Failure
"""What a worker says: the version of its curvescan when it has loaded the job, then what came of each log."""


def serve() -> None:
    """Answer the supervisor at the other end of stdin and stdout until it ends the pipe."""
    # Ctrl-C reaches every process of a terminal: the supervisor decides what becomes of the workers
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not stand between the replies
    messages: SimpleQueue[bytes | Task] = SimpleQueue()
    requests = os.fdopen(os.dup(0), "rb")
    threading.Thread(target=_listen, args=(requests, messages), daemon=True).start()
    desk = Desk()
    while True:
        reply = desk.answer(messages.get())
        try:
            pickle.dump(reply, replies)
            replies.flush()
        except OSError:
            os._exit(0)


class Desk:
    """Answers messages: first the job, pickled, then one task after another."""

    _job: Job

    def answer(self, message: bytes | Task) -> Reply:
        """Load the job, or run it over a log; whatever goes wrong with a log is an answer too."""
        if isinstance(message, bytes):
            self._job = pickle.loads(message)
            return __version__
        try:
            return run_job(self._job, message.log, message.folder)
        except CurvescanError as error:
            return Failure(sentence=str(error))
        except Exception as error:  # noqa: BLE001 - a log that fails does not stop the others
            said = f": {error}" if str(error) else ""
            sentence = f"{type(error).__name__}{said} (its traceback is in workers.log)"
            return Failure(sentence=sentence, traceback=traceback.format_exc())


def _listen(requests: BinaryIO, messages: SimpleQueue[bytes | Task]) -> None:
    try:
        while True:
            messages.put(pickle.load(requests))
    except (EOFError, OSError, pickle.UnpicklingError):
        os._exit(0)  # also in the middle of a log: nobody waits for it any more
