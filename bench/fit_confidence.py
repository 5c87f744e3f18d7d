"""Fit the confidence of the default matcher anew: `python bench/fit_confidence.py [--n 150] [--seed 40] [--check]`.

Runs the matcher on every deceptive world, on the bench's scenarios, and, where CURVESCAN_DATA holds them, on key scans
of real logs (neighbours: right; far apart: nothing shared), without a guess and with a good or a made-up one. Prints the
constants of `curvescan.matchers.curvescan.confidence` and draws a reliability diagram. Every set counts the same.
With --check nothing is fitted: the diagram is that of the constants as they are.
"""

from __future__ import annotations

import argparse
import itertools
import os
from collections.abc import Iterable, Iterator
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from scipy.optimize import minimize

import curvescan as cs
from curvescan import se2
from curvescan.benchmarks.scenarios import SCENARIOS
from curvescan.matchers.curvescan import confidence as model
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.scan import LaserScan
from curvescan.simulation import simulate_pairs
from curvescan.simulation.deceptive import DECEPTIONS, deceptive_pairs
from curvescan.types import Floats, Pose

Pair = tuple[LaserScan, LaserScan, Pose | None, Pose | None]
"""Reference, current, true pose (None: nothing is shared), guess."""

CHI2_99 = 11.345
NEAR_SIM, NEAR_REAL = (0.1, np.radians(2.0)), (0.25, np.radians(3.0))
KEY_LOGS = (
    "keyframed-corrected/belgioioso-corrected.log.gz",
    "keyframed-corrected/seattle-corrected.log.gz",
    "keyframed-corrected/acapulco-corrected.log.gz",
    "intel-lab/intel-corrected.log.gz",
    "aces/aces-corrected.log.gz",
)
# what deceives a scan matcher by its nature: nothing in the two scans shows it
UNFITTED = ("company",)


def key_scans(path: Path) -> tuple[list[LaserScan], Pose]:
    """Return the key scans of a corrected log and their poses."""
    log = cs.read_log(path)
    return list(log), log.odometry.poses


def near_pairs(scans: list[LaserScan], poses: Pose, n: int, seed: int) -> Iterator[Pair]:
    """Yield n neighbouring key scans, at most 2.5 m apart."""
    for i in np.random.default_rng(seed).permutation(len(scans) - 1)[:n]:
        true = se2.between(poses[i], poses[i + 1])
        if np.hypot(*true[:2]) < 2.5:
            yield scans[i], scans[i + 1], true, None


def far_pairs(scans: list[LaserScan], poses: Pose, n: int, seed: int) -> Iterator[Pair]:
    """Yield n pairs of key scans that were taken 25 m apart or more."""
    rng = np.random.default_rng(seed)
    while n > 0:
        i, j = rng.integers(len(scans), size=2)
        if np.hypot(*(poses[i] - poses[j])[:2]) > 25.0:
            n -= 1
            yield scans[i], scans[j], None, None


def guessed(pairs: Iterable[Pair], seed: int) -> Iterator[Pair]:
    """Yield pairs with a guess: near the truth, or, where there is none, that of a robot that drives on."""
    rng = np.random.default_rng(seed)
    for ref, cur, true, _ in pairs:
        off = rng.normal(size=3) * (0.1, 0.1, 0.05)
        guess = off * (3.0, 1.0, 3.0) if true is None else true + off
        yield ref, cur, true, guess


def sets(n: int, seed: int) -> Iterator[tuple[str, Iterable[Pair]]]:
    """Yield names and pairs of everything that is fitted to."""
    for name in DECEPTIONS:
        pairs = deceptive_pairs(name, n_pairs=n, seed=seed)
        yield name, ((p.reference, p.current, p.pose, p.guess) for p in pairs)
    for scenario in SCENARIOS:
        made = simulate_pairs(
            "office",
            sensor=scenario.sensor,
            n_pairs=2 * n,
            translation_max=scenario.translation_max,
            rotation_max=np.radians(scenario.rotation_max_deg),
            people_share=scenario.people_share,
            seed=seed,
        )
        yield f"office {scenario.name}", ((p.reference, p.current, p.pose, None) for p in made)
    for name in ("another room, 180 deg", "another room, 360 deg", "turned away, office"):
        pairs = deceptive_pairs(name, n_pairs=n, seed=seed + 1)
        plain = ((p.reference, p.current, p.pose, None) for p in pairs)
        yield f"{name}, guessed", guessed(plain, seed)
    data = Path(os.environ.get("CURVESCAN_DATA", "../shared/data"))
    for path in KEY_LOGS:
        if not (data / path).exists():
            print(f"{data / path} is not there: left out")
            continue
        scans, poses = key_scans(data / path)
        name = Path(path).name.split("-")[0]
        yield f"{name} near", near_pairs(scans, poses, 2 * n, seed)
        yield f"{name} far", far_pairs(scans, poses, n, seed)
        yield f"{name} near, guessed", guessed(near_pairs(scans, poses, n, seed + 1), seed)


def is_right(result: cs.MatchResult, true: Pose | None, near: tuple[float, float]) -> bool:
    """Return whether the best pose, matched or not, is right: near the truth or within its wide covariance."""
    assessed = result.trace.assessed
    if true is None:
        return False
    pose = result.pose if result.ok else assessed.poses[0]
    error = pose - true
    error[2] = float(se2.wrap(error[2]))
    if np.hypot(*error[:2]) < near[0] and abs(error[2]) < near[1]:
        return True
    if not assessed.is_degenerate.any() or assessed.is_degenerate.all():
        return False
    cov = result.covariance
    if not result.ok:
        config = CurvescanConfig().information
        cov = assessed.assessment.covariance(assessed.is_degenerate, config)
    return bool(error @ np.linalg.solve(cov, error) < CHI2_99)


class Table:
    """One row a pair that has a best pose: what supports it, whether it is right, of which set, whether it matched."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.terms: list[list[float]] = []
        self.right: list[bool] = []
        self.flagged: list[bool] = []
        self.counts: dict[str, int] = {}

    def add(self, name: str, pairs: Iterable[Pair]) -> None:
        """Match pairs and add a row for each."""
        near = NEAR_REAL if " near" in name else NEAR_SIM
        for ref, cur, true, guess in pairs:
            self.counts[name] = self.counts.get(name, 0) + 1
            result = cs.match(ref, cur, guess=guess)
            assessed = result.trace.assessed
            if assessed.support is None:
                continue
            self.names.append(name)
            self.terms.append(list(assessed.support.terms.values()))
            self.right.append(is_right(result, true, near))
            self.flagged.append(bool(assessed.is_degenerate.any()))

    def weights(self) -> Floats:
        """(n,) weights by which every set counts the same, summing to 1."""
        names = np.array(self.names)
        weights = np.array(
            [0.0 if one in UNFITTED else 1.0 / np.sum(names == one) for one in names]
        )
        return weights / weights.sum()


def probability(terms: Floats, coefficients: Floats) -> Floats:
    """Return the confidence by the model."""
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(terms @ coefficients, -60.0, 60.0))))


def fit(terms: Floats, right: Floats, weights: Floats) -> Floats:
    """Return the coefficients of most likelihood, slightly drawn to 0.

    What a guess is worth is bounded: the guesses here are better than those of a robot that slips.
    """
    sign = np.where(right, 1.0, -1.0)

    def loss(coefficients: Floats) -> float:
        misfit = weights @ np.logaddexp(0.0, -sign * (terms @ coefficients))
        return float(misfit + 2e-5 * np.sum(coefficients[1:] ** 2))

    bounds = [(0.0, 3.0) if name == "guessed" else (-20.0, 20.0) for name in model.COEFFICIENTS]
    start = np.zeros(terms.shape[1])
    return np.asarray(minimize(loss, start, method="L-BFGS-B", bounds=bounds).x)


def draw(p: Floats, right: Floats, weights: Floats, path: Path) -> None:
    """Draw how many of the poses said to be right with some probability are right."""
    edges = np.array([0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97, 0.99, 1.0001])
    figure, ax = plt.subplots(figsize=(5, 4.4))
    ax.plot([0, 1], [0, 1], color="0.7", lw=1)
    for low, high in itertools.pairwise(edges):
        rows = (p >= low) & (p < high)
        if rows.sum() < 20:
            continue
        said, is_so = (
            np.average(p[rows], weights=weights[rows]),
            np.average(right[rows], weights=weights[rows]),
        )
        print(f"said {said:.3f}, right {is_so:.3f}, {rows.sum()} pairs")
        ax.plot(said, is_so, "o", color="tab:blue", ms=4 + 2 * np.log10(rows.sum()))
    ax.set(xlabel="confidence", ylabel="share that is right", xlim=(0, 1.02), ylim=(0, 1.02))
    ax.set_aspect("equal")
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def main() -> None:
    """Run, fit, print, draw."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--n", type=int, default=150)
    parser.add_argument("--seed", type=int, default=40)
    parser.add_argument("--check", action="store_true")
    parser.add_argument("--out", type=Path, default=Path("docs/design-notes/confidence.png"))
    arguments = parser.parse_args()
    table = Table()
    for name, pairs in sets(arguments.n, arguments.seed):
        table.add(name, pairs)
    terms, right, names = np.array(table.terms), np.array(table.right), np.array(table.names)
    is_unique = terms[:, list(model.COEFFICIENTS).index("repetition")] <= model.MAX_REPETITION
    weights = table.weights() * is_unique
    weights /= weights.sum()
    coefficients = np.array(list(model.COEFFICIENTS.values()))
    if not arguments.check:
        coefficients = fit(terms, right, weights)
        for key, value in zip(model.COEFFICIENTS, coefficients, strict=True):
            print(f'    "{key}": {value:.2f},')
    p = np.where(is_unique, probability(terms, coefficients), 0.0)
    flagged = np.array(table.flagged)
    limits = (0.3, 0.5, 0.6, 0.7, 0.8)
    print(
        f"share of all pairs that is right / sure and wrong / flagged and wrong, for least confidences {limits}"
    )
    for name, count in table.counts.items():
        rows = names == name
        cells = []
        for limit in limits:
            kept = rows & (p > limit)
            shares = [kept & right, kept & ~right & ~flagged, kept & ~right & flagged]
            cells.append(" ".join(f"{100 * one.sum() / count:5.1f}" for one in shares))
        print(f"{name:34s} {100 * (rows & right).sum() / count:5.1f} | " + " | ".join(cells))
    fitted = ~np.isin(names, UNFITTED) & is_unique
    draw(p[fitted], right[fitted], weights[fitted], arguments.out)


if __name__ == "__main__":
    main()
