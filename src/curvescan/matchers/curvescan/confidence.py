"""Confidence: the probability that a pose is right, from how much agrees, what contradicts, and what else explains it.

Two things make a wrong pose look right. Chance: in a world of right angles a corner of
two walls fits any other, so only what agrees *beyond* the two longest walls counts in full; and surfaces larger than a
person that one scan has where the other saw through count against the pose. Repetition: shelves, pillars and bare rooms
look the same from several places, so another pose that explains much of what agrees, and is not contradicted, takes the
confidence away, whatever its score. The model and its fit: docs/design-notes/confidence.md.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.curvescan.assessment import Assessment
from curvescan.matchers.curvescan.features.range_image import RangeImage
from curvescan.matchers.curvescan.features.surfels import CX, CY, LENGTH, NX, NY, X, Y
from curvescan.matchers.curvescan.labels import DYNAMIC, INLIER, compare_readings
from curvescan.matchers.curvescan.pose_difference import difference
from curvescan.matchers.curvescan.search import Problem
from curvescan.types import Codes, Floats, Ints, Pose

MAX_REPETITION = 0.36
"""Least share of the agreement that another pose explains at which the match is ambiguous: of shifted shelves and pillars
and turned rooms 97 in 100 reach it, of right matches in furnished places 2 in 100."""

GUESSED_REPETITION = 0.3
"""Share of the agreement that a pose must explain for a guess to prefer it to the best."""

COEFFICIENTS = {
    "constant": 3.28,
    "log10_excess": 2.61,
    "log10_agreeing": 4.57,
    "log10_contradicted": -2.31,
    "contradicted_small": -1.92,
    "motion": -1.31,
    "degenerate": -3.14,
    "guessed": 3.0,
    "repetition": -7.37,
}
"""Log odds that a pose is right, by the terms of `Support`; fitted by bench/fit_confidence.py."""

_MAX_MOTION = 4.0  # beyond it a motion is as unlikely as any
_EXCESS_FLOOR = 0.1  # metres: noise of the excess length
_AGREEING_FLOOR = 0.02  # share: noise of the agreeing share
_LARGE_FLOOR = 0.2  # metres: noise of the contradicted length
_LARGE = 0.5  # metres: extent of a surface that is no person's
_N_TAKEN = (
    48  # readings that stand for all, and of these the ones through which walls are looked for
)
_N_SEEDS = 16
_NEAR_GUESS = 0.3  # metres, and radians: a pose within it is where the guess has it
_CONTRADICTED = (
    0.15  # of what agrees at another pose: contradicted beyond that, it explains nothing
)
_TWO_WALLS = 0.3  # metres of excess below which a pose rests on two walls alone
_MUCH_NEARER = 2.2  # the same for all others: a bare room turned by 180 degrees, its pose next to standing still
_NEARER = 0.7  # metres and radians by which the best pose may be nearer to the guess before others count less

_FADING = 0.25  # for each metre and radian: how fast others count less beyond that
_MAX_LOG_ODDS = 60.0  # beyond it a probability is 0 or 1
_ACROSS = 0.88  # cosine of the angle, 28 degrees, from which on two walls do not run alike
_ALIKE = 0.98  # cosine of the angle, 11 degrees, within which a reading faces as its wall does
_WALL = 0.12  # metres from its line within which a reading is of a wall


@dataclass(frozen=True, kw_only=True)
class Support:
    """What speaks for a pose and against it.

    Attributes
    ----------
    agreeing : float
        Share of the length of all surfaces seen that agrees, both ways round, 0 to 1.
    excess : float
        Length that agrees besides the two walls, not parallel, that agree most, metres.
    contradicted : float
        Length of surfaces longer than 0.5 m that one scan has where the other saw through, metres.
    contradicted_small : float
        Share of the length of all surfaces seen that is smaller ones of that kind: people, chairs.
    motion : float
        How far the pose is from the guess, or from standing still: metres plus radians.
    is_guessed : bool
        Whether it lies where a guess has it.
    is_degenerate : bool
        Whether the scans leave a direction open.
    repetition : float
        Most of the agreement that another pose explains, as a share.
    """

    agreeing: float
    excess: float
    contradicted: float
    contradicted_small: float
    motion: float
    is_guessed: bool
    is_degenerate: bool
    repetition: float

    @property
    def terms(self) -> dict[str, float]:
        """What the model weighs, by the names of its coefficients."""
        return {
            "constant": 1.0,
            "log10_excess": math.log10(max(self.excess, 0.0) + _EXCESS_FLOOR),
            "log10_agreeing": math.log10(self.agreeing + _AGREEING_FLOOR),
            "log10_contradicted": math.log10(self.contradicted + _LARGE_FLOOR),
            "contradicted_small": self.contradicted_small,
            "motion": min(self.motion, _MAX_MOTION),
            "degenerate": float(self.is_degenerate),
            "guessed": float(self.is_guessed),
            "repetition": self.repetition,
        }

    @property
    def is_repeated(self) -> bool:
        """Whether another pose explains so much of the scans that the two cannot be distinguished."""
        return self.repetition > MAX_REPETITION

    @property
    def confidence(self) -> float:
        """Probability that the pose is right, within what its covariance says, if it is not repeated."""
        log_odds = sum(COEFFICIENTS[name] * value for name, value in self.terms.items())
        return 1.0 / (1.0 + math.exp(-max(min(log_odds, _MAX_LOG_ODDS), -_MAX_LOG_ODDS)))


def support_of(
    problem: Problem,
    pose: Pose,
    assessment: Assessment,
    others: Sequence[Pose],
    is_degenerate: bool,
) -> Support:
    """Return what speaks for a pose.

    Parameters
    ----------
    problem : Problem
        Scans, guess, config.
    pose : (3,) float64
        Of the current scan in the reference.
    assessment : Assessment
        What the scans say of it.
    others : sequence of (3,) float64
        Poses that may be right instead.
    is_degenerate : bool
        Whether the scans leave a direction open.
    """
    ref, cur = problem.reference, problem.current
    codes = assessment.codes_ref, assessment.codes_cur
    a = support_lengths(ref.image.surfels, ref.bounds, codes[0], codes[0])
    b = support_lengths(cur.image.surfels, cur.bounds, codes[1], codes[1])
    agreeing, contradicted, large, _, total = (0.5 * (p + q) for p, q in zip(a, b, strict=True))
    excess = 0.5 * (
        excess_length(ref.image.surfels, codes[0]) + excess_length(cur.image.surfels, codes[1])
    )
    motion = motion_of(problem, pose)
    support = Support(
        agreeing=agreeing / max(total, _EXCESS_FLOOR),
        excess=excess,
        contradicted=large,
        contradicted_small=(contradicted - large) / max(total, _EXCESS_FLOOR),
        motion=motion,
        is_guessed=problem.guess is not None and motion < _NEAR_GUESS,
        is_degenerate=is_degenerate,
        repetition=0.0,
    )
    if support.confidence < problem.config.scoring.min_confidence:
        return support  # others would make it no better
    shares = (explained_share(problem, other, pose, assessment) for other in others)
    return replace(support, repetition=max(shares, default=0.0))


def motion_of(problem: Problem, pose: Pose) -> float:
    """Return how far a pose is from the guess, or from standing still: metres plus radians."""
    x, y, theta = difference(pose, np.zeros(3) if problem.guess is None else problem.guess)
    return math.hypot(x, y) + abs(theta)


def explained_share(problem: Problem, other: Pose, best: Pose, assessment: Assessment) -> float:
    """Return how much of what agrees at the best pose another one explains as well, as a share.

    The geometric mean of the shares of what agrees and of the excess length, less what is contradicted there and not at
    the best pose. A pose that rests on two walls alone counts less the farther it is from where the sensor is expected,
    any other where that is much farther.
    """
    ref, cur = problem.reference, problem.current
    agreeing, contradicted, excess, agreeing_best, excess_best = compare_explanations(
        ref.image,
        ref.bounds,
        assessment.codes_ref,
        cur.image,
        cur.bounds,
        assessment.codes_cur,
        other,
        problem.config.scoring.margin,
    )
    share = agreeing / max(agreeing_best, _EXCESS_FLOOR)
    share = math.sqrt(share * min(1.0, (excess + _LARGE) / (excess_best + _LARGE)))
    share *= max(0.0, 1.0 - contradicted / (_CONTRADICTED * max(agreeing, _EXCESS_FLOOR)))
    farther = motion_of(problem, other) - motion_of(problem, best)
    if excess < _TWO_WALLS:
        share *= min(1.0, max(0.0, 1.0 - 0.5 * (farther - _NEARER)))
    share *= min(1.0, max(0.0, 1.0 - _FADING * (farther - _MUCH_NEARER)))
    return float(share)


@kernel
def support_lengths(
    surfels: Floats, bounds: Ints, codes: Codes, codes_best: Codes
) -> tuple[float, float, float, float, float]:
    """Return lengths of surface, metres.

    What agrees, what is contradicted, of that in runs longer than 0.5 m, of that not contradicted at the best pose, all.
    """
    agreeing, contradicted, large, new, total = 0.0, 0.0, 0.0, 0.0, 0.0
    for k in range(bounds.size - 1):
        run, first = 0.0, -1
        for i in range(bounds[k], bounds[k + 1]):
            length = surfels[i, LENGTH]
            total += length
            if codes[i] == INLIER:
                agreeing += length
            if codes[i] == DYNAMIC:
                contradicted += length
                new += length if codes_best[i] != DYNAMIC else 0.0
                first = i if first < 0 else first
                run += length
            if first >= 0 and (codes[i] != DYNAMIC or i == bounds[k + 1] - 1):
                last = i if codes[i] == DYNAMIC else i - 1
                dx, dy = surfels[last, X] - surfels[first, X], surfels[last, Y] - surfels[first, Y]
                large += run if dx * dx + dy * dy > _LARGE * _LARGE else 0.0
                run, first = 0.0, -1
    return agreeing, contradicted, large, new, total


@kernel
def excess_length(surfels: Floats, codes: Codes) -> float:
    """Return the length of surface that agrees besides the wall that agrees most and the most of those across it, metres.

    A wall is what lies within 0.12 m of a line and faces like it within 0.2 rad; it is looked for through some
    readings, and of many only some are taken.
    """
    n = 0
    for i in range(codes.size):
        n += codes[i] == INLIER and surfels[i, LENGTH] > 0.0
    stride = max(n // _N_TAKEN, 1)
    rows = np.empty(n // stride + 1, dtype=np.int64)
    count, seen, total = 0, 0, 0.0
    for i in range(codes.size):
        if codes[i] != INLIER or surfels[i, LENGTH] <= 0.0:
            continue
        total += surfels[i, LENGTH]
        if seen % stride == 0:
            rows[count] = i
            count += 1
        seen += 1
    taken = np.zeros(count, dtype=np.bool_)
    wall, walls = -1, 0.0
    for turn in range(2):
        best, best_row = 0.0, -1
        for seed in range(0, count, max(count // _N_SEEDS, 1)):
            i = rows[seed]
            nx, ny = surfels[i, NX], surfels[i, NY]
            if turn == 1 and (
                taken[seed] or abs(nx * surfels[wall, NX] + ny * surfels[wall, NY]) > _ACROSS
            ):
                continue
            length = 0.0
            for k in range(count):
                if not taken[k] and is_on_wall(surfels, rows[k], i):
                    length += surfels[rows[k], LENGTH]
            if length > best:
                best, best_row = length, i
        if best_row < 0:
            break
        for k in range(count):
            taken[k] = taken[k] or is_on_wall(surfels, rows[k], best_row)
        wall = best_row
        walls += best * stride
    return max(total - walls, 0.0)


@kernel
def is_on_wall(surfels: Floats, i: int, seed: int) -> bool:
    """Return whether a reading lies on the line through another and faces like it."""
    nx, ny = surfels[seed, NX], surfels[seed, NY]
    if nx * surfels[i, NX] + ny * surfels[i, NY] < _ALIKE:
        return False
    off = nx * (surfels[i, CX] - surfels[seed, CX]) + ny * (surfels[i, CY] - surfels[seed, CY])
    return bool(abs(off) < _WALL)


@kernel
def compare_explanations(
    ref: RangeImage,
    bounds_ref: Ints,
    best_ref: Codes,
    cur: RangeImage,
    bounds_cur: Ints,
    best_cur: Codes,
    pose: Floats,
    margin: float,
) -> tuple[float, float, float, float, float]:
    """Return what agrees at a pose, what is contradicted there and not at the best one, the excess length there.

    And what agrees at the best pose and is in excess there; all metres. best_ref and best_cur are the codes there.
    """
    c, s = math.cos(pose[2]), math.sin(pose[2])
    back = np.array([-c * pose[0] - s * pose[1], s * pose[0] - c * pose[1], -pose[2]])
    codes_cur, _ = compare_readings(cur.surfels, ref, pose, margin)
    codes_ref, _ = compare_readings(ref.surfels, cur, back, margin)
    agreeing_a, _, _, new_a, _ = support_lengths(ref.surfels, bounds_ref, codes_ref, best_ref)
    agreeing_b, _, _, new_b, _ = support_lengths(cur.surfels, bounds_cur, codes_cur, best_cur)
    best_a = support_lengths(ref.surfels, bounds_ref, best_ref, best_ref)
    best_b = support_lengths(cur.surfels, bounds_cur, best_cur, best_cur)
    excess = 0.5 * (excess_length(ref.surfels, codes_ref) + excess_length(cur.surfels, codes_cur))
    excess_best = 0.5 * (
        excess_length(ref.surfels, best_ref) + excess_length(cur.surfels, best_cur)
    )
    agreeing, contradicted = 0.5 * (agreeing_a + agreeing_b), 0.5 * (new_a + new_b)
    return agreeing, contradicted, excess, 0.5 * (best_a[0] + best_b[0]), excess_best
