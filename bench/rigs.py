"""Several lasers on one robot: mounts found beside the true ones, odometry of two lasers beside one, one that fails.

``python bench/rigs.py --rigs 50`` simulates robots with two lasers at random corners, half of the rigs with fields of
view that overlap and half without, each on a floor of its own. A mount is also given 5 cm and 2 deg off, and rightly:
the share of each that is told as wrong is printed.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator, Sequence

import numpy as np

import curvescan as cs
from curvescan import se2
from curvescan.evaluation.mounts import MountCheck, find_mounts
from curvescan.simulation import SENSORS
from curvescan.types import Floats, Pose

WRONG_M, WRONG_RAD = 0.05, np.radians(2.0)
"""A mount that is wrong is off by so much, metres and radians."""


def rig_of(rng: np.random.Generator, *, overlaps: bool) -> dict[str, Pose]:
    """Return two mounts at opposite corners of a robot, the lasers turned outwards."""
    x, y = rng.uniform(0.2, 0.6), rng.uniform(0.15, 0.4)
    # 270 degrees at corners overlap; 180 degrees ahead and behind do not
    yaw = (np.arctan2(y, x), np.arctan2(-y, -x)) if overlaps else (0.0, np.pi)
    off = rng.normal(0.0, np.radians(3.0), 2)
    return {"front": np.array([x, y, yaw[0] + off[0]]), "rear": np.array([-x, -y, se2.wrap(yaw[1] + off[1])])}


def recorded(seed: int, mounts: dict[str, Pose], sensor: str, n_scans: int) -> tuple[Pose, dict[str, cs.Log]]:
    """Return true poses of the base, and the log of each laser."""
    drive = cs.simulate("office", n_scans=n_scans, seed=seed, sensor=sensor)
    logs = {
        name: cs.simulate(
            drive.world,
            poses=se2.compose(drive.truth.poses, mount),
            seed=1000 * seed + k,
            sensor=sensor,
            odometry_noise=None,
        )
        for k, (name, mount) in enumerate(mounts.items())
    }
    return drive.truth.poses, logs


def last_error(steps: Sequence[cs.Step], truth: Pose, mount: Pose) -> float:
    """Return how far the last pose of a laser, or of the base, is off, metres."""
    seen = se2.compose(truth, mount)
    x, y, _ = se2.between(se2.between(seen[0], seen[-1]), steps[-1].pose)
    return float(np.hypot(x, y))


def odometries(truth: Pose, mounts: dict[str, Pose], logs: dict[str, cs.Log]) -> Iterator[tuple[float, float, float]]:
    """Yield error, share of scans matched, and ms a scan: two lasers, the front one alone, two with one that fails."""
    half = len(truth) // 2
    front = {"front": mounts["front"]}
    failing = {"front": logs["front"], "rear": logs["rear"][:half]}
    zero = np.zeros(3)
    for rig, given in ((mounts, logs), (front, {"front": logs["front"]}), (mounts, failing)):
        started = time.process_time()
        steps = list(cs.Rig(rig).track(given, cs.Odometry()))
        seconds = time.process_time() - started
        matched = np.mean([step.is_matched for step in steps[1:]])
        yield last_error(steps, truth, zero), float(matched), 1e3 * seconds / len(steps)


def told(found: cs.UncertainPose, given: Pose) -> bool:
    """Return whether a given mount is told as wrong."""
    return MountCheck(topic="rear", base="front", found=found, given=given).is_wrong


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(prog="python bench/rigs.py")
    parser.add_argument("--rigs", type=int, default=50)
    parser.add_argument("--seconds", type=float, default=20.0, help="of each drive")
    parser.add_argument("--first", type=int, default=100)
    given = parser.parse_args(arguments)
    errors, nees, wrong, right, tracks, lost = [], [], [], [], [], []
    for k in range(given.rigs):
        seed = given.first + k
        rng = np.random.default_rng([seed, 25])
        overlaps = k % 2 == 0
        mounts = rig_of(rng, overlaps=overlaps)
        sensor = "hokuyo-270" if overlaps else "sick-lms200"
        n_scans = round(given.seconds / SENSORS[sensor].period)
        truth, logs = recorded(seed, mounts, sensor, n_scans)
        true = se2.between(mounts["front"], mounts["rear"])
        try:
            found = find_mounts(logs, base="front")["rear"]
        except cs.InvalidArgumentError as error:
            print(f"rig {seed}: {error}", flush=True)
            lost.append(seed)
            continue
        error = found.pose - true
        error[2] = se2.wrap(error[2])
        errors.append(error)
        nees.append(float(error @ np.linalg.solve(found.covariance, error)))
        direction = rng.uniform(-np.pi, np.pi)
        off = np.array([WRONG_M * np.cos(direction), WRONG_M * np.sin(direction), rng.choice([-1, 1]) * WRONG_RAD])
        wrong.append(
            [told(found, true + off), told(found, true + off * (1, 1, 0)), told(found, true + off * (0, 0, 1))]
        )
        right.append(told(found, true))
        tracks.append(list(odometries(truth, mounts, logs)))
        print(
            f"rig {seed}: {np.round(1e3 * error[:2], 1)} mm {np.degrees(error[2]):.2f} deg, NEES {nees[-1]:.1f}",
            flush=True,
        )
    show(np.array(errors), np.array(nees), np.array(wrong), np.array(right), np.array(tracks))
    print(f"{len(lost)} rigs whose drive was too short or too straight")


def show(errors: Floats, nees: Floats, wrong: Floats, right: Floats, tracks: Floats) -> None:
    """Print what all rigs gave."""
    x, y, yaw = np.abs(errors).T
    for name, values in (("x, mm", 1e3 * x), ("y, mm", 1e3 * y), ("yaw, deg", np.degrees(yaw))):
        print(
            f"error of {name}: median {np.median(values):.2f}, 95 % {np.percentile(values, 95):.2f}, worst {values.max():.2f}"
        )
    print(f"NEES: mean {nees.mean():.2f} (3 is exact), {np.mean(nees < 7.815):.0%} within 95 %")
    both, place, turn = np.mean(wrong, axis=0)
    print(f"wrong by 5 cm and 2 deg told: {both:.0%}; by 5 cm alone {place:.0%}; by 2 deg alone {turn:.0%}")
    print(f"right ones told as wrong: {right.sum()} of {len(right)}")
    for k, name in enumerate(("two lasers", "the front one alone", "two, one fails at half the way")):
        error, matched, ms = tracks[:, k].T
        print(
            f"{name}: end error median {1e3 * np.median(error):.1f} mm, 95 % {1e3 * np.percentile(error, 95):.1f} mm, "
            f"worst {1e3 * error.max():.1f} mm; matched {matched.mean():.1%}; {np.median(ms):.2f} ms a scan"
        )


if __name__ == "__main__":
    main()
