"""Labels: agreement, what has come or gone, what is out of sight."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.assessment.labels import DYNAMIC, INLIER, MOVED, OCCLUDED, agreeing_limits, mark_moved
from curvescan.matchers.curvescan.association import BACKWARD, FORWARD, motion_of
from curvescan.matchers.curvescan.features.range_image import reading_at
from curvescan.matchers.curvescan.features.surfels import CX, CY, NX, NY, RANGE, VARIANCE, X, Y
from tests.matchers.curvescan.scenes import MOTION, compare_readings, features, pair, pillar_scan
from tests.reference import curvescan as slow

STILL = motion_of(np.zeros(3), FORWARD)


@pytest.mark.parametrize("seed", range(4))
def test_labels_follow_their_definition(seed):
    ref, cur = pair(seed)
    pose = MOTION + 0.02 * np.random.default_rng(seed).standard_normal(3)
    codes, partner = compare_readings(cur.image.surfels, ref, pose, 0.01)
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
    cur = features(cs.LaserScan(ranges, angle_min=scan.angle_min, angle_increment=scan.angle_increment, range_max=20.0))
    codes, _ = compare_readings(cur.image.surfels, ref, MOTION, 0.01)
    is_person = np.isin(cur.beam_idx, np.arange(100, 110))
    assert (codes[is_person] == DYNAMIC).all()
    assert np.mean(codes[~is_person] == INLIER) > 0.85
    assert np.mean(codes[~is_person] == DYNAMIC) < 0.02
    # and from the other side: what the person hides is out of sight
    codes, _ = compare_readings(ref.image.surfels, cur, cs.se2.inverse(MOTION), 0.01)
    behind = np.isin(ref.beam_idx, np.arange(110, 113))
    assert (codes[behind] != DYNAMIC).all()


@pytest.mark.parametrize("way", [FORWARD, BACKWARD])
@pytest.mark.parametrize("seed", range(3))
def test_surfaces_that_moved_are_those_of_the_slow_twin(seed, way):
    ref, cur = pair(seed)
    pose = MOTION + np.array([0.004, 0.0, 0.0])  # half a wall seems to have moved
    one, other = (cur, ref) if way == FORWARD else (ref, cur)
    codes, partner = compare_readings(one.image.surfels, other, pose if way == FORWARD else cs.se2.inverse(pose), 0.01)
    for least in (0.0, 0.003, 0.01):
        surfels, seen, left = one.image.surfels, codes.copy(), partner.copy()
        expected = slow.has_moved(surfels, one.bounds, partner, other.image.surfels, pose, way == BACKWARD, least)
        n_moved = mark_moved(surfels, one.bounds, seen, left, other.image.surfels, pose, way, least)
        np.testing.assert_array_equal(seen >= MOVED, expected)
        np.testing.assert_array_equal(left, np.where(expected, -1, partner))
        assert n_moved == sum(expected[a] for a, b in itertools.pairwise(one.bounds))


def test_readings_of_surfaces_that_moved_are_dynamic_or_what_they_were():
    surfels = wall().image.surfels[150:160].copy()
    codes = np.array(
        [INLIER, INLIER, OCCLUDED, INLIER, INLIER, DYNAMIC, INLIER, OCCLUDED, INLIER, INLIER], dtype=np.uint8
    )
    partner = np.where(codes == INLIER, np.arange(10), -1)
    pose = np.array([0.5, 0.0, 0.0])
    assert mark_moved(surfels, np.array([0, 7, 10]), codes, partner, surfels, pose, FORWARD, 0.01) == 1
    moved = [MOVED + (DYNAMIC if code == INLIER else code) for code in (INLIER, INLIER, OCCLUDED, INLIER, INLIER)]
    assert codes.tolist() == [*moved, MOVED + DYNAMIC, MOVED + DYNAMIC, OCCLUDED, INLIER, INLIER]
    assert partner.tolist() == [-1, -1, -1, -1, -1, -1, -1, -1, 8, 9]  # the second has too few partners


def test_a_box_that_was_pushed_a_little_is_found_by_all_its_readings_together():
    ref, plain = pillar_scan(seed=1), pillar_scan(seed=2)
    ranges = plain.ranges.copy()
    is_box = (ref.points[:, 0] > 1.1) & (ref.points[:, 0] < 1.55) & (ref.points[:, 1] > 0.6)
    is_box &= ref.points[:, 1] < 1.05
    assert is_box.sum() > 20
    ranges[is_box] += 0.02  # within the noise of any one reading
    pushed = cs.LaserScan(ranges, angle_min=plain.angle_min, angle_increment=plain.angle_increment, range_max=20.0)
    result = cs.match(ref, pushed)
    assert np.mean(result.labels_current[is_box] == cs.matchers.Label.DYNAMIC) > 0.9
    assert np.mean(result.labels_current[~is_box] == cs.matchers.Label.MATCHED) > 0.9
    still = cs.match(ref, plain)
    assert (still.labels_current == cs.matchers.Label.DYNAMIC).mean() < 0.02


@pytest.mark.parametrize("side", [-1.0, 1.0])
@pytest.mark.parametrize(("n_sigmas", "is_inlier"), [(2.2, True), (2.8, True), (3.2, False), (6.0, False)])
def test_a_reading_agrees_within_three_standard_deviations(side, n_sigmas, is_inlier):
    ref, _ = pair()
    moved = ref.image.surfels.copy()
    has_line = moved[:, VARIANCE] > 0.0
    normal, centre = moved[:, [NX, NY]], moved[:, [CX, CY]]
    # along its beam, so that it stays in the direction of its own line, to so many deviations of both readings
    distance = side * n_sigmas * np.sqrt(2.0 * moved[:, VARIANCE], where=has_line, out=0.0 * normal[:, 0])
    share = (np.sum(normal * centre, axis=1) + distance) / np.sum(normal * moved[:, [X, Y]], axis=1)
    moved[:, [X, Y]] *= share[:, np.newaxis]
    codes, partner = compare_readings(moved, ref, np.zeros(3), 0.0)
    # a grazed line is reached so far along that nothing is said of it
    is_own = has_line & (np.abs(share - 1.0) < 0.05)
    assert is_own.sum() > 200
    assert ((codes[is_own] == INLIER) == is_inlier).mean() > 0.97
    if is_inlier:
        assert (partner[is_own] == np.flatnonzero(is_own)).mean() > 0.97


def wall(n=361):
    """Features of a straight wall 3 m ahead."""
    angles = np.radians(np.linspace(-60.0, 60.0, n))
    noise = 0.005 * np.random.default_rng(7).standard_normal(n)
    scan = cs.LaserScan(
        3.0 / np.cos(angles) + noise, angle_min=angles[0], angle_increment=angles[1] - angles[0], range_max=20.0
    )
    return features(scan)


def test_how_far_two_readings_of_one_surface_may_lie_apart():
    surfels = wall().image.surfels[:2].copy()
    surfels[:, VARIANCE] = 4e-4, 5e-4
    surfels[1, RANGE] = 5.0
    # three standard deviations of both across; along a decimetre, and a tenth of the range
    limits = agreeing_limits(surfels, 0, surfels, 1, 0.01, STILL)
    np.testing.assert_allclose(limits, [3.0 * 0.03 + 0.01, 0.1 + 0.5], rtol=1e-12)
    # without a line: 5 cm across, a decimetre along, whichever of them has none
    for k in (0, 1):
        alone = surfels.copy()
        alone[k, VARIANCE] = -1.0
        limits = agreeing_limits(alone, 0, alone, 1, 0.01, STILL)
        np.testing.assert_allclose(limits, [0.06, 0.1], rtol=1e-12)


@pytest.mark.parametrize("way", [FORWARD, BACKWARD])
def test_the_two_sides_of_a_wall_are_not_one_surface(way):
    surfels = wall().image.surfels[:2].copy()
    beyond = motion_of(np.array([2.0 * surfels[0, X], 0.0, np.pi]), way)  # a sensor that looks back at the wall
    assert agreeing_limits(surfels, 0, surfels, 1, 0.01, STILL)[1] > 0.1
    limit, reach = agreeing_limits(surfels, 0, surfels, 1, 0.01, beyond)
    assert (limit > 0.01, reach) == (True, 0.0)
    surfels[1, VARIANCE] = -1.0  # of a thing as small as that the far side may be seen
    assert agreeing_limits(surfels, 0, surfels, 1, 0.01, beyond)[1] == 0.1


@pytest.mark.parametrize(("more", "code"), [(-0.01, OCCLUDED), (0.01, DYNAMIC)])
def test_another_thing_stands_five_centimetres_in_front_of_what_agrees(more, code):
    seen = wall()
    surfels = seen.image.surfels
    k = int(np.argmin(np.abs(surfels[:, Y])))  # straight ahead
    limit, _ = agreeing_limits(surfels, k, surfels, k, 0.01, STILL)
    front = surfels[k, RANGE] - 2.0 * limit - 0.05 - more
    moved = surfels[k : k + 1].copy()
    moved[0, [X, Y]] *= front / math.hypot(*moved[0, [X, Y]])
    codes, partner = compare_readings(moved, seen, np.zeros(3), 0.01)
    assert codes.tolist() == [code]
    assert partner.tolist() == [-1]


def test_what_lies_beside_its_line_along_it_is_not_of_the_surface():
    """The line's own reading at 3 m: 0.4 m along it is within reach, and a little more is not."""
    seen = wall()
    k = int(np.argmin(np.abs(seen.image.surfels[:, Y])))
    for shift, is_inlier in ((0.39, True), (-0.39, True), (0.42, False), (-0.42, False)):
        # the line's centre moves away along the wall, and its reading stays
        other = wall()
        other.image.surfels[k, [CX, CY]] = 3.0, other.image.surfels[k, Y] + shift
        other.image.surfels[k, [NX, NY]] = -1.0, 0.0
        reading = np.array(other.image.surfels[k : k + 1])
        reading[0, [X, Y]] = 3.0, seen.image.surfels[k, Y]
        reach = 0.1 + 0.1 * other.image.surfels[k, RANGE]
        assert reach == pytest.approx(0.4, abs=0.005)
        codes, _ = compare_readings(reading, other, np.zeros(3), 0.01)
        assert (codes[0] == INLIER) == is_inlier


@pytest.mark.parametrize(("n", "has_moved"), [(3, False), (4, True), (5, True)])
@pytest.mark.parametrize(
    ("shift", "sigma", "least", "is_far"),
    [(0.05, 0.005, 0.01, True), (0.05, 0.005, 0.06, False), (0.05, 0.05, 0.01, False), (-0.05, 0.005, 0.01, True)],
)
def test_a_surface_has_moved_by_the_mean_of_four_readings(n, has_moved, shift, sigma, least, is_far):
    surfels = wall().image.surfels[150:160].copy()
    surfels[:, VARIANCE] = sigma**2
    surfels[:, [CX, CY]] = surfels[:, [X, Y]]
    surfels[:, [NX, NY]] = -1.0, 0.0
    partner = np.arange(10)
    partner[n:] = -1
    pose = np.array([shift, 0.0, 0.0])
    bounds = np.array([0, 10])

    def n_moved(one, other):
        codes = np.full(10, INLIER, dtype=np.uint8)
        return mark_moved(one, bounds, codes, partner.copy(), other, pose, FORWARD, least)

    # the mean of n errs by 7 mm over the root of n: 5 cm are 14 standard deviations of four readings
    assert n_moved(surfels, surfels) == (has_moved and is_far)
    # a partner without a line does not count
    blind = surfels.copy()
    blind[0, VARIANCE] = -1.0
    for one, other in ((surfels, blind), (blind, surfels)):
        assert n_moved(one, other) == (n > 4 and is_far)
