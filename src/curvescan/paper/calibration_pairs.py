"""How the paper found n and S_min (its section 3.1): from pairs of scans whose relative pose is known.

n: accuracy against time. S_min: pairs of characteristic points of consecutive scans, of which the wrong ones shall be
rejected.
"""

import time
from dataclasses import dataclass

import numpy as np

from curvescan import se2
from curvescan.configs import as_config
from curvescan.matchers.cfsma.config import CfSmaConfig
from curvescan.matchers.cfsma.landmarks import Verdict
from curvescan.matchers.cfsma.matcher import CfSmaMatcher
from curvescan.matchers.cfsma.trace import CfSmaTrace
from curvescan.paper.random_transform import is_success
from curvescan.simulation import ScanPair, Sensor, simulate_pairs
from curvescan.types import Bools, Floats, Ints

NEIGHBOURS: Ints = np.array([5, 10, 15, 20, 25, 30, 35, 40, 50])  # n tried
SIMILARITIES: Floats = np.arange(0.0, 1.0, 0.05)  # S_min tried
_COST = 0.001  # share of the right pairs that the chosen S_min may cost

_SAME_PLACE = 0.15
"""Distance up to which two characteristic points are of one corner, metres: eq. 3 puts the peak before the corner, by a
way that changes with the noise."""


@dataclass(frozen=True, eq=False, kw_only=True)
class PairCalibration:
    """What pairs of scans showed, and the two parameters that follow."""

    n_neighbours: int  # the smallest n whose share of right matches lies within a standard error of the best
    min_similarity: float  # the largest S_min that costs hardly any right pair
    # share of right matches, and median time of one
    right_shares: Floats
    seconds: Floats
    # shares of the pairs of characteristic points, by S_min
    wrong_rejected: Floats
    right_kept: Floats


def calibrate_on_pairs(config: CfSmaConfig, sensor: Sensor, *, n_pairs: int = 200, seed: int = 0) -> PairCalibration:
    """Return n and S_min for a sensor, the other parameters given."""
    small = {"translation_max": 0.1, "rotation_max": np.radians(5.0)}
    pairs = list(simulate_pairs("office", sensor=sensor, n_pairs=n_pairs, seed=seed, **small))
    by_n = [as_config({"landmarks": {"n_neighbours": int(n)}}, config) for n in NEIGHBOURS]
    shares, seconds = np.array([_accuracy(one, pairs) for one in by_n]).T
    best = shares.max()
    tolerance = np.sqrt(best * (1.0 - best) / n_pairs)
    first = int(np.argmax(shares >= best - tolerance))
    similarity, is_right = _point_pairs(by_n[first], pairs)
    is_below = similarity <= SIMILARITIES[:, np.newaxis]
    wrong_rejected = np.mean(is_below[:, ~is_right], axis=1) if (~is_right).any() else np.zeros(len(SIMILARITIES))
    right_kept = 1.0 - np.mean(is_below[:, is_right], axis=1) if is_right.any() else np.ones(len(SIMILARITIES))
    s_min = float(SIMILARITIES[np.flatnonzero(right_kept >= 1.0 - _COST)[-1]])
    return PairCalibration(
        n_neighbours=int(NEIGHBOURS[first]),
        min_similarity=round(s_min, 3),
        right_shares=shares,
        seconds=seconds,
        wrong_rejected=wrong_rejected,
        right_kept=right_kept,
    )


def _accuracy(config: CfSmaConfig, pairs: list[ScanPair]) -> tuple[float, float]:
    """Return the share of right matches and the median time of one, seconds."""
    matcher = CfSmaMatcher(config)
    n_right = 0
    seconds = []
    for pair in pairs:
        reference, current = matcher.prepare(pair.reference), matcher.prepare(pair.current)
        started = time.perf_counter()
        result = matcher.match(reference, current, None)
        seconds.append(time.perf_counter() - started)
        n_right += bool(is_success(se2.between(pair.pose, result.pose)))
    return n_right / len(pairs), float(np.median(seconds))


def _point_pairs(config: CfSmaConfig, pairs: list[ScanPair]) -> tuple[Floats, Bools]:
    """Return the similarity of all mutually best pairs of characteristic points, and whether they are of one corner."""
    matcher = CfSmaMatcher(as_config({"landmarks": {"min_similarity": 0.0}}, config))
    similarity, is_right = [], []
    for pair in pairs:
        reference, current = matcher.prepare(pair.reference), matcher.prepare(pair.current)
        trace = matcher.match(reference, current, None).trace
        assert isinstance(trace, CfSmaTrace)
        found = trace.landmark_pairs
        rows = np.flatnonzero(found.verdict == Verdict.PAIRED)
        cur = current.points[current.landmarks.extents[rows, 0]]
        ref = reference.points[reference.landmarks.extents[found.partner[rows], 0]]
        away = se2.transform(pair.pose, cur) - ref
        similarity.append(found.similarity[rows])
        is_right.append(np.hypot(away[:, 0], away[:, 1]) < _SAME_PLACE)
    return np.concatenate(similarity), np.concatenate(is_right)
