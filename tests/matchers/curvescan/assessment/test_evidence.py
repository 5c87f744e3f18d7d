"""Evidence: lengths of surface that speak for a pose and against it."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan.matchers.curvescan.assessment.assessment import assess_pose
from curvescan.matchers.curvescan.assessment.evidence import (
    AGREEING,
    EXCESS,
    LARGE,
    MISFIT,
    MISSED,
    N_EVIDENCE,
    SEEN_THROUGH,
    SMALL,
    WEAKEST,
    gather_evidence,
    runs_seen_through,
)
from curvescan.matchers.curvescan.assessment.labels import DYNAMIC, INLIER
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.features.objects import find_objects
from curvescan.matchers.curvescan.features.surfels import CX, CY, LENGTH, N_COLUMNS, NX, NY, RANGE, VARIANCE, X, Y
from tests.matchers.curvescan.proposal.test_rotation_hypotheses import hall_scan
from tests.matchers.curvescan.scenes import MOTION, features, pair, turned

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


def leaning(distance):
    """Surfels of a wall at 3 m with a stretch of 0.3 m that stands so far before it, and the rows of that."""
    surfels = wall(3, -2, 3, 2)
    rows = np.arange(18, 21)
    surfels[rows, X] -= distance
    surfels[rows, CX] -= distance
    surfels[:, RANGE] = np.hypot(surfels[:, X], surfels[:, Y])
    return surfels, rows


@pytest.mark.parametrize(("distance", "is_person"), [(0.3, True), (0.15, True), (0.05, False), (-0.3, False)])
def test_a_person_before_a_wall_is_no_wall_though_of_one_surface_with_it(distance, is_person):
    surfels, rows = leaning(distance)
    codes = np.full(len(surfels), INLIER, dtype=np.uint8)
    codes[rows] = DYNAMIC
    bounds, nothing = np.array([0, len(surfels)]), np.zeros(len(surfels), dtype=np.bool_)
    _, length = runs_seen_through(surfels, bounds, codes, nothing)
    assert length == pytest.approx(0.3 if is_person else 0.0)
    # what is a small thing already is not counted twice, and a long stretch is no person
    assert runs_seen_through(surfels, bounds, codes, ~nothing)[1] == 0.0
    codes[10:21] = DYNAMIC
    assert runs_seen_through(surfels, bounds, codes, nothing)[1] == 0.0


@pytest.mark.parametrize("way", [1.0, -1.0])
def test_a_person_at_a_wall_that_runs_aslant_is_none_the_less_before_it(way):
    wall_aslant = wall(2.0, -2.0 * way, 4.0, 2.0 * way)
    normal = wall_aslant[0, [NX, NY]]
    for distance, is_person in ((0.3, True), (0.03, False)):
        surfels = wall_aslant.copy()
        rows = np.arange(18, 21)
        surfels[rows, X] += distance * normal[0]
        surfels[rows, Y] += distance * normal[1]
        # the wall's ranges rise along it by more than a person stands before it: only its line tells
        surfels[:, RANGE] = 3.0
        codes = np.full(len(surfels), INLIER, dtype=np.uint8)
        codes[rows] = DYNAMIC
        nothing = np.zeros(len(surfels), dtype=np.bool_)
        _, length = runs_seen_through(surfels, np.array([0, len(surfels)]), codes, nothing)
        assert length == pytest.approx(3 * surfels[0, LENGTH] if is_person else 0.0)


def test_a_person_at_the_first_or_the_last_reading_stands_before_nothing_else():
    surfels, _ = leaning(0.0)
    nothing = np.zeros(len(surfels), dtype=np.bool_)
    bounds = np.array([0, len(surfels)])
    for rows in (np.arange(3), np.arange(37, 40)):
        moved = surfels.copy()
        moved[rows, X] -= 0.3
        moved[:, RANGE] = np.hypot(moved[:, X], moved[:, Y])
        moved[-1 if rows[0] == 0 else 0, RANGE] = 1.0  # the far end of the wall says nothing
        codes = np.full(len(surfels), INLIER, dtype=np.uint8)
        codes[rows] = DYNAMIC
        assert runs_seen_through(moved, bounds, codes, nothing)[1] == pytest.approx(0.3)


def test_a_piece_of_a_wall_that_goes_on_on_one_side_is_no_person():
    corner = np.vstack([wall(3, -2, 3, 2), wall(2.6, 2, 3, 2, n=5)[::-1]])
    codes = np.full(len(corner), INLIER, dtype=np.uint8)
    codes[36:40] = DYNAMIC
    nothing = np.zeros(len(corner), dtype=np.bool_)
    assert runs_seen_through(corner, np.array([0, len(corner)]), codes, nothing)[1] == 0.0


def test_only_long_runs_within_one_surface_are_large():
    surfels = wall(3, -2, 3, 2)  # 0.1 m a reading
    codes = np.full(40, INLIER, dtype=np.uint8)
    codes[4:6] = DYNAMIC
    codes[30:] = DYNAMIC
    nothing = np.zeros(len(surfels), dtype=np.bool_)

    def large_length(*bounds):
        return runs_seen_through(surfels, np.array(bounds), codes, nothing)[0]

    assert large_length(0, 40) == pytest.approx(1.0)
    assert large_length(0, 35, 40) == 0.0  # a run ends with its surface
    codes[:8] = DYNAMIC  # each run counts for itself
    assert large_length(0, 40) == pytest.approx(1.8)
    codes[4:6] = INLIER
    assert large_length(0, 40) == pytest.approx(1.0)


def test_what_may_move_is_small_and_stands_before_something():
    person, behind = wall(2, -0.2, 2, 0.2, n=8), wall(4, 0.45, 4, 2)
    surfels = np.vstack([person, behind])
    assert find_objects(surfels, np.array([0, 8, 48]))[2].tolist() == [True] * 8 + [False] * 40
    # as far away as what is beside it: a piece of the wall
    beside = np.vstack([wall(4, -0.2, 4, 0.2, n=8), behind])
    assert not find_objects(beside, np.array([0, 8, 48]))[2][8:].any()
    long = np.vstack([wall(2, -0.5, 2, 0.5, n=8), behind])
    assert not find_objects(long, np.array([0, 8, 48]))[2].any()


def test_the_true_pose_has_all_for_it_and_others_are_contradicted():
    ref, cur = pair()
    beside = MOTION + np.array([0.15, 0.0, 0.0])
    across = MOTION + np.array([0.0, 0.0, np.pi / 2])
    true, missed, other = evidence(ref, cur, MOTION, beside, across)
    assert true.shape == (N_EVIDENCE,)
    inliers = assess_pose(ref, cur, MOTION, CONFIG).codes_cur == INLIER
    lengths = cur.image.surfels[inliers, LENGTH].sum()
    assert true[AGREEING] == pytest.approx(lengths, rel=0.1)
    assert 0.4 < true[MISFIT] < 1.2  # as the noise has it: lines average it, and share it with their readings
    assert true[EXCESS] > 1.0
    assert true[WEAKEST] > 2.0
    assert true[SEEN_THROUGH] + true[LARGE] + true[SMALL] < 0.2
    assert missed[MISSED] > 1.0 > 0.05 > true[MISSED]
    assert other[AGREEING] < 0.5 * true[AGREEING]
    assert other[SEEN_THROUGH] + other[SMALL] > 1.0


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
