"""The command line: finds the command, makes its flags, and turns every error into one sentence."""

import functools
import inspect
import os
import sys
import warnings
from collections.abc import Callable, Mapping
from dataclasses import fields, is_dataclass, replace
from typing import Any

import tyro

from curvescan._version import described
from curvescan.cli.commands.batch import batch
from curvescan.cli.commands.demo import demo, warm_up
from curvescan.cli.commands.info import convert, info, match
from curvescan.cli.commands.live import live
from curvescan.cli.commands.paper import bench, calibrate, experiments
from curvescan.cli.commands.results import edit_map, evaluate, view
from curvescan.cli.commands.slam import localize, odometry, slam
from curvescan.cli.console import with_flags
from curvescan.cli.help import overview, short_help
from curvescan.cli.mistakes import mistakes_in_sentences
from curvescan.cli.options import config_tables
from curvescan.configs import nearest
from curvescan.errors import CurvescanError
from curvescan.io.config import read_config
from curvescan.io.files.lines import printable

COMMANDS: dict[str, Callable[..., int]] = {
    "demo": demo, "info": info, "convert": convert, "odometry": odometry, "slam": slam, "localize": localize,
    "batch": batch, "live": live, "view": view, "map": edit_map, "match": match, "evaluate": evaluate,
    "experiments": experiments, "calibrate": calibrate, "bench": bench, "warm-up": warm_up,
}  # fmt: skip

HELP_ALL = "--help-all"
FIRST_STEPS = """\
curvescan: 2D laser scans in; motion, covariance, trajectory and map out. Three commands to try:

  curvescan live                    a simulated robot drives round a building; watch it on a page in the browser
  curvescan demo                    the same as files: trajectory, map and a table of errors, in ./demo
  curvescan odometry LOG --out DIR  a log of yours (ROS bag, CARMEN, CSV, NPZ): trajectory and map

All commands: curvescan -h"""
"""What is printed without arguments."""

MAX_SENTENCE = 4_000  # longest sentence about an error, characters: a path may have so many
MAX_NAME = 80  # longest name of a command in a sentence
DONE, BAD_INPUT, BAD_COMMAND_LINE, UNTRUSTED, INTERRUPTED = 0, 1, 2, 3, 130


def run(arguments: list[str]) -> int:
    """Return the exit status of a command line (130 when Ctrl-C ended it before there was a result)."""
    with warnings.catch_warnings():
        warnings.showwarning = _warning_shown()
        return _run(arguments)


def _warning_shown() -> Callable[..., None]:
    """Return what tells the first warning of a kind in a sentence: a log has the same one in each scan."""
    told: set[type[Warning]] = set()

    def show(message: Warning | str, category: type[Warning], *_: object, **__: object) -> None:
        if category not in told:
            told.add(category)
            print(f"curvescan: {printable(str(message), MAX_SENTENCE)}", file=sys.stderr)

    return show


def _run(arguments: list[str]) -> int:
    """Run a command and return its exit status; errors are a sentence on stderr."""
    try:
        if (text := _help(arguments)) is not None:
            print(text)
            return DONE
        if arguments[0] not in COMMANDS and not arguments[0].startswith(("--tyro", HELP_ALL)):
            name, meant = printable(arguments[0], MAX_NAME), nearest(arguments[0], COMMANDS)
            print(f"curvescan: there is no command {name!r}: {meant}all commands: curvescan -h", file=sys.stderr)
            return BAD_COMMAND_LINE
        if HELP_ALL in arguments:
            arguments = ["--help" if argument == HELP_ALL else argument for argument in arguments]
        commands = {name: _deferred(command) for name, command in _commands(arguments).items()}
        with mistakes_in_sentences(arguments, lambda: _parse(commands, [arguments[0], "--help"])):
            work = _parse(commands, arguments)
        return work()
    except CurvescanError as error:
        print(f"curvescan: {printable(with_flags(str(error)), MAX_SENTENCE)}", file=sys.stderr)
        return BAD_INPUT
    except KeyboardInterrupt:
        print("curvescan: interrupted, nothing written", file=sys.stderr)
        return INTERRUPTED
    except BrokenPipeError:
        # the reader of our output (head, less) has gone: nobody is left to read it
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return DONE
    except OSError as error:
        if error.filename is not None:  # not of standard output
            raise
        print(f"curvescan: cannot print: {error.strerror or error}; make room, or print elsewhere", file=sys.stderr)
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return BAD_INPUT


def _parse(commands: Mapping[str, Callable[..., Any]], arguments: list[str]) -> Callable[[], int]:
    """Return the work that a command line asks for; print its help or what is wrong with it, and exit."""
    about = "2D laser scan matching: scans in; motion, covariance, trajectory and map out."
    parse: Any = tyro.extras.subcommand_cli_from_dict
    work: Callable[[], int] = parse(dict(commands), prog="curvescan", description=about, args=arguments)
    return work


def _deferred(command: Callable[..., int]) -> Callable[..., Callable[[], int]]:
    """Return a command with the same arguments that returns what would run it."""

    @functools.wraps(command)
    def deferred(*args: Any, **kwargs: Any) -> Callable[[], int]:
        return functools.partial(command, *args, **kwargs)

    return deferred


def _help(arguments: list[str]) -> str | None:
    """Return the version, the first steps or the help on one screen, where no command is needed; else None."""
    if arguments in (["--version"], ["-V"]):
        return described()
    if not arguments:
        return FIRST_STEPS
    if not {"-h", "--help"} & set(arguments) or HELP_ALL in arguments:
        return None
    if arguments[0] in COMMANDS:
        return short_help(arguments[0], COMMANDS[arguments[0]])
    return overview(COMMANDS)


def _commands(arguments: list[str]) -> dict[str, Callable[..., int]]:
    """Return the commands; where --config names a file, its parameters are the defaults of their flags."""
    path = None
    for k, argument in enumerate(arguments):
        if argument == "--config" and k + 1 < len(arguments):
            path = arguments[k + 1]
        elif argument.startswith("--config="):
            path = argument.removeprefix("--config=")
    if path is None:
        return COMMANDS
    read = {type(config): config for config in read_config(path, config_tables()).values()}
    return {name: _with_configs(command, read) for name, command in COMMANDS.items()}


def _with_configs(command: Callable[..., int], read: Mapping[type, object]) -> Callable[..., int]:
    """Return the command with what was read as the defaults of its parameters."""
    signature = inspect.signature(command)

    @functools.wraps(command)
    def changed(*args: Any, **kwargs: Any) -> int:
        return command(*args, **kwargs)

    parameters = [p.replace(default=_filled(p.default, read)) for p in signature.parameters.values()]
    changed.__signature__ = signature.replace(parameters=parameters)  # type: ignore[attr-defined]
    return changed


def _filled(default: Any, read: Mapping[type, object]) -> Any:
    """Return the default of an argument: a configuration as it was read, flags with those that they hold."""
    if type(default) in read:
        return read[type(default)]
    if not is_dataclass(default) or isinstance(default, type):
        return default
    return replace(default, **{f.name: _filled(getattr(default, f.name), read) for f in fields(default)})
