"""The colours of all figures."""

from typing import Any

import matplotlib as mpl

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
SEGMENT_COLOURS: list[Any] = mpl.color_sequences["tab10"]


def segment_colour(k: int) -> Any:
    """Return the colour of segment k; ten colours in turn."""
    return SEGMENT_COLOURS[k % len(SEGMENT_COLOURS)]
