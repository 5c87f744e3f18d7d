"""A table of results that can be printed and kept: the same rows for the terminal and for Markdown."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import TypeVar

from curvescan.errors import InvalidArgumentError

_T = TypeVar("_T")


@dataclass(frozen=True, kw_only=True)
class ResultTable:
    """Rows of figures under one title. Raises InvalidArgumentError."""

    title: str  # what was measured, and how
    columns: Sequence[str]  # names of the columns; the first holds names, the others figures
    rows: Sequence[Sequence[str]]  # one entry a column
    keys: int = 1  # so many of the first columns say what a row is about

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise InvalidArgumentError(f"a row needs {len(self.columns)} entries, got {len(row)}: {list(row)}")

    @classmethod
    def of(
        cls,
        title: str,
        items: Iterable[_T],
        columns: Sequence[tuple[str, Callable[[_T], str]]],
        *,
        last: Sequence[Sequence[str]] = (),
        keys: int = 1,
    ) -> ResultTable:
        """Return a table with a row an item: each column's name, and what it says of an item; `last` are more rows."""
        rows = [tuple(entry(item) for _, entry in columns) for item in items]
        return cls(title=title, columns=[name for name, _ in columns], rows=[*rows, *last], keys=keys)

    def markdown(self, width: int | None = None) -> str:
        """Return the table as Markdown, with its title as a heading.

        Where a row is wider than `width`, the columns are dealt to several tables, each with the keys.
        """
        rule = ["---"] + ["---:"] * (len(self.columns) - 1)
        rows = [[entry.replace("|", r"\|") for entry in row] for row in (self.columns, *self.rows)]
        rows.insert(1, rule)
        keys = list(range(self.keys))
        parts: list[list[int]] = [[]]
        for column in range(self.keys, len(self.columns)):
            wanted = [*keys, *parts[-1], column]
            if width and parts[-1] and any(len(_line(row, wanted)) > width for row in rows):
                parts.append([column])
            else:
                parts[-1].append(column)
        tables = ("".join(f"{_line(row, keys + part)}\n" for row in rows) for part in parts)
        return f"### {self.title}\n\n" + "\n".join(tables)


def _line(row: Sequence[str], columns: Sequence[int]) -> str:
    return f"| {' | '.join(row[k] for k in columns)} |"
