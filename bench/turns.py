"""Success against the angle by which a full-circle sensor turned between two scans."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np

from curvescan import se2
from curvescan.matchers import match
from curvescan.paper.random_transform import SUCCESS
from curvescan.plots.colours import segment_colour
from curvescan.plots.map import drawing
from curvescan.simulation import simulate_pairs
from curvescan.types import Floats

TURNS_DEG = tuple(range(0, 181, 15))
"""Turns tried, degrees."""

TRANSLATION_MAX = 0.3
"""Translation that goes with them, metres at most."""


def success_by_turn(
    methods: Sequence[str], *, n_pairs: int = 60, seed: int = 2, on_pair: Callable[[], None] | None = None
) -> dict[str, Floats]:
    """Return the share of pairs that each method matches rightly without a guess, for each turn."""
    rng = np.random.default_rng(seed)
    right = {method: np.zeros(len(TURNS_DEG)) for method in methods}
    for k, turn_deg in enumerate(TURNS_DEG):
        bearing = rng.uniform(-np.pi, np.pi, n_pairs)
        radius = TRANSLATION_MAX * np.sqrt(rng.uniform(size=n_pairs))
        side = np.where(np.arange(n_pairs) % 2 == 0, 1.0, -1.0)
        motions = np.column_stack([radius * np.cos(bearing), radius * np.sin(bearing), side * np.radians(turn_deg)])
        for pair in simulate_pairs("office", sensor="spinning-360", motions=motions, seed=seed + k):
            for method in methods:
                result = match(pair.reference, pair.current, method=method)
                x, y, theta = se2.between(pair.pose, result.pose)
                is_right = np.hypot(x, y) < SUCCESS[0] and abs(theta) < SUCCESS[1]
                right[method][k] += bool(result.ok and is_right)
            if on_pair:
                on_pair()
    return {method: counts / n_pairs for method, counts in right.items()}


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
