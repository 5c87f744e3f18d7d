"""Fit the confidence of the default matcher anew: `python bench/fit_confidence.py [--n 150] [--seed 40] [--check]`.

Runs the matcher on every deceptive world, on the bench's scenarios, on offices and buildings with round people in them,
and, where CURVESCAN_DATA holds them, on keyframes of real logs (neighbours: right; far apart: nothing shared), without
a guess and with a good or a made-up one. Pairs of another generator are judged with, not fitted to. Prints the
constants of `curvescan.matchers.curvescan.assessment.confidence`, a table of reliability with each family of sets left
out of the fit in turn, and draws the diagram of the whole. Every set counts the same. With --check nothing is fitted:
table and diagram are those of the constants as they are.
"""

from __future__ import annotations

import argparse
import itertools
import math
import os
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

import curvescan as cs
from curvescan import se2
from curvescan.benchmarks.scenarios import SCENARIOS
from curvescan.matchers.curvescan.assessment import confidence as model
from curvescan.matchers.curvescan.disambiguation import AssessedPose
from curvescan.matchers.curvescan.pose_difference import is_along
from curvescan.scan import LaserScan
from curvescan.simulation import simulate_pairs
from curvescan.simulation.sensing.people import People
from curvescan.types import Floats, Pose
from deceptive import DECEPTIONS, deceptive_pairs

Pair = tuple[LaserScan, LaserScan, Pose | None, Pose | None]
"""Reference, current, true pose (None: nothing is shared), guess."""

LIMITS = (0.4, 0.5, 0.55, 0.6, 0.7, 0.8)
N_RIVALS = 4
SIZES = (("small", 0.1, 5.0), ("medium", 0.3, 15.0), ("large", 0.6, 40.0))
NEAR_SIM, NEAR_REAL = (0.1, np.radians(2.0)), (0.25, np.radians(3.0))
# metres up to which each measures: the laser of Acapulco writes 51.05 to 51.16 where nothing returns, up to 46 readings
# of a scan, an arc
# that moves with the sensor
KEY_LOGS = {
    "keyframed-corrected/belgioioso-corrected.log.gz": math.inf,
    "keyframed-corrected/seattle-corrected.log.gz": math.inf,
    "keyframed-corrected/acapulco-corrected.log.gz": 50.5,
    "intel-lab/intel-corrected.log.gz": math.inf,
    "aces/aces-corrected.log.gz": math.inf,
}
PEOPLE = "pairs-people/pairs.npz"
# what deceives a scan matcher by its nature: nothing in the two scans shows it
UNFITTED = ("company",)
# of a generator that is to judge, not to be fitted to
JUDGING = "people "


def key_scans(path: Path, range_max: float) -> tuple[list[LaserScan], Pose]:
    """Return the key scans of a corrected log, without readings beyond `range_max`, and their poses."""
    log = cs.read_log(path)
    scans = [replace(scan, range_max=min(scan.range_max, range_max)) for scan in log]
    return scans, log.odometry.poses


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


def family(name: str) -> str:
    """Return to which generator a set belongs."""
    if name.startswith("people"):
        return "another generator"
    if name.startswith(("office ", "crowd ")):
        return "offices"
    return "real logs" if any(word in name for word in (" near", " far")) else "deceptive worlds"


def pairs_of_people(path: Path, rows: range) -> Iterator[tuple[str, list[Pair]]]:
    """Yield names and pairs of the cells of a file of pairs made by another generator."""
    data = np.load(path)
    angles, top = data["angles"], float(data["max_range"])
    step = float(angles[1] - angles[0])
    for kind in ("people", "clean"):
        for cell in ("small", "medium", "large"):
            pairs: list[Pair] = []
            for i in rows:
                ref, cur = (
                    LaserScan(
                        data[f"{cell}_{kind}_{which}"][i].astype(float),
                        angle_min=float(angles[0]),
                        angle_increment=step,
                        range_min=0.02,
                        range_max=top,
                    )
                    for which in ("ref", "cur")
                )
                pairs.append((ref, cur, data[f"{cell}_true"][i], None))
            yield f"people {cell} {kind}", pairs


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
    for world, (size, reach, turn) in itertools.product(("office", "building"), SIZES):
        made = simulate_pairs(
            world, n_pairs=n, translation_max=reach, rotation_max=np.radians(turn), people_share=0.15, seed=seed
        )
        made = replace(made, people=People(body_radius=0.2))
        plain = ((p.reference, p.current, p.pose, None) for p in made)
        yield f"crowd {world}, {size}", plain
    for name in ("another room, 180 deg", "another room, 360 deg", "turned away, office"):
        pairs = deceptive_pairs(name, n_pairs=n, seed=seed + 1)
        plain = ((p.reference, p.current, p.pose, None) for p in pairs)
        yield f"{name}, guessed", guessed(plain, seed)
    data = Path(os.environ.get("CURVESCAN_DATA", "../shared/data"))
    if (data / PEOPLE).exists():
        yield from pairs_of_people(data / PEOPLE, range(200))
    for path, range_max in KEY_LOGS.items():
        if not (data / path).exists():
            print(f"{data / path} is not there: left out")
            continue
        scans, poses = key_scans(data / path, range_max)
        name = Path(path).name.split("-")[0]
        yield f"{name} near", near_pairs(scans, poses, 2 * n, seed)
        yield f"{name} far", far_pairs(scans, poses, n, seed)
        yield f"{name} near, guessed", guessed(near_pairs(scans, poses, n, seed + 1), seed)


def is_near(pose: Pose, true: Pose, near: tuple[float, float]) -> bool:
    """Return whether a pose is within so many metres and radians of the true one."""
    error = pose - true
    turn = abs(float(se2.wrap(error[2])))
    return bool(np.hypot(*error[:2]) < near[0] and turn < near[1])


class Table:
    """One row a pair that has a best pose: terms of it and of its rivals, which is right, of which set, what came of it."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.terms: list[list[float]] = []
        self.rival_terms: list[Floats] = []
        self.is_rival: list[NDArray[np.bool_]] = []
        self.right: list[int] = []
        self.flagged: list[bool] = []
        self.confidence: list[float] = []
        self.is_repeated: list[bool] = []
        self.counts: dict[str, int] = {}

    def add(self, name: str, pairs: Iterable[Pair]) -> None:
        """Match pairs and add a row for each."""
        near = NEAR_REAL if " near" in name else NEAR_SIM
        for ref, cur, true, guess in pairs:
            self.counts[name] = self.counts.get(name, 0) + 1
            assessed = cs.match(ref, cur, guess=guess).trace.assessed
            if assessed.support is None:
                continue
            weighed, support = assessed.weighed, assessed.support
            rivals = list(support.rivals)[:N_RIVALS]
            rows = np.zeros((N_RIVALS, len(model.RIVAL_COEFFICIENTS)))
            for j, k in enumerate(rivals):
                of = weighed.rival_terms(k)
                rows[j] = [of[term] for term in model.RIVAL_COEFFICIENTS]
            self.names.append(name)
            is_degenerate = bool(assessed.is_degenerate.any())
            self.terms.append(list(weighed.terms(0, is_degenerate).values()))
            self.rival_terms.append(rows)
            self.is_rival.append(np.arange(N_RIVALS) < len(rivals))
            self.right.append(_right(assessed, rivals, true, near))
            self.flagged.append(is_degenerate)
            self.confidence.append(support.probabilities(assessed.ties).accept)
            is_alone = set(support.repeated()) <= set(assessed.ties)
            self.is_repeated.append(not is_alone or weighed.may_be_turned)


def _right(assessed: AssessedPose, rivals: list[int], true: Pose | None, near: tuple[float, float]) -> int:
    """Return 0 if the best pose is right, 1 + j if the rival j is, -1 if none is."""
    if true is None:
        return -1
    poses, assessment = assessed.weighed.poses, assessed.assessment
    along = assessed.is_degenerate[0] and is_along(assessment.weakest, poses[0], true, 0.15)
    if is_near(poses[0], true, near) or along:
        return 0
    return next((1 + j for j, k in enumerate(rivals) if is_near(poses[k], true, near)), -1)


@dataclass(frozen=True, eq=False, kw_only=True)
class Data:
    """The table in arrays: (n, t) terms, (n, r, u) terms of rivals, (n, r) which are any, (n,) the right row or -1."""

    terms: Floats
    rival_terms: Floats
    is_rival: NDArray[np.bool_]
    right: NDArray[np.int64]

    def rows(self, mask: NDArray[np.bool_]) -> Data:
        """Return some of the pairs."""
        return Data(
            terms=self.terms[mask],
            rival_terms=self.rival_terms[mask],
            is_rival=self.is_rival[mask],
            right=self.right[mask],
        )

    def probabilities(self, coefficients: Floats) -> Floats:
        """Return (n, 2 + r) probabilities: nothing in common, the best pose, each rival."""
        n_terms = self.terms.shape[1]
        odds = np.zeros((len(self.terms), 2 + self.is_rival.shape[1]))
        odds[:, 0] = -self.terms @ coefficients[:n_terms]
        odds[:, 2:] = np.where(self.is_rival, self.rival_terms @ coefficients[n_terms:], -60.0)
        weights = np.exp(np.clip(odds, -60.0, 60.0))
        return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def fit(data: Data, weights: Floats) -> Floats:
    """Return the coefficients of most likelihood, of the best pose and of rivals, slightly drawn to 0; the prior's is 1."""
    n_terms = data.terms.shape[1]
    is_so = np.eye(2 + data.is_rival.shape[1])[data.right + 1]

    def loss(coefficients: Floats) -> tuple[float, Floats]:
        p = data.probabilities(coefficients)
        misfit = -weights @ np.log(np.maximum((p * is_so).sum(axis=1), 1e-12))
        off = weights[:, np.newaxis] * (p - is_so)
        slope = np.concatenate((-off[:, 0] @ data.terms, np.einsum("nk,nkf->f", off[:, 2:], data.rival_terms)))
        return float(misfit + 1e-4 * np.sum(coefficients**2)), slope + 2e-4 * coefficients

    names = (*model.COEFFICIENTS, *model.RIVAL_COEFFICIENTS)
    bounds = [(1.0, 1.0) if name == "prior" else (-20.0, 20.0) for name in names]
    start = np.zeros(n_terms + len(model.RIVAL_COEFFICIENTS))
    return np.asarray(minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds).x)


def reliability(p: Floats, right: NDArray[np.bool_], weights: Floats) -> list[tuple[float, float, int]]:
    """Return of each band of confidence its mean, the share that is right, and how many pairs it has."""
    edges = (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.9, 0.97, 0.99, 1.0001)
    bands = []
    for low, high in itertools.pairwise(edges):
        rows = (p >= low) & (p < high)
        if rows.sum() >= 20:
            said, is_so = (np.average(one[rows], weights=weights[rows]) for one in (p, right))
            bands.append((float(said), float(is_so), int(rows.sum())))
    return bands


def draw(bands: list[tuple[float, float, int]], path: Path) -> None:
    """Draw how many of the poses said to be right with some probability are right."""
    figure, ax = plt.subplots(figsize=(5, 4.4))
    ax.plot([0, 1], [0, 1], color="0.7", lw=1)
    for said, is_so, n in bands:
        ax.plot(said, is_so, "o", color="tab:blue", ms=4 + 2 * np.log10(n))
    ax.set(xlabel="confidence", ylabel="share that is right", xlim=(0, 1.02), ylim=(0, 1.02))
    ax.set_aspect("equal")
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def show_sets(table: Table, p: Floats) -> None:
    """Print of each set the shares that are right, sure and wrong, and flagged and wrong, for some least confidences."""
    names, right = np.array(table.names), np.array(table.right) == 0
    flagged = np.array(table.flagged)
    print(f"share of all pairs that is right / sure and wrong / flagged and wrong, from {LIMITS}")
    for name, count in table.counts.items():
        rows = names == name
        cells = []
        for limit in LIMITS:
            kept = rows & (p > limit)
            shares = [kept & right, kept & ~right & ~flagged, kept & ~right & flagged]
            cells.append(" ".join(f"{100 * one.sum() / count:5.1f}" for one in shares))
        print(f"{name:34s} {100 * (rows & right).sum() / count:5.1f} | " + " | ".join(cells))


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
    names = np.array(table.names)
    families = np.array([family(name) for name in table.names])
    data = Data(
        terms=np.array(table.terms),
        rival_terms=np.array(table.rival_terms),
        is_rival=np.array(table.is_rival),
        right=np.array(table.right),
    )
    is_judged = np.char.startswith(names, JUDGING)
    is_shown = ~np.array(table.is_repeated) & ~np.isin(names, UNFITTED)
    is_fitted = is_shown & ~is_judged
    weights = np.array([1.0 / np.sum(names == one) for one in names])
    p, right = np.array(table.confidence), data.right == 0
    if not arguments.check:
        fitted = weights * is_fitted
        coefficients = fit(data, fitted / fitted.sum())
        keys = [*model.COEFFICIENTS, *model.RIVAL_COEFFICIENTS]
        for key, value in zip(keys, coefficients, strict=True):
            print(f'    "{key}": {value:.2f},')
        p = data.probabilities(coefficients)[:, 1]
    p = np.where(table.is_repeated, 0.0, p)
    show_sets(table, p)
    for left_out in sorted(set(families)):
        rows = is_shown & (families == left_out)
        if not arguments.check:
            kept = weights * is_fitted * (families != left_out)
            p_out = data.probabilities(fit(data, kept / kept.sum()))[:, 1]
            print(f"{left_out}, left out of the fit:", *_bands(p_out, right, weights, rows))
        print(f"{left_out}:", *_bands(p, right, weights, rows))
    bands = reliability(p[is_fitted], right[is_fitted], weights[is_fitted])
    print("all:", *(f"{said:.3f} {so:.3f} ({n})," for said, so, n in bands))
    draw(bands, arguments.out)


def _bands(p: Floats, right: NDArray[np.bool_], weights: Floats, rows: NDArray[np.bool_]) -> list[str]:
    bands = reliability(p[rows], right[rows], weights[rows])
    return [f"{said:.3f} {so:.3f} ({n})," for said, so, n in bands]


if __name__ == "__main__":
    main()
