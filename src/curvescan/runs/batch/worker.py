"""A worker of a batch: a process that runs one job over one log after another, driven by pipes.

Messages are pickled, both ways. First comes the job, answered by `Ready`; then tasks, each answered by a `JobResult`
or by a `Failure`. When the supervisor is gone, however it went, the pipe ends and the worker with it.
"""

from __future__ import annotations

import os
import pickle
import re
import signal
import threading
import traceback
from dataclasses import dataclass
from queue import SimpleQueue
from typing import BinaryIO, TypeAlias

from curvescan._version import __version__
from curvescan.errors import CurvescanError
from curvescan.runs.batch.job import Job, JobResult
from curvescan.runs.batch.transfer import run_job


@dataclass(frozen=True)
class Ready:
    """The job is loaded."""

    version: str = __version__  # of the worker's curvescan


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


Reply: TypeAlias = "Ready | JobResult | Failure"  # what a worker says


def serve() -> None:
    """Answer the supervisor at the other end of stdin and stdout until it ends the pipe."""
    # Ctrl-C reaches every process of a terminal: the supervisor decides what becomes of the workers
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    replies = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # what a library prints must not stand between the replies
    messages: SimpleQueue[bytes] = SimpleQueue()
    requests = os.fdopen(os.dup(0), "rb")
    threading.Thread(target=_listen, args=(requests, messages), daemon=True).start()
    job: Job = pickle.loads(messages.get())
    _send(replies, Ready())
    while True:
        task: Task = pickle.loads(messages.get())
        _send(replies, answer(job, task))


def answer(job: Job, task: Task) -> JobResult | Failure:
    """Run a job over a log, and return what came of it; whatever goes wrong is returned too."""
    try:
        return run_job(job, task.log, task.folder)
    except CurvescanError as error:
        return Failure(sentence=str(error))
    except Exception as error:  # noqa: BLE001 - one bad log stops no other
        said = f": {error}" if str(error) else ""
        return Failure(
            sentence=f"{type(error).__name__}{said} (its traceback is in workers.log)", traceback=traceback.format_exc()
        )


def _listen(requests: BinaryIO, messages: SimpleQueue[bytes]) -> None:
    try:
        while True:
            messages.put(pickle.load(requests))
    except (EOFError, OSError, pickle.UnpicklingError):
        os._exit(0)  # also in the middle of a log: nobody waits for it any more


def _send(replies: BinaryIO, reply: object) -> None:
    try:
        pickle.dump(reply, replies)
        replies.flush()
    except OSError:
        os._exit(0)
