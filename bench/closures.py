"""Loop closures on simulated floors, counted against the truth: false ones, loops missed, errors, NEES of the final poses.

Run as ``python bench/closures.py --kinds offices,people --floors 10 --forced 0.2``. Kinds are those of
`lookalikes.py`, made to deceive, and of :data:`ORDINARY`.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass, replace
from itertools import islice
from pathlib import Path
from typing import get_args

import numpy as np

from curvescan import se2
from curvescan.matchers import MatchResult, PreparedScan
from curvescan.plots.colours import segment_colour
from curvescan.plots.map import drawing
from curvescan.scan import LaserScan
from curvescan.se2.uncertain import UncertainPose
from curvescan.simulation.recording import simulate
from curvescan.simulation.sensing.sensors import SENSORS, Sensor
from curvescan.slam import Slam
from curvescan.slam.loop_search import N_LINKED
from curvescan.slam.pose_graph.graph import EdgeKind
from curvescan.types import Bools, Floats, Pose
from lookalikes import Deceit, deceive

FALSE_M, FALSE_RAD = 0.3, 0.15
"""A closure is false when its pose is off by more than this, metres and radians: along a corridor only what it measures
counts."""

_NEAR_M, _NEAR_RAD, _APART = 1.0, 0.6, 20
"""A keyframe revisits a place when one this many keyframes before lies within this of it."""

_WITHIN = 5
"""A loop is missed where none of the keyframes this near before and after a revisit has a closure with an earlier
lap."""

_STOREY_M = 500.0
"""Farther away than this is another storey, metres."""

_NOISY = replace(SENSORS["sick-lms200"], name="noisy", n_beams=181, angle_increment=np.pi / 180.0, sigma_range=0.03)

ORDINARY: Mapping[str, Sensor] = {"ordinary": SENSORS["sick-lms200"], "noisy": _NOISY}
"""Office floors of a seed each, and their sensor: 361 beams of 10 mm noise, 181 beams of 30 mm."""


_DOF = 3
_LONGEST = 16.0  # of the axis: chi-square of 3 degrees of freedom, 99.9 %
_NOISE = {"ordinary": "361 beams, 10 mm noise", "noisy": "181 beams, 30 mm noise"}


class _Liar:
    """Matches keyframes, and for a share of those that do not follow each other answers another pair's pose, sure of it."""

    def __init__(self, slam: Slam, share: float, seed: int) -> None:
        self._keyframes, self._honest = slam.keyframes, slam.keyframes.match
        self._share, self._rng = share, np.random.default_rng([seed, 77])
        self._seen: list[MatchResult] = []
        self.n_forced = 0

    def __call__(self, i: int, current: PreparedScan, prior: UncertainPose | None) -> MatchResult:
        result = self._honest(i, current, prior)
        if any(one.scan.ranges is current.scan.ranges for one in islice(self._keyframes, i, i + N_LINKED + 1)):
            return result
        is_lie = self._rng.random() < self._share and len(self._seen) > 0
        lie = self._seen[int(self._rng.integers(len(self._seen)))] if is_lie else None
        if result.ok:
            self._seen.append(result)
        if lie is None:
            return result
        self.n_forced += 1
        return lie


@dataclass(frozen=True, kw_only=True)
class FloorResult:
    """SLAM on one floor."""

    # scans and keyframes
    n_scans: int
    n_keyframes: int
    # loop closures that the graph follows, and matches of neighbours
    n_closures: int
    n_neighbours: int
    n_false: int  # of both, those whose pose is false
    # keyframes at places that were seen before, and those of them without a closure around
    n_revisits: int
    n_missed: int
    n_forced: int  # false matches that were forced on candidates
    nees: float  # normalised squared error of the last pose; 3 on average where the covariance is right
    # mean and greatest error of the positions, metres, first poses laid over each other
    odometry: tuple[float, float]
    slam: tuple[float, float]

    @property
    def is_worse(self) -> bool:
        """Whether the odometry alone is better, by more than a tenth and a centimetre."""
        return self.slam[0] > 1.1 * self.odometry[0] + 0.01


def summary(results: list[FloorResult]) -> str:
    """Return a row of a table: floors, closures, false ones, revisits missed, mean errors, worst, floors worse than odometry, NEES."""
    nees = np.array([r.nees for r in results])
    n_false = sum(r.n_false for r in results)
    return (
        f"{len(results)} floors | {sum(r.n_closures for r in results):,} closures | {n_false} false on "
        f"{sum(r.n_false > 0 for r in results)} floors ({sum(r.n_forced for r in results):,} forced in) | "
        f"{sum(r.n_missed for r in results):,} of {sum(r.n_revisits for r in results):,} revisits missed | "
        f"mean error {np.mean([r.slam[0] for r in results]):.3f} m, odometry "
        f"{np.mean([r.odometry[0] for r in results]):.3f} m | "
        f"worst {max(r.slam[1] for r in results):.2f} m, odometry {max(r.odometry[1] for r in results):.2f} m | "
        f"worse on {sum(r.is_worse for r in results)} | "
        f"NEES mean {nees.mean():.2f}, median {np.median(nees):.2f}, {np.mean(nees < 7.815):.0%} below 7.8"
    )


def stored_results(file: Path | None) -> dict[tuple[str, int, float], FloorResult]:
    """Return the floors that a file of results holds."""
    if file is None or not file.exists():
        return {}
    known = {}
    for line in file.read_text(encoding="utf-8").splitlines():
        row = json.loads(line)
        key = row.pop("kind"), row.pop("seed"), row.pop("forced")
        known[key] = FloorResult(**{**row, "odometry": tuple(row["odometry"]), "slam": tuple(row["slam"])})
    return known


def judge_floor(kind: str, seed: int, forced: float = 0.0) -> FloorResult:
    """Return how SLAM fares on one floor."""
    scans, truth = floor_of(kind, seed)
    slam = Slam()
    liar = _Liar(slam, forced, seed)
    if forced > 0.0:
        slam.keyframes.match = liar  # type: ignore[method-assign]
    odom = np.array([slam.add(scan).pose_odom for scan in scans])
    trajectory = slam.finish()
    true = se2.between(truth[0], truth)
    found = slam.map
    n_closures, n_neighbours = slam.count_matches()
    is_closure = (found.kinds == EdgeKind.CLOSURE) & (found.weights > 0.5)
    ends = found.ends[is_closure]
    scans_of = found.indices[ends]
    actual = se2.between(true[scans_of[:, 0]], true[scans_of[:, 1]])
    off = se2.between(actual, found.measured[is_closure])
    # what a match leaves open along a corridor it does not claim
    claimed = found.edge_covariances[is_closure][:, :2, :2].max(axis=(1, 2)) < FALSE_M**2
    is_false = (np.hypot(off[:, 0], off[:, 1]) > FALSE_M) & claimed
    is_false |= np.abs(off[:, 2]) > FALSE_RAD
    is_revisit = _revisits(true[found.indices])
    here = np.hypot(true[:, 0], true[:, 1]) < _STOREY_M  # how two storeys lie to each other nobody can know
    last = trajectory.poses[here][-1] - true[here][-1]
    last[2] = se2.wrap(last[2])
    assert trajectory.covariances is not None
    return FloorResult(
        n_scans=len(scans),
        n_keyframes=len(found),
        n_closures=n_closures,
        n_neighbours=n_neighbours,
        n_false=int(np.count_nonzero(is_false)),
        n_revisits=int(np.count_nonzero(is_revisit)),
        n_missed=int(np.count_nonzero(is_revisit & ~_closed(ends[~is_false], len(found)))),
        n_forced=liar.n_forced,
        nees=float(last @ np.linalg.solve(trajectory.covariances[here][-1], last)),
        odometry=_errors(odom[here], true[here]),
        slam=_errors(trajectory.poses[here], true[here]),
    )


def floor_of(kind: str, seed: int) -> tuple[list[LaserScan], Pose]:
    """Return the scans of a floor and (n, 3) their true poses."""
    if kind in get_args(Deceit):
        return deceive(seed, deceit=kind)  # type: ignore[arg-type]
    made = simulate("office", sensor=ORDINARY[kind], seed=seed, n_scans=700, odometry_noise=None)
    return list(made), made.truth.poses


def _revisits(true: Pose) -> Bools:
    """Return (n,) whether each keyframe is where one was long before."""
    found = np.zeros(len(true), dtype=np.bool_)
    for k in range(_APART + 1, len(true)):
        off = true[: k - _APART] - true[k]
        near = np.hypot(off[:, 0], off[:, 1]) < _NEAR_M
        found[k] = bool((near & (np.abs(se2.wrap(off[:, 2])) < _NEAR_RAD)).any())
    return found


def _closed(ends: np.ndarray, n: int) -> Bools:
    """Return (n,) whether each keyframe or one around it has a closure with one long before."""
    found = np.zeros(n, dtype=np.bool_)
    for k in ends[ends[:, 1] - ends[:, 0] > _APART, 1].tolist():
        found[max(k - _WITHIN, 0) : k + _WITHIN + 1] = True
    return found


def _errors(poses: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    errors = np.hypot(*(poses[:, :2] - true[:, :2]).T)
    return float(errors.mean()), float(errors.max())


def run(kinds: list[str], seeds: Iterable[int], forced: float, file: Path | None = None) -> Iterator[str]:
    """Yield a line a floor, and one a kind."""
    known = stored_results(file)
    for kind in kinds:
        results = []
        for seed in seeds:
            result = known.get((kind, seed, forced))
            if result is None:
                result = judge_floor(kind, seed, forced)
                if file is not None:
                    row = {"kind": kind, "seed": seed, "forced": forced} | asdict(result)
                    with file.open("a", encoding="utf-8") as out:
                        out.write(json.dumps(row) + "\n")
            results.append(result)
            yield f"{kind} {seed} forced {forced}: {result}"
        yield f"SUMMARY {kind} forced {forced}: {summary(results)}"


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
    """Print a line a floor and a summary a kind."""
    import argparse

    parser = argparse.ArgumentParser(description=__doc__)
    every = (*get_args(Deceit), *ORDINARY)
    parser.add_argument("--kinds", default=",".join(every))
    parser.add_argument("--floors", type=int, default=10)
    parser.add_argument("--first", type=int, default=0, help="first seed")
    parser.add_argument("--forced", type=float, default=0.0)
    parser.add_argument("--append", type=Path, default=None, help="file of results, JSON lines")
    parser.add_argument(
        "--nees", type=Path, default=None, help="PNG to draw: the NEES of the ordinary floors in that file"
    )
    given = parser.parse_args()
    seeds = range(given.first, given.first + given.floors)
    for line in run(given.kinds.split(","), seeds, given.forced, given.append):
        sys.stdout.write(line + "\n")
        sys.stdout.flush()
    if given.nees is not None:
        rows = stored_results(given.append)
        found = {
            words: np.array([r.nees for (named, _, forced), r in rows.items() if named == kind and forced == 0.0])
            for kind, words in _NOISE.items()
        }
        draw_nees(given.nees, {words: values for words, values in found.items() if len(values)})


if __name__ == "__main__":
    main()
