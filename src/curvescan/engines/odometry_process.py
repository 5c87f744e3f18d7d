"""The odometry of a SLAM run in a process of its own, ahead of the back end, with the same bits.

A process that cannot be started, or ends too early, costs time alone: its work is then done here.
"""

import os
import pickle
import signal
import subprocess
import sys
import threading
from collections.abc import Callable, Iterable, Iterator
from contextlib import suppress
from functools import partial
from itertools import islice
from queue import Full, Queue
from typing import Any

from curvescan._processes import has_own_python, n_usable_cores, python_command
from curvescan.engines.engine import PlacedScan, in_turn, placed, pose_at
from curvescan.engines.record import without_trace
from curvescan.odometry.odometry import Odometry
from curvescan.scan import LaserScan
from curvescan.types import Pose

_ENVIRONMENT = {"OMP_NUM_THREADS": "1", "MALLOC_MMAP_THRESHOLD_": "1048576"}  # as cli.main has it
_BATCH = 32  # scans sent at once
_AHEAD = 32  # batches that the odometry may be ahead, so that memory does not grow with the log
_LOOK_S = 0.2  # time after which a thread that waits looks whether it is still wanted, seconds
_PROTOCOL = 4  # by the fifth small arrays take three times as much memory, and twice as long to read
_MIN_SCANS = 1000  # of a shorter log the process is not worth its start


def can_run_ahead(n_scans: int) -> bool:
    """Return whether a process for the odometry of so many scans pays, and a core and a Python are free."""
    return n_usable_cores() > 1 and has_own_python() and n_scans >= _MIN_SCANS


class OdometryProcess:
    """The odometry of a log in a process of its own; :meth:`place` a log and iterate once, inside ``with``.

    Its steps equal those of the odometry in this process, but have no traces of their matches.
    """

    odometry: Odometry  # what was given to :meth:`place`; at the end of the iteration the one that has placed all scans

    def __init__(self) -> None:
        self._sent: Queue[Any] = Queue(_AHEAD)
        self._heard: Queue[Any] = Queue(_AHEAD)
        self._calls: Queue[Any] = Queue()
        self._is_placed = False  # all scans, by the process, which is there still
        self._is_closed = False
        self._process: subprocess.Popen[bytes] | None = None
        with suppress(OSError):
            self._process = subprocess.Popen(
                python_command(__name__, "serve()"),
                env={**os.environ, **_ENVIRONMENT},
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
            )

    def __enter__(self) -> "OdometryProcess":
        return self

    def __exit__(self, *error: object) -> None:
        self._is_closed = True
        self._calls.put(None)
        if self._process is not None:
            self._process.kill()
            self._process.wait()

    def place(self, odometry: Odometry, scans: Iterable[LaserScan], odometry_poses: Pose | None) -> "OdometryProcess":
        """Begin to place scans, and return the same object, to be iterated over. odometry_poses (n, 3)."""
        self.odometry = odometry
        self._begun = pickle.dumps(odometry)
        self._scans, self._odometry_poses = scans, odometry_poses
        for work in (self._send, self._hear) if self._process else ():
            threading.Thread(target=work, daemon=True).start()
        return self

    def __iter__(self) -> Iterator[PlacedScan]:
        n_done = 0
        while self._process is not None:
            scans = self._sent.get()
            if isinstance(scans, BaseException):
                raise scans
            steps = self._heard.get()
            if steps is None:
                break
            if scans is None:
                self.odometry, self._is_placed = steps, True
                return
            for scan, (step, seconds) in zip(scans, steps, strict=True):
                yield PlacedScan(scan, step, seconds)
            n_done += len(scans)
        self.odometry = pickle.loads(self._begun)
        yield from islice(in_turn(self.odometry, self._scans, self._odometry_poses), n_done, None)

    def call_after(self, function: Callable[..., Any], *args: Any, **kwargs: Any) -> Callable[[], Any]:
        """Have the process call a function when the odometry is done; what this returns gives the result.

        Ask for results in the order of the calls. Where the process cannot call the function, this process does.
        """
        call, sent = partial(function, *args, **kwargs), None  # None ends the process
        with suppress(Exception):  # what cannot be sent; here, where nothing changes the arguments meanwhile
            sent = pickle.dumps(call, _PROTOCOL)
        self._calls.put(sent)

        def result() -> Any:
            reply = self._heard.get() if self._is_placed else None
            self._is_placed = reply is not None
            return call() if reply is None else reply[0]

        return result

    def _send(self) -> None:
        """Send all scans, and keep them for the iteration; then calls."""
        assert self._process is not None
        assert self._process.stdin is not None
        try:
            with self._process.stdin as requests:
                requests.write(self._begun)
                left = ((scan, pose_at(self._odometry_poses, k)) for k, scan in enumerate(self._scans))
                while batch := list(islice(left, _BATCH)):
                    if not self._put(self._sent, [scan for scan, _ in batch]):
                        return
                    pickle.dump(batch, requests, _PROTOCOL)
                    requests.flush()
                pickle.dump(None, requests)
                requests.flush()
                self._put(self._sent, None)
                while (call := self._calls.get()) is not None:
                    requests.write(call)
                    requests.flush()
                    del call  # it may be large
        except OSError as error:  # of the pipe, as the other one tells; or of the log
            self._put(self._sent, None if isinstance(error, BrokenPipeError) else error)
        except BaseException as error:  # noqa: BLE001  it is raised in the iteration
            self._put(self._sent, error)

    def _hear(self) -> None:
        """Keep the steps and results that come back, and None at the end of them."""
        assert self._process is not None
        assert self._process.stdout is not None
        with self._process.stdout as replies, suppress(Exception):
            # whatever comes of a process that ends in the middle of a word, or of the pipe's end
            while self._put(self._heard, pickle.load(replies)):
                pass
        self._put(self._heard, None)

    def _put(self, queue: Queue[Any], item: object) -> bool:
        """Append to a queue when there is room, and return whether that was still wanted."""
        while not self._is_closed:
            with suppress(Full):
                queue.put(item, timeout=_LOOK_S)
                return True
        return False


def serve() -> None:
    """Run the process: place the scans from stdin, send the steps to stdout, then call functions."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # it ends with its pipes
    requests, replies = sys.stdin.buffer, sys.stdout.buffer
    sys.stdout = sys.stderr
    with suppress(EOFError, OSError):
        odometry: Odometry = pickle.load(requests)
        while (batch := pickle.load(requests)) is not None:
            done = [placed(odometry, scan, pose) for scan, pose in batch]
            found = [(without_trace(one.step), one.seconds) for one in done]
            pickle.dump(found, replies, _PROTOCOL)
            replies.flush()
        pickle.dump(odometry, replies, _PROTOCOL)
        replies.flush()
        while True:
            pickle.dump((pickle.load(requests)(),), replies, _PROTOCOL)
            replies.flush()
