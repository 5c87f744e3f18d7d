"""Characteristic points and their pairing (eqs. 7-9) against the slow twin."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from curvescan import InvalidArgumentError
from curvescan.matchers.cfsma.config import CurvatureConfig, LandmarksConfig
from curvescan.matchers.cfsma.curvature import curvature_functions
from curvescan.matchers.cfsma.landmarks import Verdict, characteristic_points, matched_readings, pair_landmarks
from tests.reference import cfsma as twin
from tests.scenes import rough_polyline

seeds = st.integers(0, 10_000)


def segment_of(points, config):
    whole = (np.array([0]), np.array([len(points)]))
    eta, _ = curvature_functions(points, *whole, CurvatureConfig(arc_tolerance=0.02))
    return eta, characteristic_points(eta, *whole, config)


ONE_PAIR = (np.array([0]), np.array([0]))


@given(seeds)
def test_characteristic_points_agree_with_the_slow_twin(seed):
    rng = np.random.default_rng(seed)
    lengths = rng.integers(3, 30, size=4)
    stops = np.cumsum(lengths)
    starts = stops - lengths
    eta = np.round(rng.uniform(-0.6, 0.6, stops[-1]), 1)  # rounded: ties do occur
    config = LandmarksConfig(min_curvature=0.3)
    found = characteristic_points(eta, starts, stops, config)
    for k in range(4):
        rows = found.extents[found.bounds[k] : found.bounds[k + 1]]
        expected = twin.characteristic(eta[starts[k] : stops[k]].tolist(), 0.3)
        assert (rows[:, 0] - starts[k]).tolist() == expected
        assert (rows[:, 1] == starts[k]).all()
        assert (rows[:, 2] == stops[k]).all()


@given(seeds, st.integers(1, 40), st.floats(0.3, 1.0))
def test_pairs_agree_with_the_slow_twin(seed, n, max_ambiguity):
    config = LandmarksConfig(n_neighbours=n, max_ambiguity=max_ambiguity)
    ref = rough_polyline(seed, n=50, n_corners=4)
    cur = rough_polyline(seed, n=50, n_corners=4)[3:48]
    cur = cur + 0.002 * np.random.default_rng(seed).standard_normal(cur.shape)
    _, points_ref = segment_of(ref, config)
    _, points_cur = segment_of(cur, config)
    pairs = pair_landmarks(cur, points_cur, ref, points_ref, ONE_PAIR, config)
    is_paired = pairs.verdict == Verdict.PAIRED
    slow = twin.surviving_pairs(
        cur,
        points_cur.extents[:, 0].tolist(),
        ref,
        points_ref.extents[:, 0].tolist(),
        n=n,
        min_similarity=config.min_similarity,
        max_ambiguity=max_ambiguity,
    )
    cur_at = points_cur.extents[is_paired, 0]
    ref_at = points_ref.extents[pairs.partner[is_paired], 0]
    assert list(zip(cur_at, ref_at, strict=True)) == slow
    for i, similarity, j in zip(cur_at, pairs.similarity[is_paired], ref_at, strict=True):
        # Pearson's sums of up to 81 terms, added in another order
        assert similarity == pytest.approx(twin.similarity(cur, i, ref, j, n), abs=1e-9)

    cur_idx, ref_idx = matched_readings(points_cur, points_ref, pairs, config)
    found = list(zip(cur_idx.tolist(), ref_idx.tolist(), strict=True))
    assert len(found) == len(set(found))
    assert set(found) == twin.matched(slow, len(cur), len(ref), n)


def corner_track(angles):
    """Unit steps that turn by the given angles, ten steps before and after each."""
    turns = np.zeros(10 * (len(angles) + 1))
    turns[10::10] = angles
    heading = np.cumsum(turns)
    return np.cumsum(0.1 * np.stack([np.cos(heading), np.sin(heading)], axis=1), axis=0)


def test_each_rejection_is_told():
    config = LandmarksConfig(n_neighbours=8)
    ref = corner_track([1.2, -1.2])
    _, points_ref = segment_of(ref, config)

    same = pair_landmarks(ref, points_ref, ref, points_ref, ONE_PAIR, config)
    assert set(same.verdict) == {Verdict.PAIRED}

    turned_half = -ref  # both coordinates run the other way: no similarity is left
    weak = pair_landmarks(turned_half, points_ref, ref, points_ref, ONE_PAIR, config)
    assert set(weak.verdict) == {Verdict.WEAK}

    no_function = (np.array([], int), np.array([], int))
    alone = pair_landmarks(ref, points_ref, ref, points_ref, no_function, config)
    assert set(alone.verdict) == {Verdict.NO_CANDIDATE}
    assert set(alone.partner) == {-1}

    # two equal teeth: a corner of the single tooth fits either, and nothing tells which
    teeth = corner_track([1.2, -1.2, -1.2, 1.2, 0.0, 1.2, -1.2, -1.2, 1.2])
    _, points_teeth = segment_of(teeth, config)
    both = pair_landmarks(ref, points_ref, teeth, points_teeth, ONE_PAIR, config)
    assert Verdict.AMBIGUOUS in both.verdict

    # the other way round, two teeth want the same corner: one of them is left alone
    keen = LandmarksConfig(n_neighbours=8, max_ambiguity=1.0)
    wooers = pair_landmarks(teeth, points_teeth, ref, points_ref, ONE_PAIR, keen)
    assert Verdict.ONE_SIDED in wooers.verdict


def test_no_points_no_pairs():
    config = LandmarksConfig()
    line = np.stack([np.arange(20.0), np.zeros(20)], axis=1)
    _, none = segment_of(line, config)
    assert len(none) == 0
    ref = corner_track([1.2])
    _, some = segment_of(ref, config)
    pairs = pair_landmarks(line, none, ref, some, ONE_PAIR, config)
    assert pairs.verdict.size == 0
    lonely = pair_landmarks(ref, some, line, none, ONE_PAIR, config)
    assert set(lonely.verdict) == {Verdict.NO_CANDIDATE}
    assert matched_readings(some, none, lonely, config)[0].size == 0


@pytest.mark.parametrize(
    ("field", "value", "rule"),
    [
        ("min_curvature", 0.0, r"min_curvature must lie in \(0, pi\) rad, got 0.0"),
        ("n_neighbours", 0, "n_neighbours must be at least 1, got 0"),
        ("min_similarity", -0.1, r"min_similarity must lie in \[0, 1\], got -0.1"),
        ("max_ambiguity", 0.0, r"max_ambiguity must lie in \(0, 1\], got 0.0"),
    ],
)
def test_configuration_rules(field, value, rule):
    with pytest.raises(InvalidArgumentError, match=rule):
        LandmarksConfig(**{field: value})
