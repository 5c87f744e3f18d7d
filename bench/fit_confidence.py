"""Fit the confidence of the default matcher anew: `python bench/fit_confidence.py [--n 150] [--seed 40] [--check]`.

Runs the matcher on every deceptive world, on the bench's scenarios, on offices and buildings with round people in them,
on keyframes of simulated floors matched by right and wrong priors, as a map's loops are, and, where CURVESCAN_DATA
holds them, on half of the pairs of another generator and on keyframes of real logs (neighbours: right; far apart:
nothing shared; Killian by priors). All but the keyframes are matched without a prior, and with one that may be wrong.
Prints the constants of `curvescan.matchers.curvescan.assessment.confidence`, a table of reliability with each family of
sets left out of the fit in turn, and draws the diagram of the whole. Every family counts the same, every set in it, and
every pair of a set, those too of which no pose was left.
With --check nothing is fitted: table and diagram are those of the constants as they are.
"""

from __future__ import annotations

import argparse
import itertools
import math
import os
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import minimize

import curvescan as cs
from curvescan import se2
from curvescan.benchmarks.scenarios import SCENARIOS
from curvescan.matchers.curvescan.assessment.assessment import AssessedPose
from curvescan.matchers.curvescan.assessment.confidence import COEFFICIENTS, terms_of
from curvescan.matchers.curvescan.disambiguation import unseen_odds
from curvescan.matchers.curvescan.pose_difference import is_along
from curvescan.scan import LaserScan
from curvescan.simulation import simulate_pairs
from curvescan.simulation.sensing.people import People
from curvescan.slam.config import MapKeyframesConfig
from curvescan.types import Floats, Pose, UncertainPose
from deceptive import DECEPTIONS, deceptive_pairs
from floors import recorded

Pair = tuple[LaserScan, LaserScan, Pose | None, UncertainPose | None]
"""Reference, current, true pose (None: nothing is shared), prior."""

DATA = Path(os.environ.get("CURVESCAN_DATA", "../shared/data"))
LIMITS = (0.4, 0.5, 0.6, 0.7, 0.8, 0.9)
N_RIVALS = 4
PRIORS = [list(COEFFICIENTS).index(name) for name in ("prior", "few_prior")]
SIZES = (("small", 0.1, 5.0), ("medium", 0.3, 15.0), ("large", 0.6, 40.0))
# metres and radians within which a pose is right; the corrected poses of a log are wrong by so much themselves
NEAR_SIM, NEAR_REAL = (0.1, np.radians(2.0)), (0.35, np.radians(4.0))
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
KILLIAN, KILLIAN_RANGE = "mit-killian/mit-killian.clf.gz", 50.5
# kinds of simulated floors, bench/floors.py
KINDS = "AHCEFB"
# what deceives a scan matcher by its nature: nothing in the two scans shows it
UNFITTED = ("company",)


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


def with_priors(pairs: Iterable[Pair], seed: int) -> Iterator[Pair]:
    """Yield each pair without a prior and with one, of three widths; where nothing is shared it says that they lie near."""
    rng = np.random.default_rng(seed)
    for ref, cur, true, _ in pairs:
        sigma = rng.choice([0.05, 0.15, 0.5])
        off = sigma * rng.normal(size=3)
        yield ref, cur, true, None
        yield ref, cur, true, UncertainPose(2.0 * off if true is None else true + off, sigma**2 * np.eye(3))


def keyframe_pairs(scans: Sequence[LaserScan], poses: Pose, n: int, seed: int) -> Iterator[Pair]:
    """Yield n pairs of keyframes, taken along a drive as a map takes them, with priors as its graph has them.

    Three in ten are far from each other, and the prior has them in one corridor; of the others three in ten have a
    prior that is off by 2 to 8 m.
    """
    rng = np.random.default_rng(seed)
    keys, is_due = [0], MapKeyframesConfig().is_far
    for i in range(len(poses)):
        if is_due(se2.between(poses[keys[-1]], poses[i])):
            keys.append(i)
    places, order = poses[keys], np.arange(len(keys))
    for _ in range(n):
        first = int(rng.integers(len(keys)))
        away = np.hypot(*(places - places[first])[:, :2].T)
        is_far, is_step = rng.random() < 0.3, rng.random() < 0.15
        others = away > 12.0 if is_far else (away < 8.0) & (away > 0.0) & (is_step | (np.abs(order - first) > 20))
        if not others.any():
            continue
        second = int(rng.choice(np.flatnonzero(others)))
        true = se2.between(places[first], places[second])
        sigma = np.array([1.0, 1.0, 0.0]) * rng.choice([0.3, 1.0, 2.0]) + [0.0, 0.0, rng.choice([0.05, 0.15])]
        expected = true + sigma * rng.normal(size=3)
        if is_far:
            expected = np.array([rng.uniform(-6.0, 6.0), rng.normal(), rng.choice([0.0, np.pi]) + 0.1 * rng.normal()])
        elif rng.random() < 0.3:
            way, off = rng.uniform(0.0, 2.0 * np.pi), rng.uniform(2.0, 8.0)
            expected[:2] = true[:2] + off * np.array([np.cos(way), np.sin(way)])
        prior = UncertainPose(expected, np.diag(sigma**2))
        yield scans[keys[first]], scans[keys[second]], true, prior


def family(name: str) -> str:
    """Return to which generator a set belongs."""
    if name.startswith("people"):
        return "another generator"
    if name.startswith(("office ", "crowd ")):
        return "offices"
    if name.startswith("keyframes"):
        return "keyframes of Killian" if "killian" in name else "keyframes of floors"
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
    for name, pairs in plain_sets(n, seed):
        yield name, with_priors(pairs, seed)
    for kind in KINDS:
        log, truth = recorded(kind, seed, has_wheels=False)
        yield f"keyframes, floor {kind}", keyframe_pairs(list(log), truth, 10 * n, seed)
    killian = DATA / KILLIAN
    if killian.exists():
        scans = [replace(scan, range_max=min(scan.range_max, KILLIAN_RANGE)) for scan in cs.read_log(killian)]
        yield "keyframes, killian near", keyframe_pairs(scans, cs.run(killian, "slam").trajectory.poses, 10 * n, seed)


def plain_sets(n: int, seed: int) -> Iterator[tuple[str, Iterable[Pair]]]:
    """Yield names and pairs of the sets that are matched without a prior and with one."""
    for name in DECEPTIONS:
        pairs = deceptive_pairs(name, n_pairs=n, seed=seed)
        yield name, ((p.reference, p.current, p.pose, None) for p in pairs)
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
        yield f"crowd {world}, {size}", ((p.reference, p.current, p.pose, None) for p in made)
    if (DATA / PEOPLE).exists():
        yield from pairs_of_people(DATA / PEOPLE, range(200))
    for path, range_max in KEY_LOGS.items():
        if not (DATA / path).exists():
            print(f"{DATA / path} is not there: left out")
            continue
        scans, poses = key_scans(DATA / path, range_max)
        name = Path(path).name.split("-")[0]
        yield f"{name} near", near_pairs(scans, poses, 2 * n, seed)
        yield f"{name} far", far_pairs(scans, poses, n, seed)


def is_near(pose: Pose, true: Pose, near: tuple[float, float]) -> bool:
    """Return whether a pose is within so many metres and radians of the true one."""
    error = pose - true
    turn = abs(float(se2.wrap(error[2])))
    return bool(np.hypot(*error[:2]) < near[0] and turn < near[1])


class Table:
    """One row a pair that has a best pose: terms of it and its rivals, which is right, of which set, what came of it."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.terms: list[Floats] = []
        self.right: list[int] = []
        self.flagged: list[bool] = []
        self.confidence: list[float] = []
        self.unseen: list[float] = []
        self.is_repeated: list[bool] = []
        self.counts: dict[str, int] = {}

    def add(self, name: str, pairs: Iterable[Pair]) -> None:
        """Match pairs and add a row for each."""
        near = NEAR_REAL if " near" in name else NEAR_SIM
        for ref, cur, true, prior in pairs:
            self.counts[name] = self.counts.get(name, 0) + 1
            assessed = cs.match(ref, cur, prior=prior).trace.assessed
            if assessed.support is None:
                continue
            scored, support = assessed.scored, assessed.support
            rows = [0, *support.competing][: 1 + N_RIVALS]
            terms = np.full((1 + N_RIVALS, len(COEFFICIENTS)), np.nan)
            terms[: len(rows)] = terms_of(scored.evidence, scored.priors, scored.wide_priors)[rows]
            terms[1:, PRIORS] = np.minimum(terms[1:, PRIORS], terms[0, PRIORS])  # to be expected more makes no rival
            self.names.append(name)
            self.terms.append(terms)
            self.right.append(_right(assessed, rows, true, near))
            self.flagged.append(any(assessed.is_degenerate))
            self.confidence.append(support.probabilities(assessed.ties)[0])
            self.unseen.append(unseen_odds(assessed, assessed.assessment))
            is_alone = set(support.repeated) <= set(assessed.ties)
            self.is_repeated.append(not is_alone or scored.may_be_turned)


def _right(assessed: AssessedPose, rows: list[int], true: Pose | None, near: tuple[float, float]) -> int:
    """Return which of some rows is right, the first among them the best pose; -1 if none is."""
    if true is None:
        return -1
    poses, assessment = assessed.scored.poses, assessed.assessment
    along = assessed.is_degenerate[0] and is_along(assessment.weakest, poses[0], true, 0.15)
    if is_near(poses[0], true, near) or along:
        return 0
    return next((j for j, k in enumerate(rows) if is_near(poses[k], true, near)), -1)


def probabilities(terms: Floats, coefficients: Floats) -> Floats:
    """Return (n, 2 + r) probabilities: nothing in common, the best pose, each rival; `terms` NaN where there is none."""
    odds = np.zeros((terms.shape[0], terms.shape[1] + 1))
    odds[:, 1:] = np.nan_to_num(terms @ coefficients, nan=-60.0)
    weights = np.exp(np.clip(odds, -60.0, 60.0))
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def fit(terms: Floats, right: NDArray[np.int64], weights: Floats) -> Floats:
    """Return the coefficients of most likelihood, slightly drawn to 0; the prior's is 1."""
    is_so = np.eye(2 + N_RIVALS)[right + 1]
    known = np.nan_to_num(terms)

    def loss(coefficients: Floats) -> tuple[float, Floats]:
        p = probabilities(terms, coefficients)
        misfit = -weights @ np.log(np.maximum((p * is_so).sum(axis=1), 1e-12))
        slope = np.einsum("n,nk,nkf->f", weights, (p - is_so)[:, 1:], known)
        return float(misfit + 1e-4 * np.sum(coefficients**2)), slope + 2e-4 * coefficients

    bounds = [(1.0, 1.0) if name == "prior" else (-20.0, 20.0) for name in COEFFICIENTS]
    return np.asarray(minimize(loss, np.zeros(len(bounds)), jac=True, method="L-BFGS-B", bounds=bounds).x)


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
    terms, which, is_right = np.array(table.terms), np.array(table.right), np.array(table.right) == 0
    is_fitted = ~np.array(table.is_repeated) & ~np.isin(names, UNFITTED)
    weights = np.zeros(len(names))
    for one in set(families):
        some = sorted(set(names[families == one]))
        for name in some:
            weights[names == name] = 1.0 / (len(some) * table.counts[name])

    def fitted_to(rows: NDArray[np.bool_]) -> Floats:
        return fit(terms[rows], which[rows], weights[rows] / weights[rows].sum())

    p = np.array(table.confidence)
    if not arguments.check:
        coefficients = fitted_to(is_fitted)
        for key, value in zip(COEFFICIENTS, coefficients, strict=True):
            print(f'    "{key}": {value:.2f},')
        p = probabilities(terms, coefficients)[:, 1]
    p = np.where(table.is_repeated, 0.0, p / (1.0 + np.array(table.unseen) * p))
    show_sets(table, p)
    for left_out in sorted(set(families)):
        rows = is_fitted & (families == left_out)
        if not arguments.check:
            others = probabilities(terms[rows], fitted_to(is_fitted & (families != left_out)))[:, 1]
            print(f"{left_out}, left out of the fit:", *_bands(others, is_right[rows], weights[rows]))
        print(f"{left_out}:", *_bands(p[rows], is_right[rows], weights[rows]))
    bands = reliability(p[is_fitted], is_right[is_fitted], weights[is_fitted])
    print("all:", *(f"{said:.3f} {so:.3f} ({n})," for said, so, n in bands))
    draw(bands, arguments.out)


def _bands(p: Floats, right: NDArray[np.bool_], weights: Floats) -> list[str]:
    return [f"{said:.3f} {so:.3f} ({n})," for said, so, n in reliability(p, right, weights)]


if __name__ == "__main__":
    main()
