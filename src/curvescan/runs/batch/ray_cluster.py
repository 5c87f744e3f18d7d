"""Workers that are actors of a Ray cluster, which the extra ``ray`` installs; see ``workers.py``.

The batch uses them like processes of this machine. The environment variable RAY_ADDRESS names the cluster.
Without it, a cluster that runs on this machine is used; else one is started, and ends with the batch.
"""

import os
import pickle
from contextlib import suppress
from typing import Any

from curvescan.errors import MissingPackageError, WorkerError
from curvescan.runs.batch.jobs import Job
from curvescan.runs.batch.worker import Desk, Reply, Task

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
        self._actor_class = ray.remote(num_cpus=1, max_restarts=0, max_task_retries=0)(_RayDesk)

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

    def start(self) -> "Actor":
        """Start an actor."""
        return Actor(self._ray, self._actor_class.remote())

    def close(self) -> None:
        """Leave the cluster, unless the caller of Python had joined it before."""
        if self._is_ours:
            self._ray.shutdown()


class Actor:
    """An actor, seen from the supervisor: what :class:`.workers.WorkerProcess` is on one machine."""

    def __init__(self, ray: Any, handle: Any) -> None:
        self._ray, self._handle = ray, handle
        self._cause = "its Ray worker ended"

    def ask(self, message: bytes | Task) -> Reply | None:
        """Give a pickled job or a task, and return the reply; None when the actor has ended."""
        try:
            reply: Reply = self._ray.get(self._handle.answer.remote(message))
        except self._ray.exceptions.RayError as error:
            self._cause = f"its Ray worker ended: {_sentence(error)}"
            return None
        return reply

    def is_alive(self) -> bool:
        """Return True: whether an actor is there is seen when its reply does not come."""
        return True

    def cause_of_death(self) -> str:
        """Return how the actor ended, as a sentence."""
        return self._cause

    def kill(self) -> None:
        """End the actor at once, in the middle of a log as well."""
        with suppress(self._ray.exceptions.RayError, ValueError):
            self._ray.kill(self._handle)


class _RayDesk(Desk):
    """What runs in the cluster."""

    def __init__(self) -> None:
        os.environ.update(_SETTINGS)


def _warm_up(job: bytes) -> None:
    loaded: Job = pickle.loads(job)
    loaded.warm_up()


def _sentence(error: BaseException) -> str:
    """Return the line of Ray's message that says what happened."""
    lines = [line.strip() for line in str(error).splitlines() if line.strip()]
    reasons = [line for line in lines if "died" in line or "killed" in line or "Error" in line]
    return (reasons or lines or [type(error).__name__])[-1][:300]
