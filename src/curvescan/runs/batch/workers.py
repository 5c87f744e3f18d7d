"""The supervisor of a batch's workers: a thread for each asks it for one log after another.

A process pool of the standard library is broken once a worker dies, and all logs that wait are lost with it. Here a
worker that dies, or is stopped because its log takes too long, costs that log alone; the next log gets a new worker.
"""

import os
import pickle
import signal
import subprocess
import threading
import time
from collections.abc import Generator
from concurrent.futures import FIRST_COMPLETED, Future, ThreadPoolExecutor, wait
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TypeAlias

from curvescan._interrupts import cleaned_up_by
from curvescan._processes import n_usable_cores, python_command
from curvescan._version import __version__
from curvescan.errors import InvalidArgumentError, WorkerError
from curvescan.runs.batch.jobs import Job, JobResult
from curvescan.runs.batch.places import Results
from curvescan.runs.batch.ray_cluster import Actor, RayPool
from curvescan.runs.batch.worker import Failure, Reply, Task

_ONE_THREAD = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "NUMBA_NUM_THREADS")
"""Each worker has a core: libraries that start threads of their own would share it."""
_MAX_FALSE_STARTS = 3
_LOOK_S = 0.2  # between two looks for logs that other batches give up, and for Ctrl-C (on Windows it ends no wait)


class ProcessPool:
    """Starts processes. n_workers: How many there may be at once; None for as many as there are cores."""

    def __init__(self, n_workers: int | None, log: Path) -> None:
        self.n_workers = n_workers or n_usable_cores()
        self._log = log

    def warm_up(self, job: Job) -> None:
        """Compile what the job needs, in this process."""
        job.warm_up()

    def start(self) -> "WorkerProcess":
        """Start a process."""
        return WorkerProcess(self._log)

    def close(self) -> None:
        """Do nothing: processes end with their pipes."""


class WorkerProcess:
    """A worker process; see :func:`curvescan.runs.batch.worker.serve`."""

    def __init__(self, log: Path) -> None:
        once = dict.fromkeys(_ONE_THREAD, "1")
        with log.open("ab") as errors:
            self._process = subprocess.Popen(
                python_command("curvescan.runs.batch.worker", "serve()"),
                env={**once, "MPLBACKEND": "Agg", **os.environ},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=errors,
            )

    def ask(self, message: bytes | Task) -> Reply | None:
        """Give a pickled job or a task, and return the reply; None when the process has ended."""
        assert self._process.stdin is not None
        assert self._process.stdout is not None
        with suppress(EOFError, OSError, ValueError, pickle.UnpicklingError):
            self._process.stdin.write(pickle.dumps(message))
            self._process.stdin.flush()
            reply: Reply = pickle.load(self._process.stdout)
            return reply
        return None

    def is_alive(self) -> bool:
        """Return whether the process has not ended."""
        return self._process.poll() is None

    def cause_of_death(self) -> str:
        """Return how the process ended, as a sentence."""
        code = self._process.wait()
        if code >= 0:
            return f"its worker process ended with exit status {code} (see workers.log)"
        name = {one.value: one.name for one in signal.Signals}.get(-code, f"signal {-code}")
        more = ": out of memory?" if name == "SIGKILL" else " (see workers.log)"
        return f"its worker process was ended by {name}{more}"

    def kill(self) -> None:
        """End the process at once."""
        self._process.kill()
        self._process.wait()
        for pipe in (self._process.stdin, self._process.stdout):
            if pipe is not None:
                with suppress(OSError):
                    pipe.close()


WorkerPool: TypeAlias = ProcessPool | RayPool
Worker: TypeAlias = WorkerProcess | Actor


@dataclass(frozen=True, kw_only=True)
class Done:
    """What became of a task."""

    task: Task  # the task
    result: JobResult | str  # what came of it, or the sentence why nothing did
    seconds: float  # time since it was given to a worker


class _Crew:
    """The workers of a batch, all with the same job."""

    def __init__(self, job: bytes, pool: WorkerPool, timeout: float, log: Path) -> None:
        self._job, self._pool, self._timeout, self._log = job, pool, timeout, log
        self._workers: list[Worker] = []
        self._idle: list[Worker] = []
        self._is_over = False

    def run(self, task: Task) -> Done:
        """Have a worker run a task; called in several threads at once."""
        worker = self._next_idle() or self._started()
        is_late = threading.Event()

        def stop() -> None:
            is_late.set()
            worker.kill()

        timer = threading.Timer(min(self._timeout, threading.TIMEOUT_MAX), stop)
        timer.daemon = True
        begun = time.monotonic()
        timer.start()
        reply = worker.ask(task)
        timer.cancel()
        result: JobResult | str
        if is_late.is_set():
            most, longer = self._timeout, 10 * self._timeout
            result = f"stopped after {most:g} s, the time that a log may take: try timeout={longer:g}"
        elif isinstance(reply, Failure | JobResult):
            result = reply if isinstance(reply, JobResult) else reply.sentence
            if isinstance(reply, Failure) and reply.traceback:
                # a full disk costs the traceback, not the batch
                with suppress(OSError), self._log.open("a", encoding="utf-8") as file:
                    file.write(reply.traceback)
            self._idle.append(worker)
        else:
            result = worker.cause_of_death()
            worker.kill()  # its pipes are closed
        return Done(task=task, result=result, seconds=time.monotonic() - begun)

    def kill(self) -> None:
        """End all workers at once."""
        self._is_over = True
        for worker in self._workers:
            worker.kill()

    def _next_idle(self) -> Worker | None:
        while self._idle:
            worker = self._idle.pop()
            if worker.is_alive():
                return worker
        return None

    def _started(self) -> Worker:
        """Return a new worker that has loaded the job."""
        for _ in range(_MAX_FALSE_STARTS):
            worker: Worker = self._pool.start()
            self._workers.append(worker)
            if self._is_over:
                worker.kill()
                break
            reply = worker.ask(self._job)
            if reply == __version__:
                return worker
            if reply is not None:
                raise WorkerError(
                    f"a worker has curvescan {reply}, and this is {__version__}: install the same on all machines"
                )
        text = self._log.read_text("utf-8", "replace") if self._log.exists() else ""
        last = next((line.strip() for line in reversed(text.split("\n")) if line.strip()), "")
        raise WorkerError(f"the workers cannot be started: {last or worker.cause_of_death()}")


def run_tasks(job: Job, queue: Results, *, pool: WorkerPool, timeout: float, log: Path) -> Generator[Done, None, None]:
    """Run a job over logs on workers, and yield what becomes of each as soon as it is known.

    Close the generator to end the workers early. timeout: of one task, seconds; inf for any. Raises
    InvalidArgumentError, WorkerError.
    """
    crew = _Crew(_pickled(job), pool, timeout, log)
    running: set[Future[Done]] = set()
    # a supervisor that a signal ends at once cannot wait for its workers
    with cleaned_up_by(crew.kill), ThreadPoolExecutor(pool.n_workers) as threads:
        try:
            while running or queue.n_left():
                while len(running) < pool.n_workers and (task := queue.take()) is not None:
                    running.add(threads.submit(crew.run, task))
                if not running:
                    time.sleep(_LOOK_S)
                    continue
                done, running = wait(running, _LOOK_S, return_when=FIRST_COMPLETED)
                for future in done:
                    yield future.result()
        finally:
            crew.kill()


def _pickled(job: Job) -> bytes:
    kind = type(job)
    rule = "a job must be an instance of a dataclass that a module defines, so that workers can load it"
    if kind.__module__ == "__main__":
        raise InvalidArgumentError(f"{rule}: move {kind.__name__} from the script into a module")
    try:
        return pickle.dumps(job)
    except (pickle.PicklingError, AttributeError, TypeError) as error:
        raise InvalidArgumentError(f"{rule}, got {job!r:.80}: {error}") from error
