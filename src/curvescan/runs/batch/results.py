"""The manifest of a batch, and the table of all logs.

A line of JSON for each log that was run, on the disk before the next one is written. A later line of the same log
replaces an earlier one. A line that was cut short when the machine failed is ignored.
"""

import csv
import io
import json
import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any, BinaryIO

from curvescan._processes import lock
from curvescan.errors import OutputError
from curvescan.runs.batch.logs import LogState

FLEET = "fleet.csv"
WORKERS_LOG = "workers.log"


def fleet_table(records: "Sequence[BatchRecord]") -> bytes:
    """Return records as a CSV table, in UTF-8."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    names = [field.name for field in fields(BatchRecord)]
    writer.writerow(names)
    writer.writerows([getattr(record, name) for name in names] for record in records)
    return text.getvalue().encode("utf-8")


MANIFEST = "manifest.jsonl"


@dataclass(frozen=True, kw_only=True)
class BatchRecord:
    """What became of one log of a batch: a line of manifest.jsonl and of fleet.csv."""

    input: str  # absolute path of the log, or its URL
    # its size, and when it was changed last (nanoseconds), before it was run
    bytes: int
    mtime_ns: int
    options: str  # digest of the job and its options
    version: str  # of curvescan
    folder: str  # where its results are, in the batch's folder
    # 0: done, 1: failed, 3: done, and the trajectory is not to be trusted; as a command of its own would exit
    exit: int
    verdict: str  # ``"trusted"``, ``"not trusted"`` or ``"failed"``
    sentence: str  # why
    seconds: float  # how long it took
    scans: int = 0  # how many scans the log has; 0 when it failed
    metres: float = 0.0  # length of the path
    etag: str = ""  # what identified the log's content in a bucket; else empty

    @property
    def is_failed(self) -> bool:
        """Whether there are no results."""
        return self.exit == 1

    def stands_for(self, log: LogState, options: str, version: str) -> bool:
        """Return whether running the log again would give what there is."""
        state = LogState(input=self.input, bytes=self.bytes, mtime_ns=self.mtime_ns, etag=self.etag)
        return not self.is_failed and (state, self.options, self.version) == (log, options, version)


class Manifest:
    """The manifest in a folder that nobody else writes meanwhile; see :func:`open_manifest`."""

    def __init__(self, path: Path, file: BinaryIO) -> None:
        self._path, self._file = path, file
        self.records = read_manifest(path)

    def append(self, record: BatchRecord) -> None:
        """Write a record, and wait until it is on the disk. Raises OutputError."""
        line = record_line(record)
        try:
            if not _ends_a_line(self._path):
                line = b"\n" + line
            self._file.write(line)
            os.fsync(self._file.fileno())
        except OSError as error:
            raise OutputError(
                f"cannot write {self._path}: {error.strerror}; the results that are listed in it stand"
            ) from error
        self.records[record.input] = record


@contextmanager
def open_manifest(folder: Path) -> Iterator[Manifest]:
    """Yield the manifest of a batch's folder, locked while the process lives: a second batch in it is refused."""
    path = folder / MANIFEST
    try:
        folder.mkdir(parents=True, exist_ok=True)
        file = path.open("ab", buffering=0)
    except OSError as error:
        raise OutputError(
            f"cannot write results to {str(folder)!r}: {error.strerror}; choose another folder"
        ) from error
    with file:
        try:
            lock(file)
        except OSError as error:
            raise OutputError(
                f"another batch writes to {str(folder)!r}: wait for it, or choose another folder"
            ) from error
        yield Manifest(path, file)


def read_manifest(path: Path) -> dict[str, BatchRecord]:
    """Return the last record of each log by its path, in the order of the lines; broken lines are left out."""
    records: dict[str, BatchRecord] = {}
    with suppress(FileNotFoundError), path.open("rb") as file:
        for line in file:
            record = parse_record(line)
            if record is not None:
                records.pop(record.input, None)
                records[record.input] = record
    return records


def record_line(record: BatchRecord) -> bytes:
    """Return a record as a line of the manifest."""
    return json.dumps(asdict(record), ensure_ascii=False).encode() + b"\n"


def parse_record(line: bytes) -> BatchRecord | None:
    """Return the record in a line of a manifest, or None where there is none."""
    try:
        values: Any = json.loads(line)
        record = BatchRecord(**{f.name: values[f.name] for f in fields(BatchRecord) if f.name in values})
    except (ValueError, KeyError, TypeError):
        return None
    # the name of a folder comes from a file: it may not lead out of the batch's own
    is_safe = isinstance(record.input, str) and Path(str(record.folder)).name == record.folder
    return record if is_safe else None


def _ends_a_line(path: Path) -> bool:
    with path.open("rb") as file:
        if file.seek(0, os.SEEK_END) == 0:
            return True
        file.seek(-1, os.SEEK_END)
        return file.read(1) == b"\n"
