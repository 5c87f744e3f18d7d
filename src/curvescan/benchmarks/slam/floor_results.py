"""What SLAM made of a floor: the record of it, a file of many, and their summary in a row."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

import numpy as np


@dataclass(frozen=True, kw_only=True)
class FloorResult:
    """SLAM on one floor.

    Attributes
    ----------
    n_scans, n_keyframes : int
        Scans and keyframes.
    n_closures, n_neighbours : int
        Loop closures that the graph follows, and matches of neighbours.
    n_false : int
        Of both, those whose pose is false.
    n_revisits, n_missed : int
        Keyframes at places that were seen before, and those of them without a closure around.
    n_forced : int
        False matches that were forced on candidates.
    nees : float
        Normalised squared error of the last pose; 3 on average where the covariance is right.
    odometry, slam : (float, float)
        Mean and greatest error of the positions, metres, first poses laid over each other.
    is_deceived : bool
        Whether closures were withdrawn because they bent the odometry.
    """

    n_scans: int
    n_keyframes: int
    n_closures: int
    n_neighbours: int
    n_false: int
    n_revisits: int
    n_missed: int
    n_forced: int
    nees: float
    odometry: tuple[float, float]
    slam: tuple[float, float]
    is_deceived: bool

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
        f"mean error {np.mean([r.slam[0] for r in results]):.3f} m, odometry {np.mean([r.odometry[0] for r in results]):.3f} m | "
        f"worst {max(r.slam[1] for r in results):.2f} m, odometry {max(r.odometry[1] for r in results):.2f} m | "
        f"worse on {sum(r.is_worse for r in results)} | withdrawn on {sum(r.is_deceived for r in results)} | "
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
