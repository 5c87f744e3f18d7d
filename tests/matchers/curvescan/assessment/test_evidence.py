"""Evidence: lengths of surface that speak for a pose and against it."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.assessment.assessment import assess_pose
from curvescan.matchers.curvescan.assessment.evidence import (
    AGREEING,
    EXCESS,
    MISFIT,
    N_EVIDENCE,
    SEEN_THROUGH,
    SMALL,
    WEAKEST,
    excess_lengths,
    gather_evidence,
)
from curvescan.matchers.curvescan.assessment.labels import INLIER
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.features.objects import find_objects
from curvescan.matchers.curvescan.features.surfels import CX, CY, LENGTH, N_COLUMNS, NX, NY, RANGE, VARIANCE, X, Y
from tests.matchers.curvescan.scenes import MOTION, features, hall_scan, pair, turned

CONFIG = CurvescanConfig()


def wall(x0, y0, x1, y1, n=40):
    """Surfels of a straight wall that faces the origin."""
    surfels = np.zeros((n, N_COLUMNS))
    surfels[:, X] = surfels[:, CX] = np.linspace(x0, x1, n)
    surfels[:, Y] = surfels[:, CY] = np.linspace(y0, y1, n)
    surfels[:, RANGE] = np.hypot(surfels[:, X], surfels[:, Y])
    along = np.array([x1 - x0, y1 - y0])
    normal = np.array([-along[1], along[0]]) / np.hypot(*along)
    normal *= -np.sign(normal @ [x0, y0])
    surfels[:, NX], surfels[:, NY] = normal
    surfels[:, LENGTH] = np.hypot(*along) / n
    return surfels


def evidence(ref, cur, *poses):
    return gather_evidence(ref, cur, np.array(poses), CONFIG.scoring.margin)[0]


def test_what_may_move_is_small_and_stands_before_something():
    person, behind = wall(2, -0.2, 2, 0.2, n=8), wall(4, 0.45, 4, 2)
    surfels = np.vstack([person, behind])
    assert find_objects(surfels, np.array([0, 8, 48])).is_small.tolist() == [True] * 8 + [False] * 40
    # as far away as what is beside it: a piece of the wall
    beside = np.vstack([wall(4, -0.2, 4, 0.2, n=8), behind])
    assert not find_objects(beside, np.array([0, 8, 48])).is_small[8:].any()
    long = np.vstack([wall(2, -0.5, 2, 0.5, n=8), behind])
    assert not find_objects(long, np.array([0, 8, 48])).is_small.any()


def test_the_true_pose_has_all_for_it_and_others_are_contradicted():
    ref, cur = pair()
    beside = MOTION + np.array([0.15, 0.0, 0.0])
    across = MOTION + np.array([0.0, 0.0, np.pi / 2])
    true, shifted, other = evidence(ref, cur, MOTION, beside, across)
    assert true.shape == (N_EVIDENCE,)
    inliers = assess_pose(ref, cur, MOTION, CONFIG).codes_cur == INLIER
    lengths = cur.image.surfels[inliers, LENGTH].sum()
    assert true[AGREEING] == pytest.approx(lengths, rel=0.1)
    assert 0.4 < true[MISFIT] < 1.2  # as the noise has it: lines average it, and share it with their readings
    assert true[EXCESS] > 1.0
    assert true[WEAKEST] > 2.0
    assert true[SEEN_THROUGH] + true[SMALL] < 0.2
    assert shifted[SEEN_THROUGH] > 1.0 > 0.05 > true[SEEN_THROUGH]
    assert shifted[AGREEING] < 0.7 * true[AGREEING]
    assert other[AGREEING] < 0.5 * true[AGREEING]
    assert other[SEEN_THROUGH] + other[SMALL] > 1.0


def test_a_wall_is_seen_through_where_the_other_scan_has_an_open_door_however_grazed():
    angles = np.linspace(0.1, np.pi - 0.1, 600)
    walls = 1.0 / np.sin(angles)
    along = walls * np.cos(angles)
    doors = np.where((along > 3.0) & (along < 4.0), 1.4 * walls, walls)
    noise = np.random.default_rng(1).normal(0.0, 0.005, (2, len(angles)))
    step = angles[1] - angles[0]
    closed, door = (
        features(cs.LaserScan(ranges + off, angle_min=0.1, angle_increment=step, range_max=20.0))
        for ranges, off in zip((walls, doors), noise, strict=True)
    )
    (through,), (nothing,) = evidence(door, closed, np.zeros(3)), evidence(closed, closed, np.zeros(3))
    assert through[SEEN_THROUGH] == pytest.approx(0.5, abs=0.1)  # 1 m of one scan, the mean of both
    assert nothing[SEEN_THROUGH] < 0.02


def test_what_is_known_of_no_noise_has_no_misfit():
    ref, cur = pair()
    [found] = evidence(ref, cur, MOTION)
    for scan in (ref, cur):
        variances = scan.image.surfels[:, VARIANCE].copy()
        scan.image.surfels[::2, VARIANCE] = 0.0
        [some] = evidence(ref, cur, MOTION)
        assert some[MISFIT] == pytest.approx(found[MISFIT], rel=0.2)
        assert some[AGREEING] == found[AGREEING]
        scan.image.surfels[:, VARIANCE] = variances


@pytest.mark.parametrize("heading", [0.4, -1.1, 2.0])
def test_a_corridor_fixes_nothing_along_itself(heading):
    """However the sensor is turned in it."""
    halls = hall_scan(0.0, seed=1), hall_scan(0.4, seed=2)
    ref, cur = (features(turned(scan, heading)) for scan in halls)
    [found] = evidence(ref, cur, np.zeros(3))
    assert found[AGREEING] > 3.0
    assert found[WEAKEST] < 0.1


def test_swapped_scans_have_the_same_evidence():
    ref, cur = pair()
    [one] = evidence(ref, cur, MOTION)
    c, s = np.cos(MOTION[2]), np.sin(MOTION[2])
    x, y, _ = MOTION
    [swapped] = evidence(cur, ref, np.array([-c * x - s * y, s * x - c * y, -MOTION[2]]))
    np.testing.assert_allclose(one, swapped, atol=1e-9)


def test_what_agrees_besides_two_walls_is_excess():
    two = np.vstack([wall(3, -2, 3, 2), wall(-2, 2, 3, 2)])
    three = np.vstack([two, wall(-2, -2, 3, -2)])
    assert excess_lengths(two, np.ones(len(two), dtype=np.uint8))[0] < 0.2
    # both long walls run the same way: one of them, and the short one across it, do not count
    excess, beyond = excess_lengths(three, np.ones(len(three), dtype=np.uint8))
    assert excess == pytest.approx(5.0, abs=0.3)
    assert beyond < 0.2
    codes = np.ones(len(three), dtype=np.uint8)
    codes[80:] = 2  # what does not agree is no excess
    assert excess_lengths(three, codes)[0] < 0.2
    assert excess_lengths(three, np.zeros(len(three), dtype=np.uint8)) == (0.0, 0.0)


def test_nothing_of_a_bare_room_lies_beyond_its_four_walls():
    room = np.vstack([wall(3, -2, 3, 2), wall(-2, 2, 3, 2), wall(-2, -2, 3, -2), wall(-2, -2, -2, 2)])
    assert excess_lengths(room, np.ones(len(room), dtype=np.uint8))[1] < 0.3
    # a second wall that faces the same way, and one across a corner, are no sides of a rectangle
    for more in (wall(1.5, 0.5, 1.5, 1.5), wall(2.2, 2.0, 3.0, 1.2)):
        furnished = np.vstack([room, more])
        beyond = excess_lengths(furnished, np.ones(len(furnished), dtype=np.uint8))[1]
        assert beyond == pytest.approx(np.sum(more[:, LENGTH]), abs=0.4)


@pytest.mark.parametrize(("turn", "excess"), [(5.0, 0.0), (15.0, 0.5)])
def test_what_faces_another_way_than_its_wall_is_excess(turn, excess):
    """Readings within 0.12 m of a wall's line are of the wall where they face as it does, to 11 degrees."""
    walls = np.vstack([wall(3, -2, 3, 2), wall(-2, 2, 3, 2)])
    corner = wall(3.02, -1, 3.02, -0.5, n=10)
    angle = np.radians(180.0 + turn)
    corner[:, NX], corner[:, NY] = np.cos(angle), np.sin(angle)
    surfels = np.vstack([walls, corner])
    found = excess_lengths(surfels, np.ones(len(surfels), dtype=np.uint8))[0]
    plain = excess_lengths(walls, np.ones(len(walls), dtype=np.uint8))[0]
    assert found - plain == pytest.approx(excess, abs=0.15)
