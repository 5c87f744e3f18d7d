"""The consistency test: one wrong pair of corners must not turn the pose."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.matchers.cfsma.alignment import consistent_pairs
from curvescan.matchers.cfsma.config import CfSmaConfig, LandmarksConfig
from curvescan.matchers.cfsma.landmarks import LandmarkPairs, Landmarks, Verdict
from curvescan.simulation import simulate_pairs

N = 21
POSE = np.array([0.2, -0.1, 0.15])
CONFIG = LandmarksConfig(n_neighbours=10)


def corner(at, angle):
    """A right-angled corner of 21 readings, 5 cm apart."""
    s = 0.05 * (np.arange(N) - N // 2)
    sides = np.column_stack([np.minimum(s, 0.0), np.maximum(s, 0.0)])
    return sides @ se2.rotation(angle).T + at


def scene(n, wrong=()):
    """`n` corners seen twice; the reference's corners in `wrong` are of something else, half a metre away."""
    cur = np.concatenate([corner((1.5 * k, 2.0), 0.4 * k) for k in range(n)])
    ref = se2.transform(POSE, cur)
    for k in wrong:
        ref[N * k : N * (k + 1)] += (0.4, 0.3)
    starts = N * np.arange(n)
    extents = np.column_stack([starts + N // 2, starts, starts + N])
    marks = Landmarks(extents=extents, bounds=np.arange(n + 1))
    pairs = LandmarkPairs(
        partner=np.arange(n), similarity=np.ones(n), verdict=np.full(n, Verdict.PAIRED, dtype=np.uint8)
    )
    return cur, marks, ref, marks, pairs


@pytest.mark.parametrize("wrong", [(0,), (2,), (1, 3)])
def test_the_pairs_that_do_not_agree_are_left_out(wrong):
    # two wrong pairs moved alike would agree with each other, but fewer readings do
    verdict = consistent_pairs(*scene(5, wrong), CONFIG, 0.05).verdict
    assert np.flatnonzero(verdict == Verdict.INCONSISTENT).tolist() == list(wrong)
    assert np.count_nonzero(verdict == Verdict.PAIRED) == 5 - len(wrong)


def test_pairs_that_agree_all_stay_and_a_lone_pair_is_not_judged():
    assert set(consistent_pairs(*scene(4), CONFIG, 0.05).verdict) == {Verdict.PAIRED}
    assert set(consistent_pairs(*scene(1, (0,)), CONFIG, 0.05).verdict) == {Verdict.PAIRED}


def test_the_verdicts_given_are_left_alone():
    *scans, pairs = scene(4, (1,))
    consistent_pairs(*scans, pairs, CONFIG, 0.05)
    assert set(pairs.verdict) == {Verdict.PAIRED}


@pytest.mark.slow
def test_among_people_more_matches_are_right_with_it():
    pairs = simulate_pairs("office", sensor="sick-lms200-5mm", n_pairs=60, people_share=0.15, seed=5)
    n_right = [0, 0]
    for pair in pairs:
        for k, consistency in enumerate((False, True)):
            config = CfSmaConfig(consistency=consistency)
            result = cs.match(pair.reference, pair.current, method="cfsma", config=config)
            x, y, theta = se2.between(pair.pose, result.pose)
            n_right[k] += bool(np.hypot(x, y) < 0.1 and abs(theta) < np.radians(2))
    # the same pairs both ways: what differs is the test alone
    assert n_right[1] >= n_right[0] + 3


def test_its_tolerance_must_be_positive():
    with pytest.raises(cs.InvalidArgumentError, match="consistency_distance must be > 0 m"):
        CfSmaConfig(consistency_distance=0.0)
