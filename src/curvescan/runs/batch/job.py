"""What a batch does with each log, and what comes of it: what supervisor and workers know of each other's work."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Protocol

from curvescan.configs import as_plain


@dataclass(frozen=True, kw_only=True)
class JobResult:
    """What came of one log."""

    is_trusted: bool  # whether the trajectory can be trusted
    sentence: str  # why, or why not
    n_scans: int  # how many scans it has
    length: float  # length of the path, metres


class Job(Protocol):
    """What a batch does with each log: a frozen dataclass of a module, so that worker processes can be sent it.

    Its fields are the options; by their digest :func:`run_batch` with ``resume=True`` finds which results still stand.
    """

    def __call__(self, log: Path, folder: Path) -> JobResult:
        """Run over a log and write the results into a folder that need not exist; errors are raised."""

    def warm_up(self) -> None:
        """Compile what the job needs, once, before the workers start."""


def digest_of(job: Job) -> str:
    """Return a digest of what a job is and of its options, as 16 hexadecimal digits."""
    kind = type(job)
    fields = {
        name for name, f in getattr(kind, "__dataclass_fields__", {}).items() if not f.metadata.get("is_option", True)
    }
    plain: Any = as_plain(job)
    options = {k: v for k, v in plain.items() if k not in fields} if isinstance(plain, Mapping) else {}
    text = json.dumps([kind.__module__, kind.__qualname__, options], sort_keys=True, default=repr)
    return hashlib.sha256(text.encode()).hexdigest()[:16]
