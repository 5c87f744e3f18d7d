"""Arguments that several commands take."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import tyro

LogPath: TypeAlias = Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="LOG")]
"""The log to read."""

ScanNumber: TypeAlias = tyro.conf.Positional[int]
"""Number of a scan in its log."""

Method: TypeAlias = Literal["cfsma"]
"""Names of the table of matchers, written out so that --help loads none of them."""

Topic: TypeAlias = str | None
"""Topic of a ROS bag; None for the only one with laser scans."""
