"""Text that stands in a file, fit to be printed: a message must be one line, and must not move the cursor."""

from __future__ import annotations


def printable(text: str, longest: int = 60) -> str:
    """Return a text on one line, with ``?`` for what cannot be printed, cut to `longest` characters."""
    line = "".join(ch if ch.isprintable() else "?" for ch in text[: longest + 1])
    return line if len(line) <= longest else f"{line[: longest - 3]}..."
