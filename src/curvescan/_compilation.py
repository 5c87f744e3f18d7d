"""The wait for kernels to compile: made shorter, and told.

Compiling takes seconds, once a version. Whoever waits longer than a second is told, and how long it took; the logger
"curvescan" says so as a warning, which Python prints on stderr where no logging is set up.
"""

from __future__ import annotations

import atexit
import gc
import logging
import os
import subprocess
import sys
import time
from pathlib import Path

_LOGGER = logging.getLogger(__package__)
_NOTICED_S = 1.0

_WARM_UP = Path(__file__).parent / "warmup.py"
_HELPER = (
    f"import sys; sys.path[:] = {{}}; from {__package__}.warmup import help_compile; help_compile()"
)
_HELPER_VARIABLE = "CURVESCAN_COMPILE_HELPER"
_HELPER_CORES = 2
_HELPER_BYTES = 2_000_000_000  # of the computer: each of two compilers takes 0.3 GB


class CompilationWatch:
    """Measures how long kernels take to compile, and halts the garbage collector meanwhile.

    A compiler makes millions of objects that live until it is done: looking through them again and again takes a
    fifth of its time.
    """

    def __init__(self) -> None:
        self._depth = 0
        self._started = 0.0
        self._seconds = 0.0
        self._is_told = False
        self._collects = True

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
        if seconds > _NOTICED_S and not self._is_told:
            self._is_told = True
            _LOGGER.warning("%s compiles its kernels, in the first run only ...", __package__)

    def report(self) -> None:
        """Tell how long what was compiled since the last call took, if it was told that it began."""
        if self._is_told:
            _LOGGER.warning("%s compiled its kernels in %.1f s", __package__, self._seconds)
        self._seconds, self._is_told = 0.0, False


watch = CompilationWatch()
atexit.register(watch.report)


def start_helper(folder: Path | None) -> None:
    """Let a second process compile from the other end, once for each cache folder, where there is a core for it.

    Threads would be of no use: one lock guards Numba's compiler. What the helper has compiled is found in the cache; if
    it does not come to be, or is ended with this process, that costs time alone. CURVESCAN_COMPILE_HELPER=0 does
    without it.
    """
    if folder is None or not (_WARM_UP.exists() and _is_helper_worthwhile()):
        return
    code = _HELPER.format([str(Path(entry).absolute()) for entry in sys.path])
    try:
        (folder / "helper-started").touch(exist_ok=False)
        helper = subprocess.Popen(
            [sys.executable, "-c", code],
            env=os.environ | {_HELPER_VARIABLE: "0"},
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
    except OSError:
        return
    atexit.register(_end, helper, os.getpid())


def _is_helper_worthwhile() -> bool:
    # the interpreter of a program that embeds Python, or was packed into one file, is not named so
    if os.environ.get(_HELPER_VARIABLE) == "0" or "python" not in Path(sys.executable or "").name:
        return False
    if hasattr(os, "sched_getaffinity"):
        n_cores = len(os.sched_getaffinity(0))
    else:
        n_cores = os.cpu_count() or 1
    if hasattr(os, "sysconf"):
        n_bytes = os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")
    else:
        n_bytes = _HELPER_BYTES
    return n_cores >= _HELPER_CORES and n_bytes >= _HELPER_BYTES


def _end(helper: subprocess.Popen[bytes], parent: int) -> None:
    if os.getpid() == parent:
        helper.terminate()
        helper.wait()
