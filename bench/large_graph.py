"""Time and memory to optimize a large pose graph: a square spiral of laps with closures to the lap before.

Run as ``python bench/large_graph.py [n_poses]``.
"""

from __future__ import annotations

import resource
import sys
import time

import numpy as np

from curvescan import se2
from curvescan.slam.pose_graph.optimization import Edges, optimize
from curvescan.types import Pose

_N_LAP, _STEP, _EVERY = 1000, 0.5, 5
_SIGMAS = np.array([0.02, 0.02, 0.01])
_CLOSURES_A_POSE = 3
"""Of each fifth pose: 160,000 edges for 100,000 poses, as in the issue's figures."""


def large_graph(n_poses: int, seed: int = 0) -> tuple[Pose, Edges]:
    """Return (n, 3) true poses of laps round a circle that drifts, and noisy edges: the chain, and closures to earlier laps."""
    angle = 2.0 * np.pi * np.arange(n_poses) / _N_LAP
    radius = _STEP * _N_LAP / (2.0 * np.pi) + np.arange(n_poses) * (_STEP / _N_LAP)
    truth = np.column_stack((radius * np.cos(angle), radius * np.sin(angle), se2.wrap(angle + 0.5 * np.pi)))
    k = np.arange(n_poses)
    chain = np.column_stack((k[:-1], k[1:]))
    late = k[_N_LAP + 1 :: _EVERY]
    closures = [np.column_stack((late - _N_LAP + d, late)) for d in range(-1, _CLOSURES_A_POSE - 1)]
    ends = np.concatenate((chain, *closures)).astype(np.int64)
    rng = np.random.default_rng(seed)
    measured = se2.between(truth[ends[:, 0]], truth[ends[:, 1]])
    measured = measured + _SIGMAS * rng.standard_normal(measured.shape)
    return truth, Edges.of(ends, measured, np.tile(np.diag(_SIGMAS**2), (len(ends), 1, 1)))


def main() -> None:
    """Print seconds of processor and megabytes."""
    n_poses = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000
    truth, edges = large_graph(n_poses)
    anchors, weights = np.array([0]), np.ones(len(edges.ends))
    small_truth, small = large_graph(2 * _N_LAP)
    optimize(small_truth, small, np.ones(len(small.ends)), anchors, max_iterations=1)  # compiles
    started = time.process_time()
    start = truth + 0.05 * np.random.default_rng(1).standard_normal(truth.shape)
    found = optimize(start, edges, weights, anchors)
    seconds = time.process_time() - started
    off = np.hypot(*(found - truth)[:, :2].T)
    memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3
    sys.stdout.write(
        f"{n_poses:,} poses, {len(edges.ends):,} edges: {seconds:.1f} s of processor; error {off.mean():.3f} m on the mean; "
        f"process {memory:.0f} MB\n"
    )


if __name__ == "__main__":
    main()
