"""The supervisor of a batch's workers: gives out logs, starts anew what has died, stops what is overdue.

A process pool of the standard library is broken once a worker dies, and all logs that wait are lost with it.
"""

from __future__ import annotations

import math
import os
import pickle
import signal
import subprocess
import sys
import threading
import time
from collections import deque
from collections.abc import Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import BinaryIO, TypeAlias

from curvescan._interrupts import cleaned_up_by
from curvescan.errors import InvalidArgumentError, WorkerError
from curvescan.runs.batch.job import Job, JobResult
from curvescan.runs.batch.worker import Ready, Task

_SERVE = "import sys; sys.path[:] = {}; from curvescan.runs.batch.worker import serve; serve()"
_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Each worker has a core: libraries that start threads of their own would share it."""
_MAX_FALSE_STARTS = 3
_LONGEST_WAIT_S = 1.0
_PATIENCE_S = 2.0
"""Time that a worker has to end when its pipe does, seconds."""


@dataclass(frozen=True, kw_only=True)
class Done:
    """What became of a task.

    Attributes
    ----------
    task : Task
        The task.
    result : JobResult or str
        What came of it, or the sentence why nothing did.
    seconds : float
        Time since it was given to a worker.
    """

    task: Task
    result: JobResult | str
    seconds: float


def run_tasks(
    job: Job, tasks: Sequence[Task], *, n_workers: int, timeout: float, log: Path
) -> Generator[Done, None, None]:
    """Yield what becomes of each task, in the order in which they end.

    Close the generator to end the workers before all is done.

    Parameters
    ----------
    job : Job
        What is done with each.
    tasks : sequence of Task
        Given out in their order.
    n_workers : int
        How many processes to run.
    timeout : float
        Time that one task may take, seconds; inf for any.
    log : Path
        File to which goes what the workers print.

    Raises
    ------
    InvalidArgumentError
        When the job cannot be sent to another process.
    WorkerError
        When workers die before they have begun.
    """
    sent, workers = _pickled(job), set[_Worker]()
    # a supervisor that a signal ends at once cannot wait for its workers
    with cleaned_up_by(lambda: _kill(workers)):
        yield from _supervise(sent, tasks, workers, n_workers=n_workers, timeout=timeout, log=log)


def _supervise(
    job: bytes,
    tasks: Sequence[Task],
    workers: set[_Worker],
    *,
    n_workers: int,
    timeout: float,
    log: Path,
) -> Generator[Done, None, None]:
    waiting = deque(tasks)
    events: SimpleQueue[Event] = SimpleQueue()
    n_false_starts = 0
    try:
        while waiting or any(worker.task for worker in workers):
            n_wanted = min(n_workers, len(waiting) + sum(bool(w.task) for w in workers))
            while len(workers) < n_wanted:
                workers.add(_Worker(job, events, log))
            try:
                worker, reply = events.get(timeout=_until_next(workers, timeout))
            except Empty:
                for overdue in [w for w in workers if w.seconds > timeout]:
                    workers.remove(overdue)
                    yield overdue.stop(
                        f"stopped after {timeout:g} s, the time that a log may take: try timeout={10 * timeout:g}"
                    )
                continue
            if worker not in workers:
                continue  # the last word of one that was stopped
            if worker.task is not None and not isinstance(reply, Ready):
                if reply is None:
                    workers.remove(worker)
                    yield worker.stop(worker.cause_of_death())
                    continue
                yield worker.done(reply)
            elif reply is None:
                workers.remove(worker)
                worker.end()
                n_false_starts += not worker.is_ready
                if n_false_starts >= _MAX_FALSE_STARTS:
                    raise WorkerError(f"the worker processes cannot be started: {_last_line(log)}")
                continue
            worker.is_ready, n_false_starts = True, 0
            if waiting and worker.begin(waiting[0]):
                waiting.popleft()
    finally:
        for worker in workers:
            worker.end_pipe()
        for worker in workers:
            worker.end()


class _Worker:
    """A worker process, seen from the supervisor."""

    def __init__(self, job: bytes, events: SimpleQueue[Event], log: Path) -> None:
        paths = [str(Path(entry).absolute()) for entry in sys.path]
        once = dict.fromkeys(_ONE_THREAD, "1")
        with log.open("ab") as errors:
            self._process = subprocess.Popen(
                [sys.executable, "-c", _SERVE.format(paths)],
                env={**once, "MPLBACKEND": "Agg", **os.environ, "CURVESCAN_COMPILE_HELPERS": "0"},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
            )
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        self._requests, replies = self._process.stdin, self._process.stdout
        self.task: Task | None = None
        self.is_ready = False
        self._begun = math.inf
        threading.Thread(target=_hear, args=(self, replies, events), daemon=True).start()
        self._send(job)

    @property
    def seconds(self) -> float:
        """Time since the task was given; -inf without one."""
        return time.monotonic() - self._begun

    def begin(self, task: Task) -> bool:
        """Give a task, and return whether the worker is there to take it."""
        if not self._send(pickle.dumps(task)):
            return False
        self.task, self._begun = task, time.monotonic()
        return True

    def done(self, result: JobResult | str) -> Done:
        """Return what became of the task; the worker is free again."""
        assert self.task is not None
        done = Done(task=self.task, result=result, seconds=self.seconds)
        self.task, self._begun = None, math.inf
        return done

    def stop(self, why: str) -> Done:
        """End the process at once, and return that its task failed and why."""
        self.kill()
        done = self.done(why)
        self.end()
        return done

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.wait()

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

    def end_pipe(self) -> None:
        """Let the process end; it does so as soon as its pipe ends."""
        with suppress(OSError):
            self._requests.close()

    def end(self) -> None:
        """Wait until the process has ended, and make it end where it does not."""
        self.end_pipe()
        try:
            self._process.wait(_PATIENCE_S)
        except subprocess.TimeoutExpired:
            self.kill()

    def _send(self, message: bytes) -> bool:
        try:
            pickle.dump(message, self._requests)
            self._requests.flush()
        except OSError:  # it has died, as its own pipe will tell
            return False
        return True


Event: TypeAlias = "tuple[_Worker, Ready | JobResult | str | None]"
"""A worker and its reply; None when it has died."""


def _hear(worker: _Worker, replies: BinaryIO, events: SimpleQueue[Event]) -> None:
    with replies, suppress(EOFError, OSError, pickle.UnpicklingError):
        while True:
            events.put((worker, pickle.load(replies)))
    events.put((worker, None))


def _kill(workers: set[_Worker]) -> None:
    for worker in tuple(workers):
        worker.kill()


def _until_next(workers: set[_Worker], timeout: float) -> float:
    """Return how long to wait for a reply before looking for one that is overdue, seconds."""
    left = min((timeout - worker.seconds for worker in workers), default=math.inf)
    # never without end: on Windows, Ctrl-C does not end a wait
    return min(max(left, 0.0) + 1e-3, _LONGEST_WAIT_S)


def _pickled(job: Job) -> bytes:
    kind = type(job)
    rule = "a job must be an instance of a dataclass that a module defines, so that workers can load it"
    if kind.__module__ == "__main__":
        raise InvalidArgumentError(f"{rule}: move {kind.__name__} from the script into a module")
    try:
        return pickle.dumps(job)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InvalidArgumentError(f"{rule}, got {job!r:.80}: {error}") from error


def _last_line(log: Path) -> str:
    lines = log.read_text("utf-8", "replace").split("\n")
    return next((line.strip() for line in reversed(lines) if line.strip()), "they say nothing")
