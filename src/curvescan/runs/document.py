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


def save_document(folder: Path, title: str, parts: Sequence[Part]) -> None:
    """Write report.md and report.html into an existing folder.

    Parameters
    ----------
    folder : Path
        Holds the figures already.
    title : str
        Of the HTML page.
    parts : sequence of Part
        In their order.
    """
    write_markdown(folder / "report.md", parts)
    body = "".join(_html(folder, part) for part in parts)
    page = _PAGE.format(title=escape(title), body=body)
    (folder / "report.html").write_text(page, "utf-8")


def write_markdown(path: Path, parts: Sequence[Part]) -> None:
    """Write a report as Markdown alone.

    Parameters
    ----------
    path : Path
        The file; its figures are beside it.
    parts : sequence of Part
        In their order.
    """
    path.write_text("\n".join(_markdown(part) for part in parts), "utf-8")


def _markdown(part: Part) -> str:
    if isinstance(part, ResultTable):
        return part.markdown()
    if isinstance(part, tuple):
        return f"![{part[1]}]({part[0]})\n\n{part[1]}\n"
    return f"{part}\n"


def _html(folder: Path, part: Part) -> str:
    if isinstance(part, ResultTable):
        return part.html()
    if isinstance(part, tuple):
        data = base64.b64encode((folder / part[0]).read_bytes()).decode("ascii")
        caption = escape(part[1])
        return (
            f'<figure><img alt="{caption}" src="data:image/png;base64,{data}">'
            f"<figcaption>{caption}</figcaption></figure>\n"
        )
    if part.startswith("#"):
        level = len(part) - len(part.lstrip("#"))
        return f"<h{level}>{escape(part.lstrip('# '))}</h{level}>\n"
    return f"<p>{escape(part)}</p>\n"


_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<title>{title}</title>
<style>
body {{ font: 15px/1.5 system-ui, sans-serif; max-width: 70rem; margin: 2rem auto; padding: 0 1rem; color: #222; }}
table {{ border-collapse: collapse; margin: 1rem 0; font-size: 13px; }}
caption {{ text-align: left; font-weight: 600; padding: 0.3rem 0; }}
th, td {{ border-bottom: 1px solid #ddd; padding: 0.25rem 0.6rem; text-align: right; }}
th:first-child, td:first-child {{ text-align: left; }}
img {{ max-width: 100%; }}
figure {{ margin: 1rem 0; }}
figcaption {{ color: #555; font-size: 13px; }}
</style>
</head>
<body>
{body}</body>
</html>
"""
