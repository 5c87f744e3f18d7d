"""What a run proposes: the whole command, with the options that handle what is wrong with its log."""

from __future__ import annotations

import shlex
from collections.abc import Sequence

from curvescan.cli.flags import with_flags
from curvescan.diagnostics.issues import Issue

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
