"""Count wrong verdicts: `python bench/verdicts.py [--drives 60] [--first 0] [--data DIR] [--seen FILE] [--out DIR]`.

Simulated drives have a truth: a third of them is spoilt (carried away unseen, blind on the move, frozen scans, a sensor
turned on its mount, half of another building). A map is right where no position is farther from the truth than a
standard deviation that is trusted, the paths laid over each other, and wrong beyond three of them; what lies between is
not counted. A false alarm is a right map that is not trusted, false trust a wrong one that is. Of real logs the error
over checked relations is printed where there are some; else a person says in FILE, lines of NAME,good or NAME,bad, what
the pictures in DIR show.
"""

from __future__ import annotations

import argparse
import tempfile
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import curvescan as cs
from curvescan import se2
from curvescan.diagnostics.verdict import MAX_SIGMA, MAX_SIGMA_SHARE
from curvescan.io.arrays.memory import MemoryLog
from curvescan.io.log import Log
from curvescan.io.trajectories.trajectory import Trajectory
from curvescan.types import Floats, Pose

WORLDS = ("office", "building", "office-floor", "l-hall", "t-hall", "clutter", "curved-hall", "room")
SENSORS = ("sick-lms200", "spinning-360", "hokuyo-270", "urg-04lx")
N_SCANS = 300
SIGMAS = 3.0
"""A pose is wrong beyond so many of the standard deviations that a trusted one may have."""

_WORDS = {True: "wrong", False: "right", None: "unclear"}

RELATIONS = {
    "intel-lab/intel.clf.gz": "intel-lab/intel.relations",
    "aces/aces.clf.gz": "aces/aces.relations",
    "mit-killian/mit-killian.clf.gz": "mit-killian/mit-killian.relations",
}
LOGS = (
    *RELATIONS,
    "malaga-sena-loop/malaga-sena-loop.clf.gz",
    "ual-campus-sick/ual-campus.clf.gz",
    "leg-tracker-people/general_tracking_moving_1.bag.gz",
    "leg-tracker-people/demo_stationary_simple_environment.bag.gz",
    "leg-tracker-people/positive_1.bag.gz",
    "ccny-handheld-hokuyo/demo.bag",
    "mumble-rplidar-a1/kitchen_1",
    "mumble-rplidar-a1/slow_half_hallway",
    "turtlebot4-rplidar/macfirst_floor_take_2",
    "mines-urg04/exp1.dat.gz",
    "rplidar-slambot/data_6AUG14_16m.clf.gz",
    "intel-lab/intel-corrected.log.gz",
    "aces/aces-corrected.log.gz",
    "mit-killian/infinite-corridor-corrected.log.gz",
    "keyframed-corrected/belgioioso-corrected.log.gz",
    "keyframed-corrected/seattle-corrected.log.gz",
    "keyframed-corrected/acapulco-corrected.log.gz",
    "keyframed-corrected/orebro-corrected.log.gz",
)


@dataclass(frozen=True, kw_only=True)
class Drive:
    """A simulated log, and where the sensor was at each scan, NaN where nothing says so."""

    name: str
    log: Log
    truth: Pose


def carried_away(log: Log, truth: Pose, rng: np.random.Generator) -> tuple[list[int], Pose, Callable[..., Floats]]:
    """Leave out a third of the drive: the robot goes on elsewhere, and its wheels say nothing of it."""
    k = int(rng.integers(len(truth) // 4, len(truth) // 2))
    kept = [*range(k), *range(k + len(truth) // 3, len(truth))]
    return kept, truth, _as_seen


def blind(log: Log, truth: Pose, rng: np.random.Generator) -> tuple[list[int], Pose, Callable[..., Floats]]:
    """Give no reading over a fifth of the drive."""
    k = int(rng.integers(len(truth) // 4, len(truth) // 2))
    hidden = range(k, k + len(truth) // 5)
    return list(range(len(truth))), truth, lambda i, scan: np.full(len(scan), np.nan) if i in hidden else scan.ranges


def frozen(log: Log, truth: Pose, rng: np.random.Generator) -> tuple[list[int], Pose, Callable[..., Floats]]:
    """Repeat one scan, with noise, over a fifth of the drive."""
    k = int(rng.integers(len(truth) // 4, len(truth) // 2))
    stuck = range(k, k + len(truth) // 5)
    still = log[k].ranges

    def seen(i: int, scan: cs.LaserScan) -> Floats:
        return still + 0.005 * rng.standard_normal(len(still)) if i in stuck else scan.ranges

    return list(range(len(truth))), truth, seen


def turned(log: Log, truth: Pose, rng: np.random.Generator) -> tuple[list[int], Pose, Callable[..., Floats]]:
    """Turn the sensor on its mount by 90 degrees at a third of the drive and back at two thirds: poses are the robot's."""
    n, n_beams = len(truth), len(log[0])
    shift = round(0.5 * np.pi / log[0].angle_increment)

    def seen(i: int, scan: cs.LaserScan) -> Floats:
        rolled = np.roll(scan.ranges, shift)
        if shift < n_beams < round(2.0 * np.pi / scan.angle_increment) - 1:
            rolled[:shift] = np.nan  # not a full circle: nothing comes from behind
        return rolled if n // 3 <= i < 2 * n // 3 else scan.ranges

    return list(range(n)), truth, seen


def another_building(log: Log, truth: Pose, rng: np.random.Generator) -> tuple[list[int], Pose, Callable[..., Floats]]:
    """Go on in another building after half of the drive: how the two lie to each other nothing can say."""
    other = cs.simulate("clutter", n_scans=len(truth) // 2, seed=int(rng.integers(1000, 2000)), sensor=_sensor_of(log))
    half = len(truth) - len(other)
    poses = truth.copy()
    poses[half:] = np.nan
    return list(range(len(truth))), poses, lambda i, scan: other[i - half].ranges if i >= half else scan.ranges


SPOILERS = (carried_away, blind, frozen, turned, another_building)


def _as_seen(_: int, scan: cs.LaserScan) -> Floats:
    return scan.ranges


def _sensor_of(log: Log) -> str:
    return next(name for name in SENSORS if len(cs.simulate("room", n_scans=1, sensor=name)[0]) == len(log[0]))


def drives(n: int, n_scans: int = N_SCANS, first: int = 0) -> Iterator[Drive]:
    """Yield n drives from seed `first` on; every third is spoilt, every second has wheels."""
    for k in range(first, first + n):
        world, sensor = WORLDS[k % len(WORLDS)], SENSORS[k // 2 % len(SENSORS)]
        log = cs.simulate(world, sensor=sensor, n_scans=n_scans, seed=k, n_people=k % 4)
        truth, name = log.truth.poses, f"{k} {world} {sensor}"
        kept, seen, rng = list(range(len(log))), _as_seen, np.random.default_rng(k)
        if k % 3 == 2:
            spoil = SPOILERS[k // 3 % len(SPOILERS)]
            kept, truth, seen = spoil(log, truth, rng)
            name += f" {spoil.__name__}"
        scans = tuple(replace(log[i], ranges=seen(i, log[i])) for i in kept)
        odometry = None
        if k % 2 and "carried_away" not in name and log.odometry is not None:
            name += " wheels"
            odometry = Trajectory(stamps=log.odometry.stamps[kept], poses=log.odometry.poses[kept])
        yield Drive(name=name, log=MemoryLog(scans=scans, odometry=odometry, name=name), truth=truth[kept])


def worst_error(poses: Pose, truth: Pose) -> tuple[float, float]:
    """Return the largest error of a position, the paths laid over each other, and the size of the place, metres."""
    known = np.isfinite(truth).all(axis=1) & np.isfinite(poses).all(axis=1)
    if not np.isfinite(truth).all() or not known.any():
        return np.inf, 0.0  # two places that nothing joins cannot be one map
    a, b = poses[known, :2], truth[known, :2]
    centred = a - a.mean(axis=0), b - b.mean(axis=0)
    h = centred[0].T @ centred[1]
    turn = np.arctan2(h[0, 1] - h[1, 0], h[0, 0] + h[1, 1])
    moved = se2.transform(np.array([0.0, 0.0, turn]), centred[0])
    return float(np.hypot(*(moved - centred[1]).T).max()), float(np.hypot(*np.ptp(b, axis=0)))


def is_wrong(error: float, extent: float) -> bool:
    """Return whether a trajectory is farther from the truth than a trusted one may be."""
    return error > SIGMAS * max(MAX_SIGMA, MAX_SIGMA_SHARE * extent)


def judged(n: int, n_scans: int = N_SCANS, first: int = 0) -> Iterator[tuple[str, float, bool | None, bool, str]]:
    """Yield name, worst error, whether it is wrong (None: unclear), whether it is trusted, and why not, of each drive."""
    for drive in drives(n, n_scans, first):
        run = cs.run(drive.log, "slam", keeps_steps=False)
        error, extent = worst_error(run.trajectory.poses, drive.truth)
        wrong = None if is_unclear(error, extent) else is_wrong(error, extent)
        yield drive.name, error, wrong, run.verdict.is_trusted, "; ".join(run.verdict.reasons)


def is_unclear(error: float, extent: float) -> bool:
    """Return whether a trajectory is neither right nor wrong: an alarm is none that cries wolf, and trust does no harm."""
    return not is_wrong(error, extent) and is_wrong(SIGMAS * error, extent)


def count(rows: list[tuple[bool, bool]]) -> str:
    """Return the false alarms and the false trust among pairs of is wrong, is trusted."""
    alarms, trust = sum(not w and not t for w, t in rows), sum(w and t for w, t in rows)
    n_wrong = sum(w for w, _ in rows)
    return f"false alarms: {alarms} of {len(rows) - n_wrong}; false trust: {trust} of {n_wrong}"


def _real(folder: Path, out: Path, seen: dict[str, bool]) -> list[tuple[bool, bool]]:
    rows = []
    print("\n| log | error over relations | by eye | verdict |\n| --- | ---: | --- | --- |")
    for name in LOGS:
        if not (folder / name).exists():
            continue
        label = name.split("/")[-1]
        run = cs.run(folder / name, "slam", out=out / label, keeps_steps=False)
        error = ""
        if name in RELATIONS:
            measured = cs.evaluate(out / label / "trajectory.tum", relations=folder / RELATIONS[name])
            error = repr(measured)
        good = seen.get(label)
        print(
            f"| {label} | {error} | {({True: 'good', False: 'bad'}).get(good, '')} | {run.verdict.sentence} |",
            flush=True,
        )
        if good is not None:
            rows.append((not good, run.verdict.is_trusted))
    return rows


def main() -> None:
    """Print the table of simulated drives, and that of real logs."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--data", type=Path)
    parser.add_argument("--drives", type=int, default=60)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--seen", type=Path)
    parser.add_argument("--out", type=Path)
    flags = parser.parse_args()
    print("| drive | worst error, m | map | trusted | why not |\n| --- | ---: | --- | --- | --- |")
    rows = []
    for name, error, wrong, trusted, why in judged(flags.drives, first=flags.first):
        if wrong is not None:
            rows.append((wrong, trusted))
        flag = " **false alarm**" if wrong is False and not trusted else " **false trust**" if wrong and trusted else ""
        print(f"| {name}{flag} | {error:.2f} | {_WORDS[wrong]} | {trusted} | {why} |", flush=True)
    print(f"\nsimulated drives: {count(rows)}")
    if flags.data:
        lines = flags.seen.read_text("utf-8").splitlines() if flags.seen else []
        seen = {line.split(",")[0]: line.split(",")[1].strip() == "good" for line in lines if "," in line}
        real = _real(flags.data, flags.out or Path(tempfile.mkdtemp(prefix="verdicts-")), seen)
        print(f"\nreal logs that a person looked at: {count(real)}")


if __name__ == "__main__":
    main()
