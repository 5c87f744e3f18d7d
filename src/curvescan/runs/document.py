"""A report written twice from the same parts: Markdown, and HTML with its figures inside."""

from __future__ import annotations

import base64
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import TypeAlias

from curvescan.runs.table import ResultTable

Part: TypeAlias = str | ResultTable | tuple[str, str]
"""A paragraph (or a heading, which begins with #), a table, or a figure as (file name, caption)."""


_WIDTH = 120  # of a table's lines in a report, characters


def save_document(folder: Path, title: str, parts: Sequence[Part]) -> None:
    """Write report.md and report.html into an existing folder."""
    text = write_markdown(folder / "report.md", parts)
    page = _PAGE.format(title=escape(title), body=_html(folder, text))
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


_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{title}</title>
<style>
body {{ font: 15px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; color: #222; }}
table {{ border-collapse: collapse; margin: 1rem 0; font-size: 13px; }}
th, td {{ border-bottom: 1px solid #ddd; padding: 0.25rem 0.6rem; text-align: right; }}
th:first-child, td:first-child {{ text-align: left; }}
img {{ max-width: 100%; }}
</style>
</head>
<body>
{body}</body>
</html>
"""
