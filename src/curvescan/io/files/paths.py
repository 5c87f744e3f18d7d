"""as_path: the path of a file, or a sentence on what was given instead."""

from __future__ import annotations

import os
from pathlib import Path

from curvescan.errors import InvalidArgumentError


def as_path(given: str | os.PathLike[str], what: str) -> Path:
    """Return the path of a file. Raises InvalidArgumentError where none is given."""
    try:
        return Path(os.fspath(given))
    except TypeError:
        raise InvalidArgumentError(f"{what} must be given as a path, got {type(given).__name__}") from None
