"""A worker of a batch: a process that runs one job over one log after another, driven by pipes.

Messages are pickled, both ways. First comes the job, answered by `Ready`; then tasks, each answered by a `JobResult`
or by the sentence why there is none. When the supervisor is gone, however it went, the pipe ends and the worker with it.
"""

from __future__ import annotations

import os
import pickle
import signal
import sys
import threading
import traceback
from dataclasses import dataclass
from pathlib import Path
from queue import SimpleQueue
from typing import BinaryIO

from curvescan.errors import CurvescanError
from curvescan.runs.batch.job import Job, JobResult


@dataclass(frozen=True)
class Ready:
    """The job is loaded."""


@dataclass(frozen=True, kw_only=True)
class Task:
    """One log for a worker.

    Attributes
    ----------
    log : Path
        The file or folder.
    folder : Path
        Where its results go.
    """

    log: Path
    folder: Path


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
        _send(replies, _answer(job, task))


def _answer(job: Job, task: Task) -> JobResult | str:
    try:
        return job(task.log, task.folder)
    except CurvescanError as error:
        return str(error)
    except Exception as error:  # noqa: BLE001 - one bad log stops no other
        print(f"{task.log}:", file=sys.stderr)  # noqa: T201 - the log of the workers
        traceback.print_exc()
        said = f": {error}" if str(error) else ""
        return f"{type(error).__name__}{said} (its traceback is in workers.log)"


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
