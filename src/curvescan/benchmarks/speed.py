"""How long a matcher takes: to prepare a scan, to match a pair, to match many pairs, and in which file."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np

from curvescan.matchers import match, prepare
from curvescan.simulation import SENSORS, ScanPair, Sensor, simulate_pairs
from curvescan.types import Floats, Pose


@dataclass(frozen=True, eq=False, kw_only=True)
class Speed:
    """Times of one matcher over many pairs of scans."""

    method: str  # name of the matcher
    n_beams: int  # beams of a scan
    prepare_seconds: Floats  # (2 m,): time of each preparation of a scan
    match_seconds: Floats  # (m,): time of each match of two prepared scans, without a guess
    guess_seconds: Floats  # (m,): the same with a guess as good as odometry's: 2 cm and 1 degree off


def easy_pairs(sensor: str | Sensor, n_pairs: int, seed: int) -> tuple[list[ScanPair], list[Pose]]:
    """Return pairs of scans 0.1 m and 5 deg apart at most, each of another office, and for each a guess.

    The guesses are as good as odometry's: 2 cm and 1 degree off, standard deviations.
    """
    turn = np.radians(5.0)
    pairs = simulate_pairs("office", sensor=sensor, n_pairs=n_pairs, translation_max=0.1, rotation_max=turn, seed=seed)
    rng = np.random.default_rng(seed)
    listed = list(pairs)
    return listed, [pair.pose + rng.normal(0.0, [0.02, 0.02, np.radians(1.0)]) for pair in listed]


def measure_speed(
    method: str, *, sensor: str | Sensor = "sick-lms200", n_pairs: int = 200, repeats: int = 5, seed: int = 0
) -> Speed:
    """Return the times of a matcher on simulated pairs, one thread."""
    pairs, guesses = easy_pairs(sensor, n_pairs, seed)
    for pair in pairs[:20]:
        match(pair.reference, pair.current, method=method)  # compiles
    prepare_seconds: list[float] = []
    match_seconds: list[float] = []
    guess_seconds: list[float] = []
    for _ in range(repeats):
        for pair, guess in zip(pairs, guesses, strict=True):
            # a new scan, which has not yet found out which of its readings are valid
            reference, current = replace(pair.reference), replace(pair.current)
            started = time.perf_counter()
            prepared_ref = prepare(reference, method=method)
            after_ref = time.perf_counter()
            prepared_cur = prepare(current, method=method)
            after_cur = time.perf_counter()
            match(prepared_ref, prepared_cur, method=method)
            without = time.perf_counter()
            match(prepared_ref, prepared_cur, method=method, guess=guess)
            ended = time.perf_counter()
            prepare_seconds += [after_ref - started, after_cur - after_ref]
            match_seconds.append(without - after_cur)
            guess_seconds.append(ended - without)
    return Speed(
        method=method,
        n_beams=len(pairs[0].reference),
        prepare_seconds=np.array(prepare_seconds),
        match_seconds=np.array(match_seconds),
        guess_seconds=np.array(guess_seconds),
    )


def with_beams(n_beams: int) -> Sensor:
    """Return the LMS200 with another number of beams over the same 180 degrees."""
    base = SENSORS["sick-lms200"]
    return replace(
        base,
        name=f"{n_beams} beams",
        n_beams=n_beams,
        angle_increment=base.angle_increment * (base.n_beams - 1) / (n_beams - 1),
    )
