"""The wait for kernels to compile, reported: the logger "curvescan" warns of a wait longer than a second."""

import atexit
import contextlib
import gc
import logging
import time
from collections.abc import Iterator

_LOGGER = logging.getLogger(__package__)
_NOTICED_S = 1.0


class CompilationWatch:
    """Measures how long kernels take to compile, reports it once, and halts the garbage collector meanwhile.

    The collector would take a tenth of the compiler's time: it makes millions of objects that live until it is done.
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
        """Count all compilations inside as one wait, which ends with the block."""
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
