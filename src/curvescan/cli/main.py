"""The entry point: sees to it that Ctrl-C ends in a sentence, from the first import on, and runs the command line."""

import atexit
import ctypes
import gc
import os
import sys
import threading
from contextlib import suppress

from curvescan import _interrupts, _processes


def main() -> None:
    """Run the command line and exit: 0 done, 1 bad input, 2 bad command line, 3 not to be trusted, 130, 143 signals."""
    _interrupts.end_commands_at_once()
    status = run(sys.argv[1:])
    if threading.active_count() == 1:
        # without taking a compiler and a million objects apart, which is a tenth of a short run
        with suppress(OSError):
            atexit._run_exitfuncs()
            sys.stdout.flush()
            os._exit(status)
    sys.exit(status)


def run(arguments: list[str]) -> int:
    """Return the exit status of a command line; see :mod:`curvescan.cli.command_line`."""
    gc.set_threshold(_processes.GARBAGE_THRESHOLD)
    with suppress(AttributeError, TypeError):  # M_MMAP_THRESHOLD: else glibc keeps what was freed, up to 32 MB a piece
        ctypes.CDLL(None).mallopt(-3, 1 << 20)
    # imported late: it takes a good part of a second, in which Ctrl-C may come
    from curvescan.cli import command_line

    return command_line.run(arguments)
