"""The supervisor of a batch's workers: gives out logs, starts anew what has died, stops what is overdue.

A process pool of the standard library is broken once a worker dies, and all logs that wait are lost with it. What the
workers are (processes of this machine, actors of a Ray cluster) is the business of a pool.
"""

import math
import os
import pickle
import signal
import subprocess
import threading
import time
from collections.abc import Generator
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from queue import Empty, SimpleQueue
from typing import BinaryIO, Protocol, TypeAlias

from curvescan._interrupts import cleaned_up_by, held_back
from curvescan._processes import n_usable_cores, python_command
from curvescan._version import __version__
from curvescan.errors import InvalidArgumentError, WorkerError
from curvescan.runs.batch.jobs import Job, JobResult
from curvescan.runs.batch.places import TaskQueue
from curvescan.runs.batch.worker import Failure, Ready, Reply, Task

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

    def start(self, job: bytes, events: "SimpleQueue[Event]") -> "WorkerProcess":
        """Start a process with a pickled job."""
        return WorkerProcess(job, events, self._log)

    def close(self) -> None:
        """Do nothing: processes end with their pipes."""


class WorkerProcess:
    """A worker process; see :class:`.workers.Worker`."""

    def __init__(self, job: bytes, events: "SimpleQueue[Event]", log: Path) -> None:
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


def _hear(worker: WorkerProcess, replies: BinaryIO, events: "SimpleQueue[Event]") -> None:
    with replies, suppress(EOFError, OSError, pickle.UnpicklingError):
        while True:
            events.put((worker, pickle.load(replies)))
    events.put((worker, None))


_MAX_FALSE_STARTS = 3
_LONGEST_WAIT_S = 1.0


class Worker(Protocol):
    """A worker, seen from the supervisor; its replies come as :data:`Event`."""

    def send(self, task: Task) -> bool:
        """Give a task, and return whether the worker is there to take it."""

    def cause_of_death(self) -> str:
        """Return how it ended, as a sentence."""

    def kill(self) -> None:
        """End it at once."""

    def dismiss(self) -> None:
        """Let it end; do not wait for it."""

    def end(self) -> None:
        """Wait until it has ended, and make it end where it does not."""


Event: TypeAlias = "tuple[Worker, Reply | None]"  # a worker and its reply; None when it has died


class WorkerPool(Protocol):
    """Where workers come from."""

    n_workers: int
    """How many there may be at once."""

    def warm_up(self, job: Job) -> None:
        """Compile what the job needs, once on each machine."""

    def start(self, job: bytes, events: SimpleQueue[Event]) -> Worker:
        """Start a worker with a pickled job; its first reply is `Ready`."""

    def close(self) -> None:
        """Give back what the pool has taken."""


@dataclass(frozen=True, kw_only=True)
class Done:
    """What became of a task."""

    task: Task  # the task
    result: JobResult | str  # what came of it, or the sentence why nothing did
    seconds: float  # time since it was given to a worker


@dataclass(eq=False)
class _Assignment:
    """A worker and what it is doing."""

    worker: Worker
    task: Task | None = None
    begun: float = math.inf
    is_ready: bool = False

    @property
    def seconds(self) -> float:
        """Time since the task was given; -inf without one."""
        return time.monotonic() - self.begun

    def begin(self, task: Task) -> bool:
        if not self.worker.send(task):
            return False
        self.task, self.begun = task, time.monotonic()
        return True

    def done(self, result: JobResult | str) -> Done:
        """Return what became of the task; the worker is free again."""
        assert self.task is not None
        done = Done(task=self.task, result=result, seconds=self.seconds)
        self.task, self.begun = None, math.inf
        return done


def run_tasks(
    job: Job, queue: TaskQueue, *, pool: WorkerPool, timeout: float, log: Path
) -> Generator[Done, None, None]:
    """Run a job over logs on workers, and yield what becomes of each as soon as it is known.

    Close the generator to end the workers early. timeout: of one task, seconds; inf for any. Raises
    InvalidArgumentError, WorkerError.
    """
    sent, assigned = _pickled(job), dict[Worker, _Assignment]()
    # a supervisor that a signal ends at once cannot wait for its workers
    with cleaned_up_by(lambda: _kill(assigned)):
        yield from _supervise(sent, queue, assigned, pool=pool, timeout=timeout, log=log)


def _supervise(
    job: bytes, queue: TaskQueue, assigned: dict[Worker, _Assignment], *, pool: WorkerPool, timeout: float, log: Path
) -> Generator[Done, None, None]:
    events: SimpleQueue[Event] = SimpleQueue()
    waiting: Task | None = None
    n_false_starts = 0
    try:
        while True:
            n_busy = sum(one.task is not None for one in assigned.values())
            n_left = queue.n_left() + (waiting is not None)
            if not n_busy and not n_left:
                return
            while len(assigned) < min(pool.n_workers, n_left + n_busy):
                with held_back():  # a signal kills those assigned: none may start unseen
                    worker = pool.start(job, events)
                    assigned[worker] = _Assignment(worker)
            for one in assigned.values():
                if one.is_ready and one.task is None:
                    waiting = waiting or queue.take()
                    if waiting is not None and one.begin(waiting):
                        waiting = None
            try:
                worker, reply = events.get(timeout=_until_next(assigned, timeout))
            except Empty:
                for overdue in [one for one in assigned.values() if one.seconds > timeout]:
                    yield _stopped(assigned, overdue, timeout)
                continue
            if worker not in assigned:
                continue  # the last word of one that was stopped
            one = assigned[worker]
            if isinstance(reply, Ready):
                _check_version(reply)
                one.is_ready, n_false_starts = True, 0
            elif reply is not None:
                yield one.done(_said(reply, log))
            else:
                del assigned[worker]
                worker.end()
                if one.task is not None:
                    yield one.done(worker.cause_of_death())
                n_false_starts += not one.is_ready
                if n_false_starts >= _MAX_FALSE_STARTS:
                    raise WorkerError(f"the workers cannot be started: {_last_line(log) or worker.cause_of_death()}")
    finally:
        for worker in assigned:
            worker.dismiss()
        for worker in assigned:
            worker.end()


def _kill(assigned: dict[Worker, _Assignment]) -> None:
    for worker in tuple(assigned):
        worker.kill()
    for worker in tuple(assigned):
        worker.end()


def _stopped(assigned: dict[Worker, _Assignment], one: _Assignment, timeout: float) -> Done:
    del assigned[one.worker]
    one.worker.kill()
    one.worker.end()
    return one.done(f"stopped after {timeout:g} s, the time that a log may take: try timeout={10 * timeout:g}")


def _said(reply: JobResult | Failure, log: Path) -> JobResult | str:
    if isinstance(reply, JobResult):
        return reply
    if reply.traceback:
        # a full disk costs the traceback, not the batch
        with suppress(OSError), log.open("a", encoding="utf-8") as file:
            file.write(reply.traceback)
    return reply.sentence


def _check_version(reply: Ready) -> None:
    if reply.version != __version__:
        raise WorkerError(
            f"a worker has curvescan {reply.version}, and this is {__version__}: install the same on all machines"
        )


def _until_next(assigned: dict[Worker, _Assignment], timeout: float) -> float:
    """Return how long to wait for a reply before looking for one that is overdue, seconds."""
    left = min((timeout - one.seconds for one in assigned.values()), default=math.inf)
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
    lines = log.read_text("utf-8", "replace").split("\n") if log.exists() else []
    return next((line.strip() for line in reversed(lines) if line.strip()), "")
