"""Rows of figures that are kept as soon as they are measured, a line of JSON each, and the Markdown tables made of them."""

from __future__ import annotations

import json
from collections.abc import Iterable
from dataclasses import asdict
from pathlib import Path
from typing import TypeVar

R = TypeVar("R")


def read_rows(file: Path, kind: type[R]) -> list[R]:
    """Return the rows that were measured, records of a dataclass."""
    lines = file.read_text("utf-8").splitlines() if file.exists() else []
    return [kind(**json.loads(line)) for line in lines]


def write_rows(file: Path, rows: Iterable[object]) -> None:
    """Write rows in place of those that were there."""
    file.write_text("".join(json.dumps(asdict(row)) + "\n" for row in rows), "utf-8")


def markdown(head: Iterable[str], rule: Iterable[str], rows: Iterable[Iterable[str]]) -> str:
    """Return a table: names of its columns, how each is aligned, and its rows."""
    return "".join(f"| {' | '.join(row)} |\n" for row in (head, rule, *rows))
