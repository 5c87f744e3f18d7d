"""Jobs for the tests of batches, in a module of their own: workers load them by name."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass
from pathlib import Path

from curvescan.io.files.output import output_folder
from curvescan.runs.batch.jobs import JobResult


@dataclass(frozen=True, kw_only=True)
class NamedJob:
    """Does what the name of a log says: kill, hang, print, raise, slow; else counts its bytes."""

    option: int = 0

    def __call__(self, log, folder):
        if "kill" in log.name:
            os.kill(os.getpid(), signal.SIGKILL)
        if "exit" in log.name:
            os._exit(7)
        if "hang" in log.name:
            time.sleep(600)
        if "slow" in log.name:
            time.sleep(0.4)
        if "raise" in log.name:
            raise RuntimeError("of no known kind")
        if "print" in log.name:
            print("not a reply", flush=True)  # noqa: T201 - what workers print is no reply
            os.write(1, b"nor this")
        folder.mkdir(exist_ok=True)
        (folder / "result").write_text(f"{log} {os.getpid()}")
        is_odd = "odd" in log.name
        return JobResult(
            is_trusted=not is_odd, sentence="not to be trusted: odd" * is_odd, n_scans=log.stat().st_size, length=1.5
        )

    def warm_up(self):
        pass


@dataclass(frozen=True, kw_only=True)
class CountedJob(NamedJob):
    """Writes a line into a file each time that it begins and ends: which runs there were, however they ended."""

    tally: str

    def __call__(self, log, folder):
        self._note(f"begin {log.name}")
        result = super().__call__(log, folder)
        self._note(f"end {log.name}")
        return result

    def _note(self, line):
        with Path(self.tally).open("a") as file:
            file.write(f"{line} {os.getpid()}\n")


@dataclass(frozen=True, kw_only=True)
class LargeJob(NamedJob):
    """Writes results of 300 kB."""

    def __call__(self, log, folder):
        with output_folder(folder) as temporary:
            result = super().__call__(log, temporary)
            (temporary / "large").write_bytes(bytes(300_000))
        return result


@dataclass(frozen=True, kw_only=True)
class UnloadableJob(NamedJob):
    """Cannot be loaded by a worker."""

    def __reduce__(self):
        return (_refuse, ())


def _refuse():
    raise ImportError("this machine lacks a part of it")
