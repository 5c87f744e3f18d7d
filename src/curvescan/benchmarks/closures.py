"""False loop closures: SLAM on floors made to deceive, counted against the truth.

Run as ``python -m curvescan.benchmarks.closures [n_floors]``.
"""

from __future__ import annotations

import sys
from dataclasses import dataclass
from typing import get_args

import numpy as np

from curvescan import se2
from curvescan.simulation.lookalikes import Deceit, deceive
from curvescan.slam import Slam
from curvescan.slam.pose_graph.graph import EdgeKind

FALSE_M, FALSE_RAD = 0.3, 0.15
"""A closure is false when its pose is off by more than this, metres and radians: along a corridor only what it measures counts."""


@dataclass(frozen=True, kw_only=True)
class DeceptionResult:
    """SLAM on one floor.

    Attributes
    ----------
    n_scans, n_closures : int
        Scans, and closures between keyframes that do not follow each other.
    n_false : int
        Closures with a weight whose pose is false.
    nees : float
        Normalised squared error of the last pose; 3 on average where the covariance is right.
    odometry, slam : (float, float)
        Mean and greatest error of the positions, metres, first poses laid over each other.
    """

    n_scans: int
    n_closures: int
    n_false: int
    nees: float
    odometry: tuple[float, float]
    slam: tuple[float, float]


def judge_floor(seed: int, deceit: Deceit) -> DeceptionResult:
    """Return how SLAM fares on one floor."""
    scans, truth = deceive(seed, deceit=deceit)
    slam = Slam()
    odom = np.array([slam.add(scan).pose_odom for scan in scans])
    trajectory = slam.finish()
    true = se2.between(truth[0], truth)
    found = slam.map
    is_closure = (found.kinds == EdgeKind.CLOSURE) & (found.weights > 0.5)
    ends = found.indices[found.ends[is_closure]]
    off = se2.between(se2.between(true[ends[:, 0]], true[ends[:, 1]]), found.measured[is_closure])
    # what a match leaves open along a corridor it does not claim
    claimed = found.edge_covariances[is_closure][:, :2, :2].max(axis=(1, 2)) < FALSE_M**2
    is_false = (np.hypot(off[:, 0], off[:, 1]) > FALSE_M) & claimed
    is_false |= np.abs(off[:, 2]) > FALSE_RAD
    last = trajectory.poses[-1] - true[-1]
    last[2] = se2.wrap(last[2])
    assert trajectory.covariances is not None
    return DeceptionResult(
        n_scans=len(scans),
        n_closures=int(np.count_nonzero(is_closure)),
        n_false=int(np.count_nonzero(is_false)),
        nees=float(last @ np.linalg.solve(trajectory.covariances[-1], last)),
        odometry=_errors(odom, true),
        slam=_errors(trajectory.poses, true),
    )


def _errors(poses: np.ndarray, true: np.ndarray) -> tuple[float, float]:
    errors = np.hypot(*(poses[:, :2] - true[:, :2]).T)
    return float(errors.mean()), float(errors.max())


def main() -> None:
    """Print a line a floor and a summary a kind."""
    n_floors = int(sys.argv[1]) if len(sys.argv) > 1 else 10
    for deceit in get_args(Deceit):
        results = []
        for seed in range(n_floors):
            result = judge_floor(seed, deceit)
            results.append(result)
            sys.stdout.write(f"{deceit} {seed}: {result}\n")
            sys.stdout.flush()
        worse = sum(r.slam[0] > 1.1 * r.odometry[0] + 0.01 for r in results)
        sys.stdout.write(
            f"{deceit}: {len(results)} floors, {sum(r.n_closures for r in results):,} closures, "
            f"{sum(r.n_false for r in results)} false on {sum(r.n_false > 0 for r in results)} floors; mean error "
            f"{np.mean([r.slam[0] for r in results]):.3f} m (odometry {np.mean([r.odometry[0] for r in results]):.3f} m), "
            f"worst {max(r.slam[1] for r in results):.3f} m; worse than the odometry on {worse}; "
            f"mean NEES {np.mean([r.nees for r in results]):.2f}, median {np.median([r.nees for r in results]):.2f}\n"
        )


if __name__ == "__main__":
    main()
