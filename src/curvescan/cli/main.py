"""curvescan: the command that finds its commands, and turns every error into one sentence."""

from __future__ import annotations

import os
import sys
from collections.abc import Callable
from typing import Any

import tyro

from curvescan import __version__
from curvescan.cli.bench import bench
from curvescan.cli.calibrate import calibrate
from curvescan.cli.demo import demo
from curvescan.cli.experiments import experiments
from curvescan.cli.info import info
from curvescan.cli.match import match
from curvescan.cli.odometry import odometry
from curvescan.errors import CurvescanError

COMMANDS: dict[str, Callable[..., int]] = {
    "demo": demo,
    "info": info,
    "odometry": odometry,
    "match": match,
    "experiments": experiments,
    "calibrate": calibrate,
    "bench": bench,
}

DONE, BAD_INPUT, BAD_COMMAND_LINE, INTERRUPTED = 0, 1, 2, 130


def main() -> None:
    """Run the command line and exit with its status: 0 done, 1 bad input, 2 bad command line."""
    sys.exit(run(sys.argv[1:]))


def run(arguments: list[str]) -> int:
    """Return the exit status of a command line (130 when Ctrl-C ended it before there was a result)."""
    if arguments in (["--version"], ["-V"]):
        print(f"curvescan {__version__}")
        return DONE
    try:
        return int(_parse_and_call(arguments))
    except CurvescanError as error:
        print(f"curvescan: {error}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("curvescan: interrupted, nothing written", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # the reader of our output (head, less) has gone: nobody is left to tell
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE


def _parse_and_call(arguments: list[str]) -> Any:
    return tyro.extras.subcommand_cli_from_dict(
        COMMANDS,
        prog="curvescan",
        description="2D laser scan matching: scans in; motion, covariance, trajectory and map out.",
        args=arguments,
    )
