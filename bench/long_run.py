"""A simulated day on one floor: keyframes, edges, memory, time a scan and error, by the hour.

Run as ``python bench/long_run.py [HOURS] [FIGURE]``. The day is accelerated: of each hour the robot drives a few laps
of a compact office floor, each a little beside the others and with noise of its own, and stands still for the rest.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from curvescan import se2
from curvescan.plots.colours import segment_colour
from curvescan.plots.map import drawing
from curvescan.scan import LaserScan
from curvescan.simulation.recording import simulate
from curvescan.slam import Slam
from curvescan.types import Floats, Pose

_N_LAPS = 2
"""Laps an hour."""

_BESIDE_M, _BESIDE_RAD = 0.08, 0.03
"""By how much a lap lies beside the route, standard deviations, metres and radians."""


@dataclass(frozen=True, kw_only=True)
class HourResult:
    """One hour."""

    # of the graph after it, and keyframes that went so far
    n_keyframes: int
    n_edges: int
    n_gone: int
    megabytes: float  # resident memory of the process after it; NaN where the system does not tell
    milliseconds: tuple[float, float, float]  # wall time a scan: median, 99th percentile, worst
    error: float  # mean error of the positions of this hour as they were reported, metres


def hours(n_hours: int, n_scans: int = 250, seed: int = 0) -> Iterator[HourResult]:
    """Yield what SLAM holds after each hour."""
    first = simulate("office", seed=seed, n_scans=n_scans, odometry_noise=None)
    lap = np.concatenate((first.truth.poses, first.truth.poses[::-1]))
    rng = np.random.default_rng([seed, 5])
    slam = Slam()
    began = 0.0
    for hour in range(n_hours):
        truth = np.concatenate([_beside(lap, rng) for _ in range(_N_LAPS)])
        if hour == 0:
            origin = truth[0].copy()
        made = simulate(first.world, seed=seed + hour + 1, poses=truth, odometry_noise=None)
        seconds, found = _drive(slam, list(made), began)
        began += 3600.0
        off = found - se2.between(origin, truth)
        yield HourResult(
            n_keyframes=len(slam.keyframes),
            n_edges=len(slam.graph.ends),
            n_gone=int(slam.keyframes.numbers[-1]) + 1 - len(slam.keyframes),
            megabytes=resident_megabytes(),
            milliseconds=_milliseconds(seconds),
            error=float(np.hypot(off[:, 0], off[:, 1]).mean()),
        )


def _drive(slam: Slam, scans: list[LaserScan], began: float) -> tuple[Floats, Pose]:
    """Return seconds and reported pose of each scan of an hour that began so many seconds after the first one."""
    seconds, found = np.empty(len(scans)), np.empty((len(scans), 3))
    for k, scan in enumerate(scans):
        scan = replace(scan, stamp=scan.stamp + began)
        started = time.perf_counter()
        found[k] = slam.add(scan).pose
        seconds[k] = time.perf_counter() - started
    return seconds, found


def _beside(lap: Pose, rng: np.random.Generator) -> Pose:
    """Return a lap a little beside another: it leaves the way slowly and comes back to it."""
    n = len(lap)
    waves = np.sin(np.linspace(0.0, 2.0 * np.pi * rng.integers(2, 6), n))
    off = waves[:, np.newaxis] * rng.normal(0.0, [_BESIDE_M, _BESIDE_M, _BESIDE_RAD])
    return se2.compose(lap, off)


def _milliseconds(seconds: Floats) -> tuple[float, float, float]:
    median, most, worst = np.percentile(1e3 * seconds, [50.0, 99.0, 100.0]).tolist()
    return median, most, worst


def resident_megabytes() -> float:
    """Return the resident memory of this process as Linux tells it; NaN elsewhere."""
    try:
        status = Path("/proc/self/status").read_text(encoding="ascii")
    except OSError:
        return float("nan")
    rows = [line.split() for line in status.splitlines() if line.startswith("VmRSS:")]
    return float(rows[0][1]) / 1024.0 if rows else float("nan")


def draw_day(path: Path, *, keyframes: Floats, megabytes: Floats, milliseconds: Floats) -> None:
    """Save a picture of a day by the hour.

    keyframes, megabytes (n,); milliseconds (n, 3).
    """
    hour = np.arange(1, len(keyframes) + 1)
    with drawing(path, 10.0, 3.4) as figure:
        graph, memory, times = figure.subplots(1, 3)
        graph.plot(hour, keyframes, ".-", color=segment_colour(0))
        graph.set(xlabel="hour", ylabel="keyframes", ylim=(0.0, None))
        memory.plot(hour, megabytes, ".-", color=segment_colour(1))
        memory.set(xlabel="hour", ylabel="resident memory [MB]", ylim=(0.0, None))
        for k, label in enumerate(("median", "99 %", "worst")):
            times.plot(hour, milliseconds[:, k], ".-", color=segment_colour(2 + k), label=label)
        times.set(xlabel="hour", ylabel="a scan [ms]", yscale="log")
        times.legend()


def main() -> None:
    """Print a line an hour, and draw them."""
    n_hours = int(sys.argv[1]) if len(sys.argv) > 1 else 24
    sys.stdout.write(
        "| hour | keyframes | edges | gone | memory, MB | ms a scan: median, 99 %, worst | mean error, mm |\n"
    )
    results = []
    for hour, r in enumerate(hours(n_hours), 1):
        results.append(r)
        median, most, worst = r.milliseconds
        sys.stdout.write(
            f"| {hour} | {r.n_keyframes} | {r.n_edges} | {r.n_gone} | {r.megabytes:.0f} | "
            f"{median:.2f}, {most:.1f}, {worst:.0f} | {1e3 * r.error:.1f} |\n"
        )
        sys.stdout.flush()
    if len(sys.argv) > 2:
        draw_day(
            Path(sys.argv[2]),
            keyframes=np.array([r.n_keyframes for r in results], dtype=np.float64),
            megabytes=np.array([r.megabytes for r in results]),
            milliseconds=np.array([r.milliseconds for r in results]),
        )


if __name__ == "__main__":
    main()
