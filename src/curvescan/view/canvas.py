"""What all figures share: size, colours, axes of places in metres, and how they are saved.

Figures are made without pyplot: nothing global, nothing to close, no window.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib as mpl
from matplotlib.axes import Axes
from matplotlib.figure import Figure

DARK = "#1b2a41"
LIGHT = "#e3a76f"
GREY = "#b5b9c0"
PATH = "#c1272d"
WHEELS = "#b06a1f"
PAIRED = "#00796b"
SEGMENT_COLOURS = tuple(mpl.colormaps["tab10"].colors)  # type: ignore[attr-defined]

_STYLE: dict[str, Any] = {
    "font.size": 9.0,
    "axes.titlesize": 10.0,
    "axes.edgecolor": "#666666",
    "axes.linewidth": 0.6,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#e6e6e6",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
}
_DPI = 150


@contextmanager
def drawing(path: Path, width: float, height: float) -> Iterator[Figure]:
    """Yield an empty figure of that many inches and save it as `path` when the block ends."""
    with mpl.rc_context(_STYLE):  # type: ignore[arg-type]
        figure = Figure(figsize=(width, height))
        yield figure
        figure.savefig(path, dpi=_DPI)


def as_place(axes: Axes, title: str = "") -> None:
    """Make axes a map: metres on both, at the same scale."""
    axes.set_aspect("equal", adjustable="datalim")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    if title:
        axes.set_title(title)


def segment_colour(k: int) -> tuple[float, float, float]:
    """Return the colour of segment k; ten colours in turn."""
    colour: tuple[float, float, float] = SEGMENT_COLOURS[k % len(SEGMENT_COLOURS)]
    return colour
