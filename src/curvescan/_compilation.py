"""The wait for kernels to compile: made shorter, and reported.

Compiling takes seconds, once a version. A wait longer than a second is reported, with its duration; the logger
"curvescan" says so as a warning, which Python prints on stderr where no logging is set up.
"""

from __future__ import annotations

import atexit
import contextlib
import gc
import logging
import os
import subprocess
import time
from collections.abc import Iterator
from pathlib import Path

from curvescan._interrupts import clean_up_at_end
from curvescan._processes import has_own_python, n_usable_cores, python_command

_LOGGER = logging.getLogger(__package__)
_NOTICED_S = 1.0

_WARM_UP = Path(__file__).parent / "warmup.py"
_HELPERS_VARIABLE = "CURVESCAN_COMPILE_HELPERS"
_MAX_HELPERS = 3
_COMPILER_BYTES = 1_000_000_000  # of memory for each process that compiles: it takes 0.3 GB


class CompilationWatch:
    """Measures how long kernels take to compile, reports it once a process, and halts the garbage collector meanwhile.

    A compiler makes millions of objects that live until it is done: looking through them again and again takes a
    tenth of its time.
    """

    def __init__(self) -> None:
        self._depth = 0
        self._started = 0.0
        self._seconds = 0.0
        self._reported_s = 0.0  # of them at the last report
        self._is_begin_told = False
        self._is_total_told = False
        self._collects = True
        self._n_holding = 0

    def start(self) -> None:
        """Take the time; compilations of kernels that a kernel calls lie within its own."""
        if self._depth == 0:
            self._started = time.perf_counter()
            self._collects = gc.isenabled()
            gc.disable()
        self._depth += 1

    def end(self) -> None:
        """Tell what is going on once it has taken long enough to be noticed."""
        self._depth -= 1
        seconds = self._seconds + time.perf_counter() - self._started
        if self._depth == 0:
            self._seconds = seconds
            if self._collects:
                gc.enable()
        if seconds > _NOTICED_S and not self._is_begin_told:
            self._is_begin_told = True
            _LOGGER.warning("%s compiles its kernels, in the first run only ...", __package__)

    @contextlib.contextmanager
    def held(self) -> Iterator[None]:
        """Take all that is called inside for one wait, over at its end."""
        self._n_holding += 1
        try:
            yield
        finally:
            self._n_holding -= 1
            self.report(is_over=True)

    def report(self, *, is_over: bool = False) -> None:
        """Report how long it took, if its start was reported."""
        if self._n_holding:
            return
        is_quiet = self._seconds == self._reported_s
        self._reported_s = self._seconds
        if self._is_begin_told and not self._is_total_told and (is_over or is_quiet):
            self._is_total_told = True
            _LOGGER.warning("%s compiled its kernels in %.1f s", __package__, self._seconds)


watch = CompilationWatch()
atexit.register(watch.report, is_over=True)


def start_helpers(folder: Path | None) -> None:
    """Let other processes compile from the other end, once for each cache folder, where there are cores for them.

    Threads would be of no use: one lock guards Numba's compiler. What a helper has compiled is found in the cache; if
    it does not come to be, or is ended with this process, that costs time alone. CURVESCAN_COMPILE_HELPERS=0 does
    without them.
    """
    n_helpers = _n_helpers()
    if folder is None or not _WARM_UP.exists() or not n_helpers:
        return
    try:
        (folder / "helpers-started").touch(exist_ok=False)
        for k in range(n_helpers):
            helper = subprocess.Popen(
                python_command(f"{__package__}.warmup", f"help_compile({k})"),
                env=os.environ | {_HELPERS_VARIABLE: "0"},
                stdin=subprocess.DEVNULL,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            atexit.register(_end, helper, os.getpid())
            clean_up_at_end(helper.kill)
    except OSError:
        return


def _n_helpers() -> int:
    if os.environ.get(_HELPERS_VARIABLE) == "0" or not has_own_python():
        return 0
    if hasattr(os, "sysconf"):
        n_bytes = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    else:
        n_bytes = 2 * _COMPILER_BYTES
    return max(min(_MAX_HELPERS, n_usable_cores() - 1, n_bytes // _COMPILER_BYTES - 1), 0)


def _end(helper: subprocess.Popen[bytes], parent: int) -> None:
    if os.getpid() == parent:
        helper.terminate()
        helper.wait()
