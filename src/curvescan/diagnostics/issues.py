"""The issues of a log in sentences: what is wrong or odd, its consequence, and the option that handles it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Literal, TypeAlias

from curvescan.diagnostics.checks import Problem, on_beams, on_file, on_odometry, on_readings, on_scans, on_time
from curvescan.diagnostics.report import LogReport

Topic: TypeAlias = Literal["file", "scans", "beams", "time", "readings", "odometry"]
"""What an issue is about."""


@dataclass(frozen=True, kw_only=True)
class Issue:
    """One thing that is wrong or odd with a log.

    Attributes
    ----------
    topic : Topic
        What it is about.
    kind : str
        Its name, the same in every log: ``"stale_beams"``.
    what : str
        What was found, with its figures.
    consequence : str
        What follows from it; empty for a remark of the reader.
    option : str
        Option of the commands that handles it, with its values: ``"--range-max 8.1"``; empty where there is none.
    """

    topic: Topic
    kind: str
    what: str
    consequence: str = ""
    option: str = ""

    @property
    def argument(self) -> str:
        """The same for :func:`curvescan.read_log`: ``"range_max=8.1"``; empty where there is none."""
        if not self.option:
            return ""
        flag, *values = self.option.split()
        if flag == "--upright":
            return "upside_down=False"
        value = f"({', '.join(values)})" if len(values) > 1 else "".join(values) or "True"
        return f"{flag.removeprefix('--').replace('-', '_')}={value}"

    @property
    def sentence(self) -> str:
        """All of it in one sentence, with the argument that handles it."""
        return self._sentence(self.argument)

    @property
    def sentence_with_option(self) -> str:
        """The same with the option of the commands."""
        return self._sentence(self.option)

    def _sentence(self, remedy: str) -> str:
        consequence = f": {self.consequence}" if self.consequence else ""
        return f"{self.what}{consequence}" + (f"; try {remedy}" if remedy else "")


def find_issues(report: LogReport) -> tuple[Issue, ...]:
    """Return what is wrong or odd with a log, each with its consequence; empty for a sound one."""
    return tuple(Issue(topic=topic, **found._asdict()) for topic, find in _CHECKS.items() for found in find(report))


_CHECKS: dict[Topic, Callable[[LogReport], Iterator[Problem]]] = {
    "file": on_file,
    "scans": on_scans,
    "beams": on_beams,
    "time": on_time,
    "readings": on_readings,
    "odometry": on_odometry,
}
