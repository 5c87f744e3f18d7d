"""The entry point: sees to it that Ctrl-C ends in a sentence, from the first import on, and runs the command line."""

import gc
import sys

from curvescan._interrupts import end_commands_at_once

_NEW_OBJECTS = 50_000
"""How many objects a command makes before Python looks for garbage among them.

At Python's own 700 or 2,000 it looks through the modules again and again while they are imported: a twentieth of that
time.
"""


def main() -> None:
    """Run the command line and exit: 0 done, 1 bad input, 2 bad command line, 3 not to be trusted, 130, 143 signals."""
    end_commands_at_once()
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Return the exit status of a command line; see :mod:`curvescan.cli.command_line`."""
    gc.set_threshold(_NEW_OBJECTS)
    # imported late: it takes a good part of a second, in which Ctrl-C may come
    from curvescan.cli import command_line

    return command_line.run(arguments)
