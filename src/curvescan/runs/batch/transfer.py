"""A log from a bucket is fetched first, and its results are sent when all are there."""

from __future__ import annotations

import contextlib
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from curvescan.errors import LogFileError, StorageError
from curvescan.runs.batch.job import Job, JobResult
from curvescan.runs.batch.logs import BAG_MARK
from curvescan.runs.batch.storage.locks import lock
from curvescan.runs.batch.storage.object_store import Bucket, StoredObject, is_url, split_url

SCRATCH_PREFIX = "curvescan-batch-"
_LOCK = ".in-use"


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
    parts = [one] if one is not None else [o for o in bucket.list(key) if _parent(o) == key]
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
    """Yield a temporary folder; those of processes that were killed are removed on the way."""
    _remove_abandoned(Path(tempfile.gettempdir()))
    folder = Path(tempfile.mkdtemp(prefix=SCRATCH_PREFIX))
    try:
        with (folder / _LOCK).open("ab") as file:
            lock(file)
            yield folder
    finally:
        shutil.rmtree(folder, ignore_errors=True)


def _remove_abandoned(place: Path) -> None:
    for held in place.glob(f"{SCRATCH_PREFIX}*/{_LOCK}"):
        # somebody else's, or in use
        with contextlib.suppress(OSError):
            with held.open("ab") as file:
                lock(file)
            shutil.rmtree(held.parent, ignore_errors=True)


def _parent(found: StoredObject) -> str:
    return found.key.rpartition("/")[0]


def _safe_name(key: str) -> str:
    """Return the last part of a key as the name of a file; the names of objects may be no names of files."""
    name = key.rpartition("/")[2].replace("\\", "_").replace("\x00", "_")
    return name if name not in ("", ".", "..") else "log"
