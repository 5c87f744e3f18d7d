"""What all figures share: size, colours, axes of places in metres, and how they are saved.

Figures are made without pyplot: nothing global, nothing to close, no window.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from curvescan.io.files.printable import printable
from curvescan.types import Points, Pose

DARK = "#1b2a41"
LIGHT = "#e3a76f"
GREY = "#b5b9c0"
PATH = "#c1272d"
WHEELS = "#b06a1f"
TRUTH = "#2e7d32"
FAILED = "#7b1fa2"
PAIRED = "#00796b"
FIRST, SECOND = "#0072b2", "#d55e00"
"""Of two scans: blue and vermilion of Okabe and Ito, which the colour-blind tell apart (Wong, Nat. Methods 8, 2011)."""
SEGMENT_COLOURS = tuple(mpl.colormaps["tab10"].colors)  # type: ignore[attr-defined]

_STYLE = Path(__file__).with_name("curvescan.mplstyle")
_DPI = 150
_MAX_TITLE = 160


@contextmanager
def drawing(path: Path, width: float, height: float) -> Iterator[Figure]:
    """Yield an empty figure of that many inches and save it as `path` when the block ends."""
    with mpl.rc_context(fname=_STYLE):
        figure = Figure(figsize=(width, height))
        yield figure
        with warnings.catch_warnings():
            # names of files may be in any script; a box stands for what the font does not have
            warnings.filterwarnings("ignore", "Glyph .* missing from", UserWarning)
            figure.savefig(path, dpi=_DPI, bbox_inches="tight", pad_inches=0.1)


@contextmanager
def drawing_places(path: Path, points: Points, n_places: int = 1) -> Iterator[tuple[Figure, list[Axes]]]:
    """Yield a figure of `n_places` maps of the same size that shows all points, and their axes.

    Wide places stand one above the other, high ones side by side.
    """
    low, high = np.nanmin(points, axis=0), np.nanmax(points, axis=0)
    margin = 0.03 * float(max(high - low)) + 0.1
    low, high = low - margin, high + margin
    span = high - low
    ratio = float(np.clip(span[1] / span[0], 0.2, 2.0))
    is_wide = n_places > 1 and ratio < 0.6
    rows, columns = (n_places, 1) if is_wide else (1, n_places)
    width = 11.0 / columns if n_places > 1 else min(10.0, max(7.0, 9.0 / ratio))
    with drawing(path, columns * width, rows * ((width - 0.5) * ratio + 0.5) + 1.0) as figure:
        places = np.ravel(figure.subplots(rows, columns)).tolist()
        for axes in places:
            axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
        yield figure, places


def as_place(axes: Axes, title: str = "") -> None:
    """Make axes a map: metres on both, at the same scale."""
    axes.set_aspect("equal", adjustable="box")
    axes.set_xlabel("x [m]")
    axes.set_ylabel("y [m]")
    if title:  # often the name of a file, in which a $ begins no formula
        axes.set_title(printable(title, _MAX_TITLE), parse_math=False)


def draw_truth(axes: Axes, poses: Pose) -> None:
    """Draw the true path, (n, 3) poses."""
    axes.plot(*poses[:, :2].T, color=TRUTH, lw=1.0, ls="--", label="truth")


def mark_ends(axes: Axes, poses: Pose, colour: str = PATH) -> None:
    """Mark where a path of (n, 3) poses starts and ends; nothing where it has none."""
    for mark, end, label in (("o", poses[:1], "start"), ("s", poses[-1:], "end")):
        axes.plot(*end[:, :2].T, mark, color="white", mec=colour, mew=1.4, ms=6, label=label)


def segment_colour(k: int) -> tuple[float, float, float]:
    """Return the colour of segment k; ten colours in turn."""
    colour: tuple[float, float, float] = SEGMENT_COLOURS[k % len(SEGMENT_COLOURS)]
    return colour
