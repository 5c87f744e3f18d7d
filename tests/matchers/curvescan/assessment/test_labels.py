"""Labels: agreement, what has come or gone, what is out of sight."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.assessment.labels import (
    DYNAMIC,
    INLIER,
    OCCLUDED,
    compare_readings,
    static_segments,
)
from curvescan.matchers.curvescan.features.range_image import reading_at
from curvescan.matchers.curvescan.features.surfels import CX, CY, NX, NY, VARIANCE, X, Y
from tests.matchers.curvescan.scenes import MOTION, features, pair, pillar_scan
from tests.reference import curvescan as slow


@pytest.mark.parametrize("seed", range(4))
def test_labels_follow_their_definition(seed):
    ref, cur = pair(seed)
    pose = MOTION + 0.02 * np.random.default_rng(seed).standard_normal(3)
    codes, partner = compare_readings(cur.image.surfels, ref.image, pose, 0.01)
    for surfel, code, j in zip(cur.image.surfels, codes, partner, strict=True):
        point = cs.se2.transform(pose, surfel[:2])
        seen = reading_at(*point, ref.image)
        assert (j >= 0) == (code == INLIER)
        if seen < 0:
            assert code == OCCLUDED
            continue
        other = ref.image.surfels[seen]
        if surfel[7] < 0 or other[7] < 0:
            continue
        limit = 3.0 * np.sqrt(surfel[7] + other[7]) + 0.01
        across = abs(other[5:7] @ (point - other[3:5]))
        if code == INLIER:
            assert j == seen
            assert across < limit
        elif code == DYNAMIC:
            assert np.linalg.norm(point) < other[2] - 2.0 * limit
        else:
            assert np.linalg.norm(point) > other[2] - 2.0 * limit - 0.06


def test_someone_who_walked_in_is_seen_as_moved():
    ref = features(pillar_scan(seed=1))
    scan = pillar_scan(MOTION, seed=2)
    ranges = scan.ranges.copy()
    ranges[100:110] = 0.6
    cur = features(
        cs.LaserScan(
            ranges, angle_min=scan.angle_min, angle_increment=scan.angle_increment, range_max=20.0
        )
    )
    codes, _ = compare_readings(cur.image.surfels, ref.image, MOTION, 0.01)
    is_person = np.isin(cur.beam_idx, np.arange(100, 110))
    assert (codes[is_person] == DYNAMIC).all()
    assert np.mean(codes[~is_person] == INLIER) > 0.85
    assert np.mean(codes[~is_person] == DYNAMIC) < 0.02
    # and from the other side: what the person hides is out of sight
    codes, _ = compare_readings(ref.image.surfels, cur.image, cs.se2.inverse(MOTION), 0.01)
    behind = np.isin(ref.beam_idx, np.arange(110, 113))
    assert (codes[behind] != DYNAMIC).all()


@pytest.mark.parametrize("seed", range(3))
def test_surfaces_at_rest_are_those_of_the_slow_twin(seed):
    ref, cur = pair(seed)
    pose = MOTION + np.array([0.004, 0.0, 0.0])  # half a wall seems to have moved
    _, partner = compare_readings(cur.image.surfels, ref.image, pose, 0.01)
    for least in (0.0, 0.003, 0.01):
        arguments = (cur.image.surfels, cur.bounds, partner, ref.image.surfels, pose, 4.0, least)
        is_static, n_dynamic = static_segments(*arguments)
        np.testing.assert_array_equal(is_static, slow.static_segments(*arguments))
        assert n_dynamic == sum(not is_static[a] for a, b in itertools.pairwise(cur.bounds))


def test_a_box_that_was_pushed_a_little_is_found_by_all_its_readings_together():
    ref, plain = pillar_scan(seed=1), pillar_scan(seed=2)
    ranges = plain.ranges.copy()
    is_box = (ref.points[:, 0] > 1.1) & (ref.points[:, 0] < 1.55) & (ref.points[:, 1] > 0.6)
    is_box &= ref.points[:, 1] < 1.05
    assert is_box.sum() > 20
    ranges[is_box] += 0.02  # within the noise of any one reading
    pushed = cs.LaserScan(
        ranges, angle_min=plain.angle_min, angle_increment=plain.angle_increment, range_max=20.0
    )
    result = cs.match(ref, pushed)
    assert np.mean(result.labels_current[is_box] == cs.matchers.Label.DYNAMIC) > 0.9
    assert np.mean(result.labels_current[~is_box] == cs.matchers.Label.MATCHED) > 0.9
    still = cs.match(ref, plain)
    assert (still.labels_current == cs.matchers.Label.DYNAMIC).mean() < 0.02


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(
    ("n_sigmas", "is_inlier"), [(2.2, True), (2.8, True), (3.2, False), (6.0, False)]
)
def test_a_reading_agrees_within_three_standard_deviations(side, n_sigmas, is_inlier):
    ref, _ = pair()
    moved = ref.image.surfels.copy()
    has_line = moved[:, VARIANCE] > 0.0
    normal, centre = moved[:, [NX, NY]], moved[:, [CX, CY]]
    # along its beam, so that it stays in the direction of its own line, to so many deviations of both readings
    distance = (
        side * n_sigmas * np.sqrt(2.0 * moved[:, VARIANCE], where=has_line, out=0.0 * normal[:, 0])
    )
    share = (np.sum(normal * centre, axis=1) + distance) / np.sum(normal * moved[:, [X, Y]], axis=1)
    moved[:, [X, Y]] *= share[:, np.newaxis]
    codes, partner = compare_readings(moved, ref.image, np.zeros(3), 0.0)
    # a grazed line is reached so far along that nothing is said of it
    is_own = has_line & (np.abs(share - 1.0) < 0.05)
    assert is_own.sum() > 200
    assert ((codes[is_own] == INLIER) == is_inlier).mean() > 0.97
    if is_inlier:
        assert (partner[is_own] == np.flatnonzero(is_own)).mean() > 0.97
