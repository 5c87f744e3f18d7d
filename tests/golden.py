"""What the matchers, the odometry and SLAM answer today, to every digit: `python -m tests.golden` writes the file anew.

A change that moves no result leaves golden.json alone; one that does is made on purpose, with it in its commit.
`python -m tests.golden --digest` prints one hash of all bits, for two trees on one machine.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

import curvescan as cs
from curvescan.simulation import simulate_pairs

FILE = Path(__file__).with_name("golden.json")

_PAIRS: tuple[tuple[str, dict[str, Any]], ...] = (
    ("office", {}),
    ("office", {"translation_max": 0.6, "rotation_max": 0.7, "people_share": 0.15}),
    ("office", {"sensor": "spinning-360", "rotation_max": np.pi}),
    ("office", {"sensor": "hokuyo-270", "people_share": 0.1}),
    ("corridor", {}),
    ("bare-corridor", {}),
    ("round-room", {}),
    ("clutter", {"translation_max": 0.5}),
)
_DRIVES: tuple[dict[str, Any], ...] = (
    {"world": "office-floor", "n_scans": 60, "n_people": 4, "seed": 3},
    {"world": "office", "sensor": "spinning-360", "n_scans": 50, "seed": 5},
)
_OFF = np.array([0.05, -0.04, 0.03])  # of a guess: metres, metres, radians
_BASELINES = ("cfsma", "idc", "cox", "histogram", "plicp")


def answers() -> Iterator[dict[str, Any]]:
    """Yield one record a match and one a drive."""
    for k, (world, options) in enumerate(_PAIRS):
        pairs = simulate_pairs(world, n_pairs=3, seed=100 + k, **options)
        if world == "round-room":
            pairs = replace(pairs, sight_share=0.3)
        for i, pair in enumerate(pairs):
            for name, guess in (("", None), (" guessed", pair.pose + _OFF)):
                result = cs.match(pair.reference, pair.current, guess=guess)
                yield _of_match(f"{world} {k}.{i}{name}", result)
        for i in range(2):  # of two places: what is no match, and why
            result = cs.match(pairs[i].reference, pairs[i + 1].current)
            yield _of_match(f"{world} {k}.{i} elsewhere", result)
    for i, pair in enumerate(simulate_pairs("office", n_pairs=2, translation_max=0.1, seed=200)):
        for method in _BASELINES:
            yield _of_match(f"{method} {i}", cs.match(pair.reference, pair.current, method=method))
    for k, options in enumerate(_DRIVES):
        log = cs.simulate(**options)
        for prior in (False, True):
            odometry = cs.Odometry()
            poses = log.odometry.poses if prior else [None] * len(log)
            steps = [odometry.add(scan, pose) for scan, pose in zip(log, poses, strict=True)]
            yield {
                "name": f"drive {k}{' with prior' if prior else ''}",
                "outcome": " ".join(step.outcome.name for step in steps),
                "pose": np.array([step.pose for step in steps]).ravel().tolist(),
                "covariance": np.array([step.covariance for step in steps]).ravel().tolist(),
            }
    yield _of_slam()


def _of_slam() -> dict[str, Any]:
    """Return what SLAM makes of two laps round a room, the second the other way, after a turn on the spot."""
    there, back = np.linspace(0.0, 2.2 * np.pi, 90), np.linspace(2.2 * np.pi, 0.5, 70)[1:]
    turn = np.linspace(0.5, -0.5, 14)[1:-1] * np.pi
    angle = np.concatenate((there, np.full(len(turn), there[-1]), back))
    heading = angle + np.concatenate((np.full(len(there), 0.5 * np.pi), turn, np.full(len(back), -0.5 * np.pi)))
    laps = np.column_stack((np.cos(angle), np.sin(angle), heading))
    slam = cs.Slam()
    for scan in cs.simulate("room", poses=laps, odometry_noise=None, seed=4):
        slam.add(scan)
    slam.finish()
    graph = slam.map
    return {
        "name": "slam",
        "outcome": " ".join(f"{c.i}-{c.j} {c.outcome.name}" for c in slam.closures),
        "pose": np.concatenate((graph.poses.ravel(), graph.measured.ravel())).tolist(),
        "covariance": graph.covariances.ravel().tolist(),
    }


def _of_match(name: str, result: cs.MatchResult) -> dict[str, Any]:
    labels = (result.labels_reference, result.labels_current)
    return {
        "name": name,
        "outcome": result.outcome.name,
        "pose": result.pose.tolist(),
        "covariance": result.covariance.ravel().tolist(),
        "n_matched": int(result.n_matched),
        "labels": ["".join(map(str, one.tolist())) for one in labels],
    }


def main() -> None:
    """Write the file, or print the digest of all answers."""
    text = json.dumps(list(answers()), indent=0)
    if "--digest" in sys.argv:
        sys.stdout.write(hashlib.sha256(text.encode()).hexdigest() + "\n")
    else:
        FILE.write_text(text + "\n")


if __name__ == "__main__":
    main()
