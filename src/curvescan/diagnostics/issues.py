"""The issues of a log in sentences: what is wrong or odd, its consequence, and the argument that handles it."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, fields, is_dataclass
from typing import Any

from curvescan.diagnostics.checks import CHECKS, Remedy, Topic
from curvescan.diagnostics.report import LogReport, ReadingCode


@dataclass(frozen=True, kw_only=True)
class Issue:
    """One thing that is wrong or odd with a log."""

    topic: Topic  # what it is about
    kind: str  # its name, the same in every log: ``"stale_beams"``
    what: str  # what was found, with its figures
    consequence: str = ""  # what follows from it; empty for a remark of the reader
    remedy: Remedy | None = None  # the argument of :func:`curvescan.read_log` that handles it; None where there is none
    mending: str = ""  # what a run does about it by itself, beyond doubt; empty where it only proposes the remedy

    @property
    def argument(self) -> str:
        """The remedy as it is written in Python: ``"range_max=8.1"``; empty where there is none."""
        return "" if self.remedy is None else str(self.remedy)

    @property
    def sentence(self) -> str:
        """All of it in one sentence, with what handles it: a run by itself, or an argument."""
        consequence = f": {self.consequence}" if self.consequence else ""
        handled = "; a run mends it by itself" if self.mending else f"; try {self.argument}" if self.remedy else ""
        return f"{self.what}{consequence}{handled}"


def find_issues(report: LogReport) -> tuple[Issue, ...]:
    """Return what is wrong or odd with a log, each with its consequence; empty for a sound one."""
    return tuple(
        Issue(
            topic=check.topic,
            kind=check.kind,
            what=what,
            consequence=_text(check.consequence, report),
            remedy=None if check.remedy is None else check.remedy(report),
            mending=_text(check.mending, report),
        )
        for check in CHECKS
        if check.test(report)
        for what in _texts(check.what, report)
    )


def _text(text: str | Callable[[LogReport], str], report: LogReport) -> str:
    return text if isinstance(text, str) else text(report)


def _texts(what: Callable[[LogReport], str | tuple[str, ...]], report: LogReport) -> tuple[str, ...]:
    found = what(report)
    return (found,) if isinstance(found, str) else found


def report_as_plain(report: LogReport) -> dict[str, Any]:
    """Return a report and its issues as dictionaries, lists, numbers, strings and None."""
    return {
        "usable": report.is_usable,
        "issues": [_plain(issue) for issue in find_issues(report)],
        "report": _plain(report),
    }


def _plain(value: Any) -> Any:
    if isinstance(value, ReadingCode):
        is_number = math.isfinite(value.value)
        return {"value": value.value if is_number else str(value.value), "share": value.share}
    if isinstance(value, Remedy):
        return {value.argument: _plain(value.value)}
    if is_dataclass(value):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
