"""Messages of the library for the command line: arguments of Python become flags."""

from __future__ import annotations

import re
import shlex
from collections.abc import Sequence
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from curvescan.diagnostics.issues import Issue


_FLAGS = {
    "as_is": "--as-is",
    "backwards": "--backwards",
    "clockwise": "--clockwise",
    "drop_stale": "--drop-stale",
    "exports": "--export",
    "ignore_beams": "--ignore-beams",
    "laser_pose": "--laser-pose",
    "odometry_prior": "--odometry-prior",
    "out": "--out",
    "range_max": "--range-max",
    "reference": "--reference",
    "relations": "--relations",
    "timeout": "--timeout",
    "topic": "--topic",
}
"""Arguments that messages name, and their flags."""

_WORDS = {
    "odometry_prior=False": "--laser-only",
    "upside_down=True": "--upside-down",
    "upside_down=False": "--upright",
    "join them with Rig.of_bag": "join them with --rig",
    "read it with read_relations": "give it as --relations",
    "a smaller range_max": "a smaller --range-max",
    "the resolution of OccupancyConfig": "--map.resolution",
}

_ARGUMENT = re.compile(rf"\b({'|'.join(_FLAGS)})=('[^']*'|\([^)]*\)|[^\s,;:)]+)?")


def with_flags(message: str) -> str:
    """Return a message of the library with flags for arguments: ``--topic /scan`` for ``topic='/scan'``."""
    for words, flag in _WORDS.items():
        message = message.replace(words, flag)
    return _ARGUMENT.sub(_as_flag, message)


def _as_flag(found: re.Match[str]) -> str:
    flag, value = _FLAGS[found[1]], found[2] or ""
    values = value.strip("()'").replace(",", "")
    return flag if values in ("", "True") else f"{flag} {values}"


_REVERSING = frozenset({"--backwards", "--clockwise", "--upright"})
"""Options that turn the beams round: one that was given, and is asked for all the same, is to be left out."""


def propose_commands(command: Sequence[str], issues: Sequence[Issue]) -> tuple[str, ...]:
    """Return all issues that an option handles in one sentence, with the whole command to copy; empty without any."""
    what = [issue.what for issue in issues if issue.remedy]
    return (f"{'; '.join(what)}; try: {with_options(command, issues)}",) if what else ()


def with_options(command: Sequence[str], issues: Sequence[Issue]) -> str:
    """Return a command with the options that handle issues, to copy."""
    options = {issue.what: with_flags(issue.argument) for issue in issues if issue.remedy}
    wrong = _REVERSING & set(options.values()) & set(command)
    added = [word for option in dict.fromkeys(options.values()) if option not in wrong for word in shlex.split(option)]
    return shlex.join([*(word for word in command if word not in wrong), *added])
