"""What CF-SMA lacks: a test that the surviving pairs agree. Off by default, as the paper has none.

CF-SMA takes all surviving pairs of characteristic points into one least squares, where one wrong pair turns the pose.
Here each surviving pair proposes the pose that aligns its own readings; the proposal under which most matched readings
lie together wins, and pairs that do not agree with it are left out, as in Fischler and Bolles, "Random sample
consensus", Communications of the ACM 24 (1981), with every sample tried.
"""

from __future__ import annotations

import numpy as np

from curvescan import se2
from curvescan.matchers.cfsma.alignment import align
from curvescan.matchers.cfsma.config import LandmarksConfig
from curvescan.matchers.cfsma.landmarks import LandmarkPairs, Landmarks, Verdict, matched_readings
from curvescan.types import Bools, Floats, Ints, Points, Pose

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
    readings = [matched_readings(landmarks_cur, landmarks_ref, _only(pairs, int(row)), config) for row in rows]
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
    if not best.any():
        return pairs
    return _rejecting(pairs, rows[~best])


def _only(pairs: LandmarkPairs, row: int) -> LandmarkPairs:
    """Return the pairs with one alone that counts."""
    verdict = np.full_like(pairs.verdict, Verdict.NO_CANDIDATE)
    verdict[row] = Verdict.PAIRED
    return LandmarkPairs(partner=pairs.partner, similarity=pairs.similarity, verdict=verdict)


def _rejecting(pairs: LandmarkPairs, rows: Ints) -> LandmarkPairs:
    verdict = pairs.verdict.copy()
    verdict[rows] = Verdict.INCONSISTENT
    return LandmarkPairs(partner=pairs.partner, similarity=pairs.similarity, verdict=verdict)
