"""A long run on one floor: keyframes, edges, memory and time a scan, by the lap.

Run as ``python -m curvescan.benchmarks.slam.long_run [n_laps]``: laps of one office floor, seen each time with noise of its own.
"""

from __future__ import annotations

import sys
import time
import tracemalloc
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from curvescan import se2
from curvescan.scan import LaserScan
from curvescan.simulation.recording import simulate
from curvescan.slam import Slam


@dataclass(frozen=True, kw_only=True)
class LapResult:
    """One lap.

    Attributes
    ----------
    n_keyframes, n_edges, n_gone : int
        Of the graph after it, and keyframes that went so far.
    megabytes : float
        What the lap added to the memory of Python's objects and arrays, features kept for matching included.
    milliseconds : float
        Processor time a scan.
    error : float
        Mean error of the positions of this lap as they were reported, metres.
    """

    n_keyframes: int
    n_edges: int
    n_gone: int
    megabytes: float
    milliseconds: float
    error: float


def laps(n_laps: int, n_scans: int = 500, seed: int = 0) -> Iterator[LapResult]:
    """Yield what SLAM holds after each lap, there and back again.

    Parameters
    ----------
    n_laps : int
        Laps.
    n_scans : int
        Scans of half a lap.
    seed : int
        Of the floor and the way.
    """
    first = simulate("office", seed=seed, n_scans=n_scans, odometry_noise=None)
    truth = np.concatenate((first.truth.poses, first.truth.poses[::-1]))
    slam = Slam()
    tracemalloc.start()
    for lap in range(n_laps):
        made = simulate(first.world, seed=seed + 1000 * (lap + 1), poses=truth, odometry_noise=None)
        scans: list[LaserScan] = list(made)
        period = made.sensor.period
        held = tracemalloc.get_traced_memory()[0]
        started = time.process_time()
        found = np.array(
            [
                slam.add(replace(scan, stamp=scan.stamp + lap * len(scans) * period)).pose
                for scan in scans
            ]
        )
        seconds = time.process_time() - started
        grown = tracemalloc.get_traced_memory()[0] - held
        off = found - se2.between(truth[0], truth)
        yield LapResult(
            n_keyframes=len(slam.backend.keyframes),
            n_edges=slam.backend.graph.n_edges,
            n_gone=len(slam.backend.heirs),
            megabytes=grown / 1e6,
            milliseconds=1e3 * seconds / len(scans),
            error=float(np.hypot(off[:, 0], off[:, 1]).mean()),
        )


def main() -> None:
    """Print a line a lap."""
    n_laps = int(sys.argv[1]) if len(sys.argv) > 1 else 20
    sys.stdout.write("lap | keyframes | edges | gone | MB more | ms a scan | mean error, m\n")
    for lap, r in enumerate(laps(n_laps), 1):
        sys.stdout.write(
            f"{lap} | {r.n_keyframes} | {r.n_edges} | {r.n_gone} | {r.megabytes:.2f} | "
            f"{r.milliseconds:.2f} | {r.error:.3f}\n"
        )
        sys.stdout.flush()


if __name__ == "__main__":
    main()
