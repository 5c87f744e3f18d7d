"""Jobs for the tests of batches, in a module of their own: workers load them by name."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass

from curvescan.runs.batch.job import JobResult


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
            is_trusted=not is_odd,
            sentence="not to be trusted: odd" * is_odd,
            n_scans=log.stat().st_size,
            length=1.5,
        )

    def warm_up(self):
        pass


@dataclass(frozen=True, kw_only=True)
class UnloadableJob(NamedJob):
    """Cannot be loaded by a worker."""

    def __reduce__(self):
        return (_refuse, ())


def _refuse():
    raise ImportError("this machine lacks a part of it")
