"""How far apart a log ends when its stamps are moved by nothing that matters: by a unit in the last place, by a millisecond.

Every threshold of the odometry turns a change in the last place of a guess into another keyframe sooner or later;
stamps must not be where such a change comes from. What remains of a larger jitter is what the deskewing makes of it.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from curvescan import se2
from curvescan.engines import run_engine
from curvescan.odometry import Odometry
from curvescan.runs.document import ResultTable
from curvescan.scan import LaserScan
from curvescan.simulation import SENSORS, Simulation, simulate
from curvescan.types import Floats, Pose

JITTERS = (0.0, 1e-3)
"""Most that stamps are moved by, seconds: one unit in the last place, and what a common driver jitters by."""


def timed_log(seed: int = 0, n_scans: int = 300) -> Simulation:
    """Return a simulated drive whose sweeps take all the time between two scans, so that stamps count for deskewing."""
    sensor = SENSORS["spinning-360"]
    sweeping = replace(sensor, time_increment=sensor.period / sensor.n_beams)
    return simulate("office-floor", sensor=sweeping, n_scans=n_scans, seed=seed)


@dataclass(frozen=True, eq=False, kw_only=True)
class JitterSpread:
    """Ends of one log whose stamps were moved, beside the end with its own stamps."""

    log: str  # name of the log
    n_scans: int  # scans read
    jitter: float  # most that a stamp was moved by, seconds; 0 for one unit in the last place, up, down or not at all
    # (n_runs, 3): last pose of each run, seen from the last pose with the log's own stamps: metres, metres, radians
    ends: Pose
    # (n_runs,): share of the poses of each run that are not those with the log's own stamps to the bit
    moved_shares: Floats

    @property
    def spread_m(self) -> float:
        """Largest distance between an end and that with the log's own stamps, metres."""
        return float(np.hypot(self.ends[:, 0], self.ends[:, 1]).max())

    @property
    def spread_rad(self) -> float:
        """Largest difference of their headings, radians."""
        return float(np.abs(self.ends[:, 2]).max())


def measure_jitter(
    scans: Iterable[LaserScan],
    *,
    name: str,
    jitter: float = 0.0,
    n_runs: int = 10,
    seed: int = 0,
    new_odometry: Callable[[], Odometry] = Odometry,
    on_run: Callable[[], object] = lambda: None,
) -> JitterSpread:
    """Return how far apart a log ends over runs with jittered stamps."""
    held = list(scans)
    own = run_engine(held, new_odometry()).trajectory.poses
    ends, shares = np.zeros((n_runs, 3)), np.zeros(n_runs)
    for k in range(n_runs):
        rng = np.random.default_rng((seed, k))
        poses = run_engine(_jittered(held, jitter, rng), new_odometry()).trajectory.poses
        if (poses[-1] != own[-1]).any():  # else rounding would make a distance of it
            ends[k] = se2.between(own[-1], poses[-1])
        shares[k] = np.mean((poses != own).any(axis=1))
        on_run()
    return JitterSpread(log=name, n_scans=len(held), jitter=jitter, ends=ends, moved_shares=shares)


def _jittered(scans: Sequence[LaserScan], jitter: float, rng: np.random.Generator) -> list[LaserScan]:
    """Return the scans with their stamps moved."""
    stamps = np.array([scan.stamp for scan in scans])
    if jitter > 0.0:
        moved = stamps + rng.uniform(-jitter, jitter, len(stamps))
    else:
        towards = rng.choice((-np.inf, np.inf), len(stamps))
        moved = np.where(rng.random(len(stamps)) < 2 / 3, np.nextafter(stamps, towards), stamps)
    return [replace(scan, stamp=float(t)) for scan, t in zip(scans, moved, strict=True)]


def jitter_table(spreads: Sequence[JitterSpread]) -> ResultTable:
    """Return the table of what jittered stamps change, one row a log and jitter."""
    return ResultTable(
        title="Odometry with jittered stamps, beside that with the log's own",
        columns=("log", "scans", "stamps moved by", "runs", "ends apart, most", "poses that differ"),
        rows=[
            (
                one.log,
                f"{one.n_scans:,}",
                f"up to {1e3 * one.jitter:g} ms" if one.jitter else "one unit in the last place",
                f"{len(one.ends):,}",
                f"{1e3 * one.spread_m:.3g} mm, {np.degrees(one.spread_rad):.2g} deg",
                f"{100 * one.moved_shares.max():.1f} %",
            )
            for one in spreads
        ],
    )
