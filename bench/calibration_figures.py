"""What docs/cfsma.md shows beside the calibration: drawings of eqs. 2, 3 and 5, and a sweep that experiment 1 judges.

python bench/calibration_figures.py [FOLDER] writes geometry.png, curvature.png and sweep.md; some minutes.

The sweep: parameters whose values our copy of the paper lost or does not name, on seeds of their own. sigma_rho (lost),
U_k (1.0 in a unit it does not name) and the limit of distinctiveness (open). All values that the paper prints are kept.
The worlds and the noise are others than those of the experiments.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from curvescan.matchers.cfsma.config import CfSmaConfig
from curvescan.matchers.cfsma.curvature import curvature_functions
from curvescan.matchers.cfsma.landmarks import characteristic_points
from curvescan.paper.random_transform import RandomTransformCondition, RandomTransformRuns, run_random_transforms
from curvescan.plots.colours import DARK, GREY, LIGHT, PATH, TRUTH
from curvescan.plots.map import drawing
from curvescan.runs.document import ResultTable
from curvescan.types import Points

SEED = 1000  # first seed of the sweep; the experiments start at 0
SIGMAS_TRIED = tuple(mm / 1000 for mm in (10, 30, 50, 80, 120))  # sigma_rho tried, metres
TOLERANCES_TRIED = tuple(mm / 1000 for mm in (20, 30, 40, 60, 80))  # U_k tried, metres
AMBIGUITIES_TRIED = (0.98, 0.995, 0.999)  # limits of distinctiveness tried

CONDITIONS = (
    RandomTransformCondition(title="5 mm"),
    RandomTransformCondition(title="5 mm, 3 walkers", n_walkers=3),
    RandomTransformCondition(title="10 mm", sensor="sick-lms200"),
)
"""Conditions of experiment 1 under which each setting runs."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Setting:
    """One setting and what it reached, a RandomTransformRuns for each of CONDITIONS."""

    range_sigma: float
    arc_tolerance: float
    max_ambiguity: float
    runs: tuple[RandomTransformRuns, ...]

    @property
    def score(self) -> float:
        """Mean share of right runs over the conditions, 0 to 1."""
        return float(np.mean([one.right_share for one in self.runs]))


def sweep(*, n_runs: int = 500, seed: int = SEED, on_run: Callable[[], object] = lambda: None) -> list[Setting]:
    """Return every setting, best first."""
    settings = list(itertools.product(SIGMAS_TRIED, TOLERANCES_TRIED, AMBIGUITIES_TRIED))
    configs = tuple(_config(*setting) for setting in settings)
    columns = [
        run_random_transforms(one, n_runs=n_runs, seed=seed, configs=configs, on_run=on_run) for one in CONDITIONS
    ]
    found = [
        Setting(range_sigma=sigma, arc_tolerance=u_k, max_ambiguity=limit, runs=runs)
        for (sigma, u_k, limit), runs in zip(settings, zip(*columns, strict=True), strict=True)
    ]
    return sorted(found, key=lambda setting: -setting.score)


def _config(range_sigma: float, arc_tolerance: float, max_ambiguity: float) -> CfSmaConfig:
    base = CfSmaConfig()
    return replace(
        base,
        segmentation=replace(base.segmentation, range_sigma=range_sigma),
        curvature=replace(base.curvature, arc_tolerance=arc_tolerance),
        landmarks=replace(base.landmarks, max_ambiguity=max_ambiguity),
    )


def sweep_table(settings: list[Setting]) -> ResultTable:
    """Return the settings with the share of right runs, mean errors of these and N_t."""
    rows = []
    for setting in settings:
        x, y, theta = setting.runs[0].mean_of_right
        rows.append(
            (
                f"{setting.range_sigma:g}",
                f"{setting.arc_tolerance:g}",
                f"{setting.max_ambiguity:g}",
                f"{100 * setting.score:.1f} %",
                *(f"{100 * one.right_share:.1f} ± {100 * one.right_spread:.1f} %" for one in setting.runs),
                f"{1e3 * x:.1f}, {1e3 * y:.1f} mm, {np.degrees(theta):.2f} deg",
                f"{setting.runs[0].mean_n_matched:.0f}",
            )
        )
    return ResultTable(
        title=f"cfsma, experiment 1: {len(settings[0].runs[0].errors):,} runs for each condition, right within 0.1 m "
        f"and 2 deg",
        columns=(
            "sigma_rho [m]",
            "U_k [m]",
            "max_ambiguity",
            "right, mean",
            *(condition.title for condition in CONDITIONS),
            "mean errors of right, 5 mm",
            "N_t, 5 mm",
        ),
        rows=rows,
    )


def draw_geometry(path: Path) -> None:
    """Save the limit of eq. 2 between two beams, and arc and chord of eq. 3 around a corner."""
    with drawing(path, 11.0, 4.2) as figure:
        left, right = figure.subplots(1, 2)
        before, step, incidence = 3.0, np.radians(12.0), np.radians(28.0)
        first = before * np.array([np.cos(0.2), np.sin(0.2)])
        # law of sines: a surface met at the limiting incidence by both beams
        gap = before * np.sin(step) / np.sin(incidence - step)
        away = 0.2 + incidence
        second = first + gap * np.array([np.cos(away), np.sin(away)])
        for point, name in ((first, "l - 1"), (second, "l")):
            left.plot([0.0, point[0]], [0.0, point[1]], color=GREY, lw=1.0)
            left.annotate(name, point, textcoords="offset points", xytext=(6, -10))
        left.plot(*np.array([first, second]).T, "o-", color=DARK, lw=1.6)
        left.plot(0.0, 0.0, "s", color=PATH, ms=7)
        left.annotate("dphi", (1.0, 0.33), color=PATH)
        left.annotate("lambda", first + np.array([0.35, 0.16]), color=PATH)
        left.annotate("rho", 0.55 * first - np.array([0.0, 0.18]), color=PATH)
        left.set_title("eq. 2: a longer gap, by 3 sigma_rho, is a breakpoint")
        walk = np.array([[0.1 * k, 0.0] for k in range(9)] + [[0.8, 0.1 * k] for k in range(1, 8)])
        right.plot(*walk.T, "o-", color=DARK, ms=4, lw=1.0, label="readings")
        right.plot(*walk[3:13].T, "o-", color=LIGHT, ms=5, lw=2.4, label="arc, from l to l + k")
        right.plot(*walk[[3, 12]].T, "--", color=PATH, lw=1.6, label="chord, its direction is theta_l")
        right.set_title("eq. 3: k grows while arc - chord < U_k")
        right.legend()
        for axes in (left, right):
            axes.set_aspect("equal", adjustable="datalim")
            axes.set(xlabel="x [m]", ylabel="y [m]")


def draw_curvature(path: Path, *, sigma: float = 0.003, seed: int = 0) -> None:
    """Save a segment of two corners and its curvature function, with U_p and the characteristic points."""
    config = CfSmaConfig()
    points = _segment(sigma, seed)
    starts, stops = np.array([0]), np.array([len(points)])
    eta, _ = curvature_functions(points, starts, stops, config.curvature)
    peaks = characteristic_points(eta, starts, stops, config.landmarks).extents[:, 0]
    with drawing(path, 11, 4) as figure:
        left, right = figure.subplots(1, 2)
        left.plot(*points.T, ".", color=DARK, ms=4)
        left.plot(*points[peaks].T, "o", color="none", mec=PATH, mew=1.6, ms=9)
        left.set_aspect("equal", adjustable="datalim")
        left.set(xlabel="x [m]", ylabel="y [m]", title="a segment and its characteristic points")
        right.plot(eta, color=DARK, lw=1.0)
        right.plot(peaks, eta[peaks], "o", color="none", mec=PATH, mew=1.6, ms=9)
        for sign in (-1.0, 1.0):
            level = sign * config.landmarks.min_curvature
            right.axhline(level, color=TRUTH, ls="--", lw=1.0)
        right.annotate("U_p", (2, config.landmarks.min_curvature + 0.01), color=TRUTH)
        right.set(xlabel="reading l", ylabel="eta [rad]", title="its curvature function (eq. 5)")


def _segment(sigma: float, seed: int) -> Points:
    """Return readings 3 cm apart along a wall, round a corner to the left, and round one to the right."""
    steps = np.repeat([[0.03, 0.0], [0.0, 0.03], [0.03, 0.0]], 40, axis=0)
    noise = sigma * np.random.default_rng(seed).standard_normal((len(steps), 2))
    points: Points = np.cumsum(steps, axis=0) + noise
    return points


def main() -> None:
    """Write the drawings and the sweep's table."""
    folder = Path(sys.argv[1]) if len(sys.argv) > 1 else Path("docs/calibration")
    draw_geometry(folder / "geometry.png")
    draw_curvature(folder / "curvature.png")
    (folder / "sweep.md").write_text(sweep_table(sweep()).markdown(), encoding="utf-8", newline="\n")


if __name__ == "__main__":
    main()
