"""CF-SMA3, first half: the pose that brings matched points together, in closed form (section 2.3, eqs. 10-12).

Lingemann, Nüchter, Hertzberg, Surmann, "High-speed laser localization for mobile robots", Robotics and
Autonomous Systems 51 (2005): the rotation from the centred cross and dot products, then the translation.

What CF-SMA lacks: a test that the surviving pairs agree. Off by default, as the paper has none.

CF-SMA takes all surviving pairs of characteristic points into one least squares, where one wrong pair turns the pose.
Here each surviving pair proposes the pose that aligns its own readings; the proposal under which most matched readings
lie together wins, and pairs that do not agree with it are left out, as in Fischler and Bolles, "Random sample
consensus", Communications of the ACM 24 (1981), with every sample tried.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from curvescan import se2
from curvescan._jit import kernel
from curvescan.matchers.cfsma.config import LandmarksConfig
from curvescan.matchers.cfsma.landmarks import LandmarkPairs, Landmarks, Verdict, matched_readings
from curvescan.types import Bools, Floats, Points, Pose

COINCIDENT = 1e-6
"""Spread, metres, under which matched points are one point and fix no rotation."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Alignment:
    """Closed-form minimum of eq. 10."""

    pose: Pose  # (3,): pose of cur in ref [x, y, theta]: metres, metres, radians in (-pi, pi]
    error: float  # E_min, square metres
    spread: float  # root mean square distance of the points of cur from their centre, metres

    @property
    def fixes_rotation(self) -> bool:
        """Whether the points lie apart, so that they determine a rotation."""
        return self.spread > COINCIDENT


def align(points_ref: Points, points_cur: Points) -> Alignment:
    """Return the pose of cur in ref that minimises the squared distances of matched points (eqs. 10-12).

    points_ref, points_cur (n, 2).
    """
    x, y, theta, error, spread = _align(points_ref, points_cur)
    return Alignment(pose=np.array([x, y, theta]), error=error, spread=spread)


@kernel
def _align(ref: Points, cur: Points) -> tuple[float, float, float, float, float]:
    """Return x, y, theta, E_min and the spread of cur."""
    n = ref.shape[0]
    centre_ref_x = centre_ref_y = centre_cur_x = centre_cur_y = 0.0
    for i in range(n):
        centre_ref_x += ref[i, 0]
        centre_ref_y += ref[i, 1]
        centre_cur_x += cur[i, 0]
        centre_cur_y += cur[i, 1]
    centre_ref_x /= n
    centre_ref_y /= n
    centre_cur_x /= n
    centre_cur_y /= n
    cross = dot = square = 0.0
    for i in range(n):
        ref_x, ref_y = ref[i, 0] - centre_ref_x, ref[i, 1] - centre_ref_y
        cur_x, cur_y = cur[i, 0] - centre_cur_x, cur[i, 1] - centre_cur_y
        cross += cur_x * ref_y - cur_y * ref_x
        dot += cur_x * ref_x + cur_y * ref_y
        square += cur_x * cur_x + cur_y * cur_y
    theta = math.atan2(cross, dot)
    c, s = math.cos(theta), math.sin(theta)
    x = centre_ref_x - (c * centre_cur_x - s * centre_cur_y)
    y = centre_ref_y - (s * centre_cur_x + c * centre_cur_y)
    error = 0.0
    for i in range(n):
        # from the points themselves: the difference of two large sums would lose a small error
        error += (ref[i, 0] - (c * cur[i, 0] - s * cur[i, 1] + x)) ** 2
        error += (ref[i, 1] - (s * cur[i, 0] + c * cur[i, 1] + y)) ** 2
    return x, y, theta, error, math.sqrt(square / n)


MOST_PROPOSALS = 100
"""Pairs that propose a pose, at most: those of the most readings."""


def consistent_pairs(
    points_cur: Points,
    landmarks_cur: Landmarks,
    points_ref: Points,
    landmarks_ref: Landmarks,
    pairs: LandmarkPairs,
    config: LandmarksConfig,
    tolerance: float,
) -> LandmarkPairs:
    """Return the pairs with the verdict INCONSISTENT on those that do not agree with the best proposal.

    points_cur, points_ref (m, 2).
    """
    rows = np.flatnonzero(pairs.verdict == Verdict.PAIRED)
    if rows.size < 2:
        return pairs
    # the readings of each pair as if it alone counted
    alone = np.where(np.arange(pairs.verdict.size) == rows[:, np.newaxis], Verdict.PAIRED, Verdict.NO_CANDIDATE)
    readings = [
        matched_readings(landmarks_cur, landmarks_ref, replace(pairs, verdict=verdict), config) for verdict in alone
    ]
    sizes = np.array([cur_idx.size for cur_idx, _ in readings])
    cur_idx, ref_idx = (np.concatenate(one) for one in zip(*readings, strict=True))
    cur, ref = points_cur[cur_idx], points_ref[ref_idx]
    starts = np.concatenate([[0], np.cumsum(sizes)[:-1]])

    def agreeing(pose: Pose) -> Bools:
        squared = np.sum((se2.transform(pose, cur) - ref) ** 2, axis=1)
        mean: Floats = np.add.reduceat(squared, starts) / sizes
        return mean <= tolerance**2

    best = np.zeros(rows.size, dtype=np.bool_)
    for k in np.argsort(-sizes, kind="stable")[:MOST_PROPOSALS]:
        own = slice(starts[k], starts[k] + sizes[k])
        found = agreeing(align(ref[own], cur[own]).pose)
        found[k] = True
        # the pose of all that agree is better than that of one, and more may agree with it
        chosen = np.repeat(found, sizes)
        again = agreeing(align(ref[chosen], cur[chosen]).pose)
        if sizes[again].sum() > sizes[best].sum():
            best = again
    verdict = pairs.verdict.copy()
    verdict[rows[~best]] = Verdict.INCONSISTENT
    return replace(pairs, verdict=verdict) if best.any() else pairs
