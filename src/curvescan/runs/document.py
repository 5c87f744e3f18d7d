"""Tables of results, and a report written twice from the same parts: Markdown, and HTML with its figures inside."""

import base64
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from html import escape
from importlib.resources import files
from pathlib import Path
from typing import TypeAlias, TypeVar

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
    ) -> "ResultTable":
        """Return a table with a row an item: each column's name, and what it says of an item; `last` are more rows."""
        rows = [tuple(entry(item) for _, entry in columns) for item in items]
        return cls(title=title, columns=[name for name, _ in columns], rows=[*rows, *last], keys=keys)

    def markdown(self, width: int | None = None) -> str:
        """Return the table as Markdown under its title; columns beyond `width` go to further tables with the keys."""
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


Part: TypeAlias = str | ResultTable | tuple[str, str]
"""A paragraph (or a heading, which begins with #), a table, or a figure as (file name, caption)."""


_WIDTH = 120  # of a table's lines in a report, characters


def save_document(folder: Path, title: str, parts: Sequence[Part]) -> None:
    """Write report.md and report.html into an existing folder."""
    text = write_markdown(folder / "report.md", parts)
    page = (
        files(__package__)
        .joinpath("report.html")
        .read_text("utf-8")
        .format(title=escape(title), body=_html(folder, text))
    )
    (folder / "report.html").write_text(page, encoding="utf-8", newline="\n")


def write_markdown(path: Path, parts: Sequence[Part]) -> str:
    """Write a report as Markdown alone, and return it."""
    text = "\n".join(_markdown(part) for part in parts)
    path.write_text(text, encoding="utf-8", newline="\n")
    return text


def _markdown(part: Part) -> str:
    if isinstance(part, ResultTable):
        return part.markdown(_WIDTH)
    if isinstance(part, tuple):
        return f"![{part[1].partition('. ')[0]}]({part[0]})\n\n{part[1]}\n"
    return f"{part}\n"


def _html(folder: Path, text: str) -> str:
    """Return Markdown as HTML, with the figures it names inside."""
    from markdown_it import MarkdownIt

    parser = MarkdownIt("commonmark", {"html": False}).enable("table")
    tokens = parser.parse(text)
    for token in tokens:
        for inner in token.children or ():
            if inner.type == "image":
                data = (folder / str(inner.attrs["src"])).read_bytes()
                inner.attrs["src"] = f"data:image/png;base64,{base64.b64encode(data).decode('ascii')}"
    html: str = parser.renderer.render(tokens, parser.options, {})
    return html
