"""Results: what a batch asks of the place of its results, with the names and the table of every place."""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager
from dataclasses import fields
from pathlib import Path
from typing import Protocol

from curvescan.runs.batch.results.manifest import BatchRecord
from curvescan.runs.batch.worker import Task

FLEET = "fleet.csv"
WORKERS_LOG = "workers.log"


class TaskQueue(Protocol):
    """The logs that a batch has to run."""

    def take(self) -> Task | None:
        """Return the next one, or None where there is none at the moment."""

    def n_left(self) -> int:
        """Return how many may still come."""


class Results(Protocol):
    """The results of a batch, and the records of what became of each log."""

    workers_log: Path
    """File to which goes what the workers print."""
    records: dict[str, BatchRecord]
    """What is known of each log, by its path or URL."""

    def place(self, folder: str) -> str:
        """Return the path or URL of a folder of results."""

    def name_folders(self, logs: Sequence[str]) -> dict[str, str]:
        """Return the name of the folder of results of each log."""

    def holds(self, record: BatchRecord) -> bool:
        """Return whether the results of a record are there."""

    def queue(
        self, tasks: Sequence[Task], options: str, on_record: Callable[[BatchRecord], None]
    ) -> AbstractContextManager[TaskQueue]:
        """Give out logs; `on_record` is called for those that another batch has run meanwhile."""

    def append(self, record: BatchRecord) -> bool:
        """Keep a record, and return whether it was still this batch's to write."""

    def finish(self, records: Sequence[BatchRecord]) -> None:
        """Write the table of all."""


def fleet_table(records: Sequence[BatchRecord]) -> bytes:
    """Return records as a CSV table, in UTF-8."""
    text = io.StringIO(newline="")
    writer = csv.writer(text, lineterminator="\n")
    names = [field.name for field in fields(BatchRecord)]
    writer.writerow(names)
    writer.writerows([getattr(record, name) for name in names] for record in records)
    return text.getvalue().encode("utf-8")
