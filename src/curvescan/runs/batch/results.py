"""The records of a batch: the lines of its manifest, and the table of all logs."""

import csv
import io
import json
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, fields
from pathlib import Path
from typing import Any

from curvescan.runs.batch.logs import LogState

MANIFEST, FLEET, WORKERS_LOG = "manifest.jsonl", "fleet.csv", "workers.log"


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
    except (ValueError, KeyError, TypeError, RecursionError):
        return None
    # the name of a folder comes from a file: it may not lead out of the batch's own
    is_name = Path(str(record.folder)).name == record.folder and record.folder not in ("", "..")
    is_safe = isinstance(record.input, str) and is_name
    return record if is_safe else None


def fleet_table(records: Sequence[BatchRecord]) -> bytes:
    """Return records as a CSV table, in UTF-8."""
    text = io.StringIO(newline="")
    writer = csv.DictWriter(text, [field.name for field in fields(BatchRecord)], lineterminator="\n")
    writer.writeheader()
    writer.writerows(map(asdict, records))
    return text.getvalue().encode("utf-8")
