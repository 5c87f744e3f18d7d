"""The parameters whose values our copy of the paper lost or does not name, swept on seeds of their own.

sigma_rho (lost), U_k (1.0 in a unit it does not name) and the limit of distinctiveness (open). All values that the
paper prints are kept. The worlds and the noise are others than those of the experiments.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from curvescan.matchers.cfsma.config import CfSmaConfig
from curvescan.paper.random_transform import RandomTransformCondition, RandomTransformRuns, run_random_transforms
from curvescan.runs.table import ResultTable

SEED = 1000  # first seed of the sweep; the experiments start at 0
SIGMAS = tuple(mm / 1000 for mm in (10, 30, 50, 80, 120))  # sigma_rho tried, metres
TOLERANCES = tuple(mm / 1000 for mm in (20, 30, 40, 60, 80))  # U_k tried, metres
AMBIGUITIES = (0.98, 0.995, 0.999)  # limits of distinctiveness tried

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


def sweep(*, n_runs: int = 500, seed: int = SEED, on_run: Callable[[], None] | None = None) -> list[Setting]:
    """Return every setting, best first."""
    settings = list(itertools.product(SIGMAS, TOLERANCES, AMBIGUITIES))
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
