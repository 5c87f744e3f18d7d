"""Success against turn angle, one line a method."""

from __future__ import annotations

from pathlib import Path

from curvescan.benchmarks.rotation import TRANSLATION_MAX, TURNS_DEG
from curvescan.plots.canvas import drawing, segment_colour
from curvescan.types import Floats


def draw_turns(path: Path, shares: dict[str, Floats]) -> None:
    """Save the share of right matches against the turn of a full-circle sensor."""
    with drawing(path, 9.0, 4.6) as figure:
        axes = figure.subplots()
        for k, (method, share) in enumerate(shares.items()):
            axes.plot(TURNS_DEG, 100.0 * share, ".-", color=segment_colour(k), label=method)
        axes.set(xlabel="turn between the scans [deg]", ylabel="right matches [%]", ylim=(-3, 103))
        axes.set_xticks(TURNS_DEG[::2])
        axes.set_title(f"360 beams over the full circle, no guess, offices, up to {TRANSLATION_MAX:g} m apart")
        figure.legend(loc="outside lower center", ncols=4)
