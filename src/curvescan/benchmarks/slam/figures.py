"""Figures of the SLAM benchmarks: a day by the hour, and the NEES of the final poses against its law.

Run as ``python -m curvescan.benchmarks.slam.figures RESULTS FIGURE``: the NEES of the floors that
``curvescan.benchmarks.slam.closures --append RESULTS`` judged.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Mapping
from pathlib import Path

import numpy as np

from curvescan.plots.canvas import drawing, segment_colour
from curvescan.types import Floats

_DOF = 3
_LONGEST = 16.0  # of the axis: chi-square of 3 degrees of freedom, 99.9 %


def draw_day(path: Path, *, keyframes: Floats, megabytes: Floats, milliseconds: Floats) -> None:
    """Save a picture of a day by the hour.

    keyframes, megabytes (n,); milliseconds (n, 3).
    """
    hour = np.arange(1, len(keyframes) + 1)
    with drawing(path, 10.0, 3.4) as figure:
        graph, memory, times = figure.subplots(1, 3)
        graph.plot(hour, keyframes, ".-", color=segment_colour(0))
        graph.set(xlabel="hour", ylabel="keyframes", ylim=(0.0, None))
        memory.plot(hour, megabytes, ".-", color=segment_colour(1))
        memory.set(xlabel="hour", ylabel="resident memory [MB]", ylim=(0.0, None))
        for k, label in enumerate(("median", "99 %", "worst")):
            times.plot(hour, milliseconds[:, k], ".-", color=segment_colour(2 + k), label=label)
        times.set(xlabel="hour", ylabel="a scan [ms]", yscale="log")
        times.legend()


def draw_nees(path: Path, found: Mapping[str, Floats]) -> None:
    """Save a picture of how the squared Mahalanobis distances of final poses are distributed, beside chi-square."""
    from scipy.stats import chi2

    with drawing(path, 7.0, 4.2) as figure:
        axes = figure.subplots()
        at = np.linspace(0.0, _LONGEST, 200)
        axes.plot(at, chi2.cdf(at, _DOF), color="black", lw=1.0, label="chi-square, 3 dof: mean 3")
        for k, (name, values) in enumerate(found.items()):
            n = len(values)
            low, high = chi2.ppf([0.025, 0.975], _DOF * n) / n
            label = f"{name}: mean {values.mean():.2f} ({low:.2f} to {high:.2f} of {n})"
            axes.step(
                np.sort(values), np.arange(1, n + 1) / n, where="post", color=segment_colour(k), label=label
            )  # fmt: skip
        axes.set(
            xlim=(0.0, _LONGEST),
            ylim=(0.0, 1.0),
            xlabel="squared Mahalanobis distance of the last pose",
            ylabel="share of the floors",
        )
        axes.legend(loc="lower right")


def main() -> None:
    """Draw the NEES of the ordinary floors in a file of results."""
    results, figure = Path(sys.argv[1]), Path(sys.argv[2])
    rows = [json.loads(line) for line in results.read_text(encoding="utf-8").splitlines()]
    names = {"ordinary": "361 beams, 10 mm noise", "noisy": "181 beams, 30 mm noise"}
    found = {
        words: np.array([r["nees"] for r in rows if r["kind"] == kind and r["forced"] == 0.0])
        for kind, words in names.items()
    }
    draw_nees(figure, {words: values for words, values in found.items() if len(values)})


if __name__ == "__main__":
    main()
