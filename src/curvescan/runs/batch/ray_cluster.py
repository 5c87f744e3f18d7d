"""Workers that are actors of a Ray cluster, which the extra ``ray`` installs; see :class:`.workers.WorkerPool`.

They run the same function as the processes of one machine. The environment variable RAY_ADDRESS names the cluster.
Without it, a cluster that runs on this machine is used; else one is started, and ends with the batch.
"""

import os
import pickle
from concurrent.futures import Future
from contextlib import suppress
from queue import SimpleQueue
from typing import Any

from curvescan.errors import MissingPackageError, WorkerError
from curvescan.runs.batch.jobs import Job, JobResult
from curvescan.runs.batch.worker import Failure, Ready, Reply, Task, answer
from curvescan.runs.batch.workers import Event

_SETTINGS = {"MPLBACKEND": "Agg"}


class RayPool:
    """Starts actors, each with a core, `n_workers` at once; None for as many as the cluster has cores."""

    def __init__(self, n_workers: int | None) -> None:
        try:
            import ray
        except ImportError as error:
            raise MissingPackageError("the engine ray needs Ray: pip install 'curvescan[ray]'") from error
        self._ray: Any = ray
        self._is_ours = not ray.is_initialized()
        if self._is_ours:
            # Ray would say at length what it does; its processes do not need our usage either
            os.environ.setdefault("RAY_USAGE_STATS_ENABLED", "0")
            os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")
            try:
                ray.init(logging_level="error", log_to_driver=False)
            except (ConnectionError, RuntimeError, ValueError, OSError) as error:
                reason = str(error).partition("\n")[0]
                raise WorkerError(f"no Ray cluster can be reached or started: {reason}") from error
        self.n_workers = n_workers or max(1, int(ray.cluster_resources().get("CPU", 1)))
        self._actor_class = ray.remote(num_cpus=1, max_restarts=0, max_task_retries=0)(RayWorker)

    def warm_up(self, job: Job) -> None:
        """Compile what the job needs, on each machine of the cluster."""
        from ray.util.scheduling_strategies import NodeAffinitySchedulingStrategy as OnNode

        sent = pickle.dumps(job)
        warming = self._ray.remote(num_cpus=1, max_retries=0)(_warm_up)
        nodes = [node["NodeID"] for node in self._ray.nodes() if node["Alive"] and node["Resources"].get("CPU", 0) >= 1]
        places = [OnNode(node, soft=True) for node in nodes]
        try:
            self._ray.get([warming.options(scheduling_strategy=p).remote(sent) for p in places])
        except self._ray.exceptions.RayError as error:
            raise WorkerError(f"the workers cannot be started: {_sentence(error)}") from error

    def start(self, job: bytes, events: SimpleQueue[Event]) -> "Actor":
        """Start an actor with a pickled job."""
        return Actor(self._ray, self._actor_class.remote(job), events)

    def close(self) -> None:
        """Leave the cluster, unless the caller of Python had joined it before."""
        if self._is_ours:
            self._ray.shutdown()


class Actor:
    """An actor, seen from the supervisor; see :class:`.workers.Worker`."""

    def __init__(self, ray: Any, handle: Any, events: SimpleQueue[Event]) -> None:
        self._ray, self._handle, self._events = ray, handle, events
        self._cause = "its Ray worker ended"
        self._expect(handle.ready.remote())

    def send(self, task: Task) -> bool:
        """Give a task; whether the actor is there is seen when its reply does not come."""
        self._expect(self._handle.answer.remote(task))
        return True

    def cause_of_death(self) -> str:
        """Return how the actor ended, as a sentence."""
        return self._cause

    def kill(self) -> None:
        """End the actor at once."""
        with suppress(self._ray.exceptions.RayError, ValueError):
            self._ray.kill(self._handle)

    def dismiss(self) -> None:
        """End the actor, in the middle of a log as well."""
        self.kill()

    def end(self) -> None:
        """Do nothing: the cluster sees to its processes."""

    def _expect(self, reference: Any) -> None:
        future: Future[Reply] = reference.future()
        future.add_done_callback(self._hear)

    def _hear(self, future: Future[Reply]) -> None:
        error = future.exception()
        if error is None:
            self._events.put((self, future.result()))
        else:
            self._cause = f"its Ray worker ended: {_sentence(error)}"
            self._events.put((self, None))


class RayWorker:
    """What runs in the cluster: one job over one log after another."""

    def __init__(self, job: bytes) -> None:
        os.environ.update(_SETTINGS)
        self._job: Job = pickle.loads(job)

    def ready(self) -> Ready:
        """Say that the job is loaded."""
        return Ready()

    def answer(self, task: Task) -> JobResult | Failure:
        """Run the job over a log."""
        return answer(self._job, task)


def _warm_up(job: bytes) -> None:
    loaded: Job = pickle.loads(job)
    loaded.warm_up()


def _sentence(error: BaseException) -> str:
    """Return the line of Ray's message that says what happened."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    reasons = [line for line in lines if "died" in line or "killed" in line or "Error" in line]
    return (reasons or lines or [type(error).__name__])[-1][:300]
