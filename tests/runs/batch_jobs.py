"""Jobs for the tests of batches, in a module of their own: workers load them by name."""

from __future__ import annotations

import os
import signal
import time
from dataclasses import dataclass

from curvescan.diagnostics.verdict import Verdict
from curvescan.runs.jobs import JobResult


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
            print("not a reply", flush=True)
            os.write(1, b"nor this")
        folder.mkdir(exist_ok=True)
        (folder / "result").write_text(f"{log} {os.getpid()}")
        reasons = ("odd",) if "odd" in log.name else ()
        verdict = Verdict(is_trusted=not reasons, reasons=reasons)
        return JobResult(verdict=verdict, n_scans=log.stat().st_size, length=1.5)

    def warm_up(self):
        pass


@dataclass(frozen=True, kw_only=True)
class UnloadableJob(NamedJob):
    """Cannot be loaded by a worker."""

    def __reduce__(self):
        return (_refuse, ())


def _refuse():
    raise ImportError("this machine lacks a part of it")
