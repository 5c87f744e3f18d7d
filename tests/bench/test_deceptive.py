"""Deceptive pairs: what they are, and that the default matcher is hardly ever sure of a wrong pose there."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan.errors import InvalidArgumentError
from deceptive import DECEPTIONS, deceptive_pairs, is_right, score_deception

# people who keep pace look at rest: docs/design-notes/confidence.md
DECEIVED = ("company",)

# of 30 pairs of one seed, as measured; of others none. The shares of more pairs: docs/design-notes/confidence.md
MOST_DECEIVED = {
    "turned away, office": 1,
    "turned away, doors": 7,
    "small room": 2,
    "pillars, 180 deg": 2,
    "pillars, 360 deg": 2,  # 27 of 1,050 of other seeds, before circles began at their longest surface and since
    "shelves": 1,
    "elevator, 180 deg": 1,
}


def test_a_pair_is_the_same_whatever_their_number():
    few = list(deceptive_pairs("shelves", n_pairs=2, seed=4))
    more = list(deceptive_pairs("shelves", n_pairs=3, seed=4))
    for a, b in zip(few, more, strict=False):
        np.testing.assert_array_equal(a.reference.ranges, b.reference.ranges)
        np.testing.assert_array_equal(a.current.ranges, b.current.ranges)
        np.testing.assert_array_equal(a.pose, b.pose)
    other = next(deceptive_pairs("shelves", n_pairs=1, seed=5))
    assert not np.array_equal(few[0].reference.ranges, other.reference.ranges)


def test_an_unknown_name_is_refused_with_the_nearest():
    with pytest.raises(InvalidArgumentError, match="did you mean 'shelves'"):
        next(deceptive_pairs("shelfs"))


def test_what_shares_nothing_has_no_true_pose():
    assert next(deceptive_pairs("another room, 180 deg", n_pairs=1)).pose is None
    assert next(deceptive_pairs("turned away, office", n_pairs=1)).pose is None
    guessed = next(deceptive_pairs("empty room, guessed", n_pairs=1))
    np.testing.assert_array_equal(guessed.guess, guessed.pose)


def test_people_who_keep_pace_stand_still_in_the_robots_frame():
    pair = next(deceptive_pairs("company", n_pairs=1, seed=2))
    assert pair.pose[0] > 0.25
    # both scans show them where they were
    both = pair.reference.valid & pair.current.valid
    apart = np.abs(pair.reference.ranges[both] - pair.current.ranges[both])
    assert np.median(apart) < 0.03


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in DECEPTIONS if name not in DECEIVED])
def test_the_matcher_is_hardly_ever_sure_and_wrong(name):
    score = score_deception(name, n_pairs=30, seed=77)
    # without confidence it is 3 (doors) to 30 (shelves) of 30
    assert round(30 * score.sure_and_wrong) <= MOST_DECEIVED.get(name, 0)


@pytest.mark.slow
def test_people_who_keep_pace_deceive_a_third_of_the_pairs_and_no_more():
    score = score_deception("company", n_pairs=30, seed=77)
    assert score.sure_and_wrong < 0.34
    assert score.right + score.flagged_and_wrong > 0.5


def test_right_is_near_the_truth_and_nothing_where_nothing_is_shared():
    true = np.array([1.0, 2.0, 3.1])
    assert is_right(np.array([1.05, 2.0, -3.17]), true)  # across the seam
    assert not is_right(np.array([1.2, 2.0, 3.1]), true)
    assert not is_right(np.array([1.0, 2.0, 3.0]), true)
    assert not is_right(true, None)


def test_the_shares_of_a_world_sum_to_one():
    score = score_deception("identical offices", n_pairs=3)
    assert (score.world, score.n_pairs) == ("identical offices", 3)
    assert score.right == 1.0
    assert score.unmatched == pytest.approx(0.0)
    assert score_deception("another room, 360 deg", n_pairs=3).unmatched == 1.0
