"""Search: which poses come into question."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

import curvescan as cs
from curvescan.matchers.curvescan import matcher
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.matcher import CurvescanMatcher
from curvescan.matchers.curvescan.prior import WIDE, Prior
from curvescan.matchers.curvescan.proposal import search as rules
from curvescan.matchers.curvescan.proposal.search import NOTHING, Problem, effort_of, refine_guess, searched
from curvescan.matchers.result import Outcome, prior_of
from tests.matchers.curvescan.scenes import MOTION, features, hall_scan, pair

CONFIG = CurvescanConfig()


def prior_at(guess):
    return Prior.of(prior_of(None, guess))


def search(ref, cur, prior, config, **effort):
    return searched(Problem(ref, cur, prior, config, effort_of(config)._replace(**effort)), NOTHING)


def off(pose):
    error = cs.se2.between(MOTION, pose)
    return max(np.hypot(*error[:2]), abs(error[2]))


def test_the_best_candidate_is_near_the_truth():
    for seed in range(5):
        ref, cur = pair(seed)
        found = search(ref, cur, WIDE, CONFIG)
        assert off(found.poses[0]) < 0.01
        assert (np.diff(found.scores) <= 0).all()
        assert len(found.poses) == len(found.scores)


def test_walls_are_laid_on_each_other_once_more_where_the_turn_found_was_not_tried():
    ref, cur = pair()
    # all directions are those of the current scan, a tenth of a radian off
    cur.landmarks = cur.landmarks._replace(directions=np.roll(cur.landmarks.directions, 2))
    found = search(ref, cur, WIDE, CONFIG)
    assert off(found.poses[0]) < 0.01
    expected = search(ref, cur, prior_at(np.add(MOTION, [0.03, 0.0, 0.03])), CONFIG)
    assert off(expected.poses[0]) < 0.01
    assert expected.n_tried < found.n_tried


def test_walls_are_laid_on_each_other_once_more_where_little_agrees():
    ref, cur = pair()
    assert search(ref, cur, WIDE, CONFIG, doubtful_score=1.0).n_tried > search(ref, cur, WIDE, CONFIG).n_tried


def test_where_nothing_agrees_turns_beside_the_likeliest_are_tried():
    ref, cur = pair()
    # all directions are those of the current scan, a tenth of a radian off
    off_by = cs.se2.wrap(MOTION[2] + 0.1)
    turned = rules.turns_beside(np.array([0.3, 0.2, off_by]))
    np.testing.assert_allclose(turned[:, :2], [[0.3, 0.2]] * 4)
    np.testing.assert_allclose(turned[:, 2] - off_by, [-0.2, -0.1, 0.1, 0.2])
    wrong = np.roll(cur.landmarks.directions, 2)  # of 3 degrees
    marks = cur.landmarks._replace(directions=wrong)
    found = rules.search(ref.image, cur.image, ref.landmarks, marks, WIDE.pose, effort_of(CONFIG))
    assert off(found[0][0]) < 0.01


def test_what_scores_next_to_nothing_is_no_candidate():
    for seed in range(3):
        found = search(pair()[0], pair(seed + 7, motion=np.array([0.9, 0.4, 2.5]))[1], WIDE, CONFIG)
        assert (found.scores > 0.1).all()


def matched(ref, cur, guess):
    return CurvescanMatcher(CONFIG).match(ref, cur, prior_of(None, guess))


def test_a_search_is_made_only_where_the_prior_is_wrong():
    ref, cur = pair()
    followed = matched(ref, cur, MOTION + 0.03)
    assert followed.trace.candidates.n_tried == 1
    assert off(followed.pose) < 0.01
    assert not {"landmarks"} & (vars(ref).keys() | vars(cur).keys())  # which nothing needs
    found = matched(ref, cur, MOTION + np.array([0.8, 0.5, 1.0]))
    assert found.trace.candidates.n_tried > 10
    assert off(found.pose) < 0.01


def test_a_prior_is_followed_along_a_corridor():
    ref, cur = features(hall_scan(0.0, seed=1)), features(hall_scan(0.4, seed=2))
    followed = matched(ref, cur, np.array([0.4, 0.0, 0.0]))
    assert followed.trace.candidates.n_tried == 1
    assert followed.degenerate_direction is not None


def test_where_the_scans_do_not_match_at_a_likely_prior_a_search_is_made(monkeypatch):
    ref, cur = pair()
    refused = []

    def judged(problem, candidates):
        result = judge(problem, candidates)
        refused.append(len(refused) == 0)
        return replace(result, outcome=Outcome.UNSUPPORTED) if refused[-1] else result

    judge = matcher.judged
    monkeypatch.setattr(matcher, "judged", judged)
    found = matched(ref, cur, MOTION + 0.03)
    assert refused == [True, False]
    assert off(found.pose) < 0.01


def test_a_prior_that_is_not_followed_is_one_more_candidate():
    ref, cur = pair()
    guess = MOTION + np.array([0.0, 0.6, 0.0])
    problem = Problem(ref, cur, prior_at(guess), CONFIG, effort_of(CONFIG))
    near, _ = refine_guess(ref.image, cur.image, problem.prior, problem.effort)
    alone = search(ref, cur, prior_at(guess), CONFIG)
    found = searched(problem, near)
    assert len(found.poses) >= len(alone.poses)
    assert off(found.poses[0]) < 0.01
