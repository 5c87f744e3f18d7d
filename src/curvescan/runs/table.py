"""A table of results that can be printed and kept: the same rows for the terminal and for Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from curvescan.errors import InvalidArgumentError


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
