"""Workers that are processes of this machine; see :class:`.workers.WorkerPool`."""

from __future__ import annotations

import os
import pickle
import signal
import subprocess
import threading
from contextlib import suppress
from pathlib import Path
from queue import SimpleQueue
from typing import BinaryIO

from curvescan._processes import n_usable_cores, python_command
from curvescan.runs.batch.job import Job
from curvescan.runs.batch.worker import Task
from curvescan.runs.batch.workers import Event

_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Each worker has a core: libraries that start threads of their own would share it."""
_PATIENCE_S = 2.0  # time that a worker has to end when its pipe does, seconds


class ProcessPool:
    """Starts processes. n_workers: How many there may be at once; None for as many as there are cores."""

    def __init__(self, n_workers: int | None, log: Path) -> None:
        self.n_workers = n_workers or n_usable_cores()
        self._log = log

    def warm_up(self, job: Job) -> None:
        """Compile what the job needs, in this process."""
        job.warm_up()

    def start(self, job: bytes, events: SimpleQueue[Event]) -> WorkerProcess:
        """Start a process with a pickled job."""
        return WorkerProcess(job, events, self._log)

    def close(self) -> None:
        """Do nothing: processes end with their pipes."""


class WorkerProcess:
    """A worker process; see :class:`.workers.Worker`."""

    def __init__(self, job: bytes, events: SimpleQueue[Event], log: Path) -> None:
        once = dict.fromkeys(_ONE_THREAD, "1")
        with log.open("ab") as errors:
            self._process = subprocess.Popen(
                python_command("curvescan.runs.batch.worker", "serve()"),
                env={**once, "MPLBACKEND": "Agg", **os.environ},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
            )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._requests, replies = self._process.stdin, self._process.stdout
        threading.Thread(target=_hear, args=(self, replies, events), daemon=True).start()
        self._send(job)

    def send(self, task: Task) -> bool:
        """Give a task, and return whether the process is there to take it."""
        return self._send(pickle.dumps(task))

    def cause_of_death(self) -> str:
        """Return how the process ended, as a sentence."""
        code = self._process.wait()
        if code >= 0:
            return f"its worker process ended with exit status {code} (see workers.log)"
        with suppress(ValueError):
            name = signal.Signals(-code).name
            memory = ": out of memory?" if name == "SIGKILL" else " (see workers.log)"
            return f"its worker process was ended by {name}{memory}"
        return f"its worker process was ended by signal {-code} (see workers.log)"

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()

    def dismiss(self) -> None:
        """Let the process end; it does so as soon as its pipe ends."""
        with suppress(OSError):
            self._requests.close()

    def end(self) -> None:
        """Wait until the process has ended, and make it end where it does not."""
        self.dismiss()
        try:
            self._process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self._process.kill()
            self._process.wait()

    def _send(self, message: bytes) -> bool:
        try:
            pickle.dump(message, self._requests)
            self._requests.flush()
        except OSError:  # it has died, as its own pipe will tell
            return False
        return True


def _hear(worker: WorkerProcess, replies: BinaryIO, events: SimpleQueue[Event]) -> None:
    with replies, suppress(EOFError, OSError, pickle.UnpicklingError):
        while True:
            events.put((worker, pickle.load(replies)))
    events.put((worker, None))
