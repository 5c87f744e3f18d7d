"""CF-SMA2 (b): characteristic points paired within each pair of functions (section 2.2, eqs. 7-9).

The characteristic points of two paired functions are compared by the Pearson correlation of the x and of the
y coordinates around them; three tests reject pairs that are weak, ambiguous or one-sided; and the readings
around each surviving pair are matched index by index.
"""

import math
from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from curvescan._jit import kernel
from curvescan.matchers.cfsma.config import LandmarksConfig
from curvescan.types import Bools, Codes, Floats, Ints, Points


class Verdict(IntEnum):
    """What became of a characteristic point of the current scan."""

    NO_CANDIDATE = 0
    """Its function is not paired, or the paired function has no characteristic point."""
    WEAK = 1
    """Its best similarity is at most S_min."""
    AMBIGUOUS = 2
    """Another point is nearly as similar as the best."""
    ONE_SIDED = 3
    """Its best partner prefers another point."""
    INCONSISTENT = 4
    """Its partner does not agree with the other pairs; only with the consistency test, which the paper has not."""
    PAIRED = 5
    """It has a partner."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Landmarks:
    """Characteristic points of one scan."""

    # (c, 3): Row [i, start, stop]: the point is reading i in sweep order, of the segment of readings start..stop - 1.
    # Ascending.
    extents: Ints
    bounds: Ints  # (s + 1,): segment k has the rows bounds[k]:bounds[k + 1]

    def __len__(self) -> int:
        return int(self.extents.shape[0])


@dataclass(frozen=True, eq=False, kw_only=True)
class LandmarkPairs:
    """What became of each characteristic point of the current scan."""

    partner: Ints  # (c,): row of the most similar candidate among the reference's landmarks; -1 without a candidate
    similarity: Floats  # (c,): Similarity S to it (eq. 8), in [0, 1].
    verdict: Codes  # (c,): a Verdict; only where it is PAIRED do the partners count


def characteristic_points(eta: Floats, starts: Ints, stops: Ints, config: LandmarksConfig) -> Landmarks:
    """Return the characteristic points: local maxima of abs(eta) of at least U_p (eq. 7).

    Departure: eq. 7 prints eta where the paper's figures show abs(eta). The figures are followed, so that concave
    corners count as well as convex ones.

    eta (m,); starts, stops (s,).
    """
    height = np.abs(eta)
    is_peak = np.zeros(eta.size, dtype=np.bool_)
    middle = height[1:-1]
    is_peak[1:-1] = (middle >= config.min_curvature) & (height[:-2] < middle) & (middle >= height[2:])
    is_peak[starts] = False
    is_peak[stops - 1] = False
    points = np.flatnonzero(is_peak)
    bounds = np.append(np.searchsorted(points, starts), points.size)
    segment = np.searchsorted(starts, points, side="right") - 1
    extents = np.empty((points.size, 3), dtype=np.int64)
    extents[:, 0], extents[:, 1], extents[:, 2] = points, starts[segment], stops[segment]
    return Landmarks(extents=extents, bounds=bounds)


def pair_landmarks(
    points_cur: Points,
    landmarks_cur: Landmarks,
    points_ref: Points,
    landmarks_ref: Landmarks,
    function_pairs: tuple[Ints, Ints],
    config: LandmarksConfig,
) -> LandmarkPairs:
    """Return the most similar partner of each characteristic point and the verdict on it (eqs. 8-9).

    Candidates are the characteristic points of the paired function. The neighbourhood of n readings a side is cut
    short at the ends of a segment, equally in both. A negative correlation is no match: it counts as 0, so that two
    negative ones do not make a similarity.

    Departure: distinctiveness is required of both points of a pair; the paper requires it of the current one. So does
    swapping the scans give the same pairs, and the inverse pose.

    points_cur, points_ref (m, 2); function_pairs ((p,) int64, (p,) int64).
    """
    candidates = np.zeros((len(landmarks_cur), 2), dtype=np.int64)
    for segment_cur, segment_ref in zip(*function_pairs, strict=True):
        rows = slice(landmarks_cur.bounds[segment_cur], landmarks_cur.bounds[segment_cur + 1])
        candidates[rows] = landmarks_ref.bounds[segment_ref : segment_ref + 2]
    best, runner_up, partner, is_mutual = _compare(
        points_cur, landmarks_cur.extents, points_ref, landmarks_ref.extents, candidates, config.n_neighbours
    )
    verdict = np.full(best.size, Verdict.PAIRED, dtype=np.uint8)
    verdict[~is_mutual] = Verdict.ONE_SIDED
    verdict[runner_up > config.max_ambiguity * best] = Verdict.AMBIGUOUS
    verdict[best <= config.min_similarity] = Verdict.WEAK
    verdict[partner < 0] = Verdict.NO_CANDIDATE
    return LandmarkPairs(partner=partner, similarity=best, verdict=verdict)


def matched_readings(
    landmarks_cur: Landmarks, landmarks_ref: Landmarks, pairs: LandmarkPairs, config: LandmarksConfig
) -> tuple[Ints, Ints]:
    """Return the pairs of readings around each pair of characteristic points, index by index.

    At most N_l (2 n + 1) pairs, fewer where a segment ends. The weights of eq. 10 are 0 or 1: two readings that
    several neighbourhoods match in the same way are one pair.

    cur_idx, ref_idx (N_t,).
    """
    is_paired = pairs.verdict == Verdict.PAIRED
    return _pair_neighbours(
        landmarks_cur.extents[is_paired], landmarks_ref.extents[pairs.partner[is_paired]], config.n_neighbours
    )


@kernel
def _compare(
    points_cur: Points, extents_cur: Ints, points_ref: Points, extents_ref: Ints, candidates: Ints, n_neighbours: int
) -> tuple[Floats, Floats, Ints, Bools]:
    """Return, for each current point, best similarity, runner-up, best partner, and if it is mutual.

    The runner-up of a mutual pair is the better one of both sides.
    """
    n_cur = extents_cur.shape[0]
    n_ref = extents_ref.shape[0]
    best = np.zeros(n_cur)
    runner_up = np.zeros(n_cur)
    partner = np.full(n_cur, -1, dtype=np.int64)
    favour = np.full(n_ref, -1.0)
    second_favour = np.zeros(n_ref)
    favourite = np.full(n_ref, -1, dtype=np.int64)
    for c in range(n_cur):
        for r in range(candidates[c, 0], candidates[c, 1]):
            i, j = extents_cur[c, 0], extents_ref[r, 0]
            before = min(n_neighbours, i - extents_cur[c, 1], j - extents_ref[r, 1])
            after = min(n_neighbours, extents_cur[c, 2] - 1 - i, extents_ref[r, 2] - 1 - j)
            similarity = max(0.0, _pearson(points_cur, i, points_ref, j, before, after, 0))
            similarity *= max(0.0, _pearson(points_cur, i, points_ref, j, before, after, 1))
            if partner[c] < 0 or similarity > best[c]:
                runner_up[c] = best[c]
                best[c] = similarity
                partner[c] = r
            elif similarity > runner_up[c]:
                runner_up[c] = similarity
            if similarity > favour[r]:
                second_favour[r] = max(favour[r], 0.0)
                favour[r] = similarity
                favourite[r] = c
            elif similarity > second_favour[r]:
                second_favour[r] = similarity
    is_mutual = np.zeros(n_cur, dtype=np.bool_)
    for c in range(n_cur):
        if partner[c] >= 0 and favourite[partner[c]] == c:
            is_mutual[c] = True
            runner_up[c] = max(runner_up[c], second_favour[partner[c]])
    return best, runner_up, partner, is_mutual


@kernel
def _pearson(points_cur: Points, i: int, points_ref: Points, j: int, before: int, after: int, axis: int) -> float:
    """Return Pearson's correlation of one coordinate around readings i and j (eq. 9); 0 if constant."""
    n = before + 1 + after
    sum_c = sum_r = sum_cc = sum_rr = sum_cr = 0.0
    for k in range(-before, after + 1):
        # taken from the point itself: sums of squares of large coordinates would lose digits
        c = points_cur[i + k, axis] - points_cur[i, axis]
        r = points_ref[j + k, axis] - points_ref[j, axis]
        sum_c += c
        sum_r += r
        sum_cc += c * c
        sum_rr += r * r
        sum_cr += c * r
    spread_c = n * sum_cc - sum_c * sum_c
    spread_r = n * sum_rr - sum_r * sum_r
    if spread_c <= 0.0 or spread_r <= 0.0:
        return 0.0
    return (n * sum_cr - sum_c * sum_r) / math.sqrt(spread_c * spread_r)


@kernel
def _pair_neighbours(extents_cur: Ints, extents_ref: Ints, n_neighbours: int) -> tuple[Ints, Ints]:
    """Return matched readings; rows of the two tables are paired and of ascending current reading."""
    n_pairs = extents_cur.shape[0]
    cur_idx = np.empty(n_pairs * (2 * n_neighbours + 1), dtype=np.int64)
    ref_idx = np.empty_like(cur_idx)
    last = np.empty(n_pairs, dtype=np.int64)  # last current reading each pair has matched
    n = 0
    for p in range(n_pairs):
        i, j = extents_cur[p, 0], extents_ref[p, 0]
        first = i - min(n_neighbours, i - extents_cur[p, 1], j - extents_ref[p, 1])
        last[p] = i + min(n_neighbours, extents_cur[p, 2] - 1 - i, extents_ref[p, 2] - 1 - j)
        for q in range(p):
            # an earlier neighbourhood at the same lag of the same segments has these pairs already
            same_segment = extents_cur[q, 1] == extents_cur[p, 1]
            if same_segment and extents_ref[q, 0] - extents_cur[q, 0] == j - i:
                first = max(first, last[q] + 1)
        for k in range(first, last[p] + 1):
            cur_idx[n] = k
            ref_idx[n] = k + (j - i)
            n += 1
    return cur_idx[:n], ref_idx[:n]
