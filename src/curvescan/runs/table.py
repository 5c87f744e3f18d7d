"""A table of results that can be printed and kept: the same rows for the terminal and for Markdown."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from curvescan.errors import InvalidArgumentError


@dataclass(frozen=True, kw_only=True)
class ResultTable:
    """Rows of figures under one title.

    Raises InvalidArgumentError.
    """

    title: str  # what was measured, and how
    columns: Sequence[str]  # names of the columns; the first holds names, the others figures
    rows: Sequence[Sequence[str]]  # one entry a column

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise InvalidArgumentError(f"a row needs {len(self.columns)} entries, got {len(row)}: {list(row)}")

    def markdown(self) -> str:
        """Return the table as Markdown, with its title as a heading."""
        rule = ["---"] + ["---:"] * (len(self.columns) - 1)
        rows = [[entry.replace("|", r"\|") for entry in row] for row in (self.columns, *self.rows)]
        lines = [" | ".join(row) for row in (rows[0], rule, *rows[1:])]
        return f"### {self.title}\n\n" + "".join(f"| {line} |\n" for line in lines)
