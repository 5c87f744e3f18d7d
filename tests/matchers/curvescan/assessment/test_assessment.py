"""Assessment of one pose: both ways, without what moved, and which directions are open."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.assessment.assessment import (
    Assessment,
    along_weakest_direction,
    assess_pose,
    degenerate_directions,
    ties_of,
    without_dynamic,
)
from curvescan.matchers.curvescan.assessment.confidence import Support
from curvescan.matchers.curvescan.assessment.labels import INLIER, MOVED
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.features.surfels import X
from curvescan.matchers.curvescan.prior import WIDE
from tests.matchers.curvescan.scenes import MOTION, compare_readings, features, hall_scan, pair, weigh

CONFIG = CurvescanConfig()
RULES = CONFIG.information


def assessed(*, n_inliers=20, n_readings=60, **fields):
    """An Assessment whose readings say nothing; one of the fields may be given."""
    codes = np.zeros(n_readings, dtype=np.uint8)
    whole = {
        "codes_ref": codes,
        "codes_cur": codes,
        "n_inliers": n_inliers,
        "n_dynamic": 0,
        "information": (1e4, 2e4, 3e4),
        "axes": np.eye(3),
        "units": np.ones(3),
        "may_keep_pace": False,
    }
    known = {**whole, **fields}
    spurious = known.pop("spurious", np.zeros(3))
    least = np.maximum(2.0 * spurious, CONFIG.information.max_sigma**-2)
    known["is_open"] = tuple((known["information"] < least).tolist())
    return Assessment(**known)


def test_a_pose_is_assessed_from_both_scans():
    ref, cur = pair()
    found = assess_pose(ref, cur, MOTION, CONFIG)
    margin = CONFIG.scoring.margin
    for surfels, other, pose, codes in (
        (cur.image.surfels, ref, MOTION, found.codes_cur),
        (ref.image.surfels, cur, cs.se2.inverse(MOTION), found.codes_ref),
    ):
        np.testing.assert_array_equal(codes, compare_readings(surfels, other, pose, margin)[0])
    assert found.n_inliers == np.count_nonzero(found.codes_cur == INLIER) > 150
    assert found.n_dynamic == 0


@pytest.mark.parametrize(
    ("n_inliers", "n_readings", "is_enough"),
    [(15, 361, True), (14, 361, False), (14, 42, True), (13, 42, False), (2, 6, True)],
)
def test_as_many_readings_must_agree_as_the_config_says_or_a_third(n_inliers, n_readings, is_enough):
    found = assessed(n_inliers=n_inliers, n_readings=n_readings)
    assert CONFIG.scoring.min_inliers == 15
    assert found.is_enough(CONFIG) == is_enough


def test_the_weakest_direction_is_given_in_metres_and_radians():
    axes = np.eye(3)[:, [2, 0, 1]]  # the turn is known worst
    found = assessed(axes=axes, units=np.array([1.0, 1.0, 0.25]))
    np.testing.assert_array_equal(found.weakest, [0.0, 0.0, 0.25])  # moves what is 4 m away by 1 m


@pytest.mark.parametrize(
    ("information", "is_weak"), [([999.0, 1e4, 1e5], True), ([1001.0, 1e4, 1e5], False), ([1001.0, 1001.0, 1e9], False)]
)
def test_a_direction_is_weak_beside_the_next(information, is_weak):
    assert RULES.degenerate_ratio == 0.1
    assert assessed(information=information).is_weakly_observable(CONFIG) == is_weak


@pytest.mark.parametrize(
    ("changed", "expected"),
    [
        ({}, [False, False, False]),
        # no better than 0.1 m
        ({"information": (99.0, 2e4, 3e4)}, [True, False, False]),
        ({"information": (99.0, 99.5, 3e4)}, [True, True, False]),
        # at most twice what tilted lines give of themselves
        ({"spurious": np.array([5001.0, 0.0, 0.0])}, [True, False, False]),
        ({"spurious": np.array([4999.0, 9999.0, 14999.0])}, [False, False, False]),
        ({"spurious": np.array([0.0, 10001.0, 15001.0])}, [False, True, True]),
    ],
)
def test_a_direction_is_open_that_is_known_badly(changed, expected):
    ref, cur = pair()
    found = degenerate_directions(ref, cur, MOTION, assessed(**changed), CONFIG)
    np.testing.assert_array_equal(found, expected)


def test_a_weak_direction_is_open_where_the_scans_agree_as_well_along_it():
    along, across = np.eye(3), np.eye(3)[:, [1, 0, 2]]
    weak = {"information": (1e3, 2e4, 3e4)}
    hall = features(hall_scan(0.0, seed=1)), features(hall_scan(0.0, seed=2))
    arguments = (*hall, np.zeros(3))
    for axes, is_open in ((along, True), (across, False)):
        found = degenerate_directions(*arguments, assessed(axes=axes, **weak), CONFIG)
        np.testing.assert_array_equal(found, [is_open, False, False])
    # known well beside the next it is not even looked at
    strong = {"information": (1e4, 2e4, 3e4)}
    assert not any(degenerate_directions(*arguments, assessed(axes=along, **strong), CONFIG))
    # a room with pillars fixes both, however weak they are said to be
    for axes in (along, across):
        assert not any(degenerate_directions(*pair(), MOTION, assessed(axes=axes, **weak), CONFIG))


def test_what_moved_is_left_out_of_the_pose():
    ref, cur = pair()
    poses = np.array([MOTION + np.array([0.005, -0.005, 0.0]), MOTION + 0.5])
    found = assess_pose(ref, cur, MOTION, CONFIG)
    # the wall ahead, of both scans, is said to have moved: what is left does not fix x as well
    in_front = {
        name: np.where(features_of.image.surfels[:, X] < 2.0, codes, MOVED + codes)
        for name, features_of, codes in (("codes_ref", ref, found.codes_ref), ("codes_cur", cur, found.codes_cur))
    }
    for changed in ({}, in_front):
        moved = found._replace(n_dynamic=1, **changed)
        refined, again = without_dynamic(ref, cur, poses, moved, CONFIG)
        np.testing.assert_allclose(refined[0], MOTION, atol=3e-3)
        np.testing.assert_array_equal(refined[1], poses[1])  # only the first is refined
        np.testing.assert_array_equal(again.codes_cur, assess_pose(ref, cur, refined[0], CONFIG).codes_cur)
        if not changed:
            whole = refined[0]
    assert np.abs(refined[0] - whole).max() > 1e-6


def test_of_poses_along_a_corridor_the_nearest_to_the_guess_is_taken():
    ref, cur = features(hall_scan(0.0, seed=1)), features(hall_scan(0.4, seed=2))
    assessment = assess_pose(ref, cur, np.zeros(3), CONFIG)
    poses = np.array([[0.6, 0.0, 0.0], [0.05, 0.0, 0.0], [0.6, 1.0, 0.0]])
    assert along_weakest_direction(poses, assessment, True, CONFIG) == [1]


def test_ties_are_what_repeats_along_the_wall_or_all_where_the_first_is_not_sure_alone():
    sure = Support(log_odds=4.0, competing={1: -3.0, 2: -3.0, 3: -3.0}, repeated=[1, 3])
    assert ties_of(sure, [1, 2], CONFIG) == [1]
    assert ties_of(sure, [2], CONFIG) == []
    assert ties_of(sure, [], CONFIG) == []
    unsure = Support(log_odds=4.0, competing={1: -3.0, 2: 0.5, 3: -3.0}, repeated=[1, 3])
    assert ties_of(unsure, [1, 2], CONFIG) == [1, 2]


def test_one_wall_and_little_more_is_no_rival_to_itself_but_named():
    # 0.4 m of a wall across is all that fixes the pose along the long one
    ref, cur = features(hall_scan(0.0, seed=1)), features(hall_scan(0.4, seed=2))
    assessment = assess_pose(ref, cur, np.zeros(3), CONFIG)
    poses = np.array([[0.0, 0.0, 0.0], [0.9, 0.0, 0.0], [0.3, 0.6, 0.0], [0.9, 0.0, 1.0]])
    assert along_weakest_direction(poses, assessment, False, CONFIG) == [1]


def test_along_one_long_wall_other_places_are_no_rivals():
    ref, cur = features(hall_scan(0.0, seed=1)), features(hall_scan(0.4, seed=2))
    pose = np.array([[0.4, 0.0, 0.0]])
    known = assess_pose(ref, cur, pose[0], CONFIG)._replace(information=(1e5, 2e5, 1e6))  # as if people fixed it
    assert weigh(ref, cur, WIDE, pose, [0.8]).is_along_walls
    others = np.array([[0.4, 0.0, 0.0], [1.3, 0.0, 0.0], [0.4, 0.6, 0.0]])
    assert along_weakest_direction(others, known, True, CONFIG) == [1]
    assert along_weakest_direction(others, known, False, CONFIG) == []
