"""Read errors of a log, and text and paths of others made fit for a message."""

from __future__ import annotations

import os
from dataclasses import dataclass
from pathlib import Path

from curvescan.errors import InvalidArgumentError, LogFormatError


class BrokenRecordError(LogFormatError):
    """A line, row or message breaks the rule that stands in the error's text; the text holds no value of it."""


@dataclass(frozen=True, kw_only=True)
class ReadError:
    """One kind of error met while reading a log: counted, reported, not fatal."""

    rule: str  # what was broken, as a phrase: ``"FLASER line cut short"``
    count: int  # how often
    first: str  # where it was met first: ``"line 17"``

    @property
    def is_end(self) -> bool:
        """Whether the end of the file is missing: what comes after could not be read."""
        return "what stands before" in self.rule

    def __str__(self) -> str:
        return f"{self.rule} ({self.count} times, first in {self.first})"


class ReadErrorCounter:
    """Counts read errors by rule, with the place where each was met first; its size grows with the rules alone."""

    def __init__(self, unit: str = "line") -> None:
        self._unit = unit
        self._counts: dict[str, int] = {}
        self._first_numbers: dict[str, int] = {}

    def add(self, rule: str, number: int) -> None:
        """Count one breach of `rule`, a phrase such as ``"FLASER line cut short"``."""
        self._counts[rule] = self._counts.get(rule, 0) + 1
        self._first_numbers.setdefault(rule, number)

    def read_errors(self) -> tuple[ReadError, ...]:
        """Return one ReadError a rule, most frequent first, then in the order they were met."""
        rules = sorted(self._counts, key=lambda rule: -self._counts[rule])
        return tuple(
            ReadError(rule=rule, count=self._counts[rule], first=f"{self._unit} {self._first_numbers[rule]}")
            for rule in rules
        )


def printable(text: str, longest: int = 60) -> str:
    """Return a text on one line, with ``?`` for what cannot be printed, cut to `longest` characters."""
    line = "".join(ch if ch.isprintable() else "?" for ch in text[: longest + 1])
    return line if len(line) <= longest else f"{line[: longest - 3]}..."


def as_path(given: str | os.PathLike[str], what: str) -> Path:
    """Return the path of a file. Raises InvalidArgumentError where none is given."""
    try:
        return Path(os.fspath(given))
    except TypeError:
        raise InvalidArgumentError(f"{what} must be given as a path, got {type(given).__name__}") from None
