"""FinishedSite: the page of finished runs, for the server."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from curvescan.errors import InvalidArgumentError
from curvescan.live.finished.packing import packed
from curvescan.live.finished.view import FinishedView


class FinishedSite:
    """What the page of finished runs shows, and what it may ask for."""

    page = "view"

    def __init__(self, view: FinishedView) -> None:
        self.actions: frozenset[str] = frozenset()
        self._data = packed({"runs": [run.tree for run in view.runs]})

    def content(self, path: str) -> tuple[bytes, str] | None:
        """Return the runs."""
        return (self._data, "application/octet-stream") if path == "/data" else None

    def events(self) -> None:
        """Return no stream: what is finished stays."""

    def act(self, name: str, arguments: Mapping[str, Any]) -> tuple[bytes, str]:
        """Do what the page asks for."""
        raise InvalidArgumentError(f"the page may not ask for {name}")

    def stop(self) -> None:
        """Do nothing: there is no stream."""
