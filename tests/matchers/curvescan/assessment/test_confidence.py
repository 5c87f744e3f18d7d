"""Confidence: what speaks for a pose and against it, and what another pose explains."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.assessment.confidence import (
    COEFFICIENTS,
    MAX_REPETITION,
    ScoredPoses,
    Support,
    is_hopeless,
    support_of,
    terms_of,
)
from curvescan.matchers.curvescan.assessment.confidence import regular_rows as rows_of
from curvescan.matchers.curvescan.assessment.evidence import (
    AGREEING,
    BEYOND,
    EXCESS,
    MISFIT,
    N_EVIDENCE,
    SEEN_THROUGH,
    SMALL,
    WEAKEST,
)
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.prior import WIDE, Prior
from curvescan.matchers.result import prior_of
from tests.matchers.curvescan.scenes import MOTION, pair, weigh
from tests.reference import curvescan as slow

CONFIG = CurvescanConfig()
GOOD = {AGREEING: 8.0, EXCESS: 2.0, WEAKEST: 2.0, MISFIT: 0.8}


def poses(*evidences, priors=None):
    rows = np.zeros((len(evidences), N_EVIDENCE))
    for row, evidence in zip(rows, evidences, strict=True):
        for column, value in evidence.items():
            row[column] = value
    n = len(evidences)
    return ScoredPoses(
        poses=np.arange(3.0 * n).reshape(n, 3),
        scores=np.full(n, 0.5),
        evidence=rows,
        priors=np.zeros(n) if priors is None else np.array(priors),
        wide_priors=np.zeros(n) if priors is None else np.minimum(priors, 0.0),
    )


def terms(scored):
    """What the model weighs of the first pose, by the names of its coefficients."""
    return dict(zip(COEFFICIENTS, terms_of(scored.evidence, scored.priors, scored.wide_priors)[0], strict=True))


def test_what_is_weighed_is_that_of_the_slow_twin():
    rng = np.random.default_rng(5)
    evidence = rng.gamma(0.5, 2.0, (40, N_EVIDENCE)) - 0.02  # some a little below 0, by rounding say
    priors, wide = rng.uniform(-5.0, 3.0, 40), rng.uniform(-2.0, 0.0, 40)
    terms = terms_of(evidence, priors, wide)
    for k in range(40):
        expected = slow.confidence_terms(evidence[k], priors[k], wide[k])
        assert list(expected) == list(COEFFICIENTS)
        np.testing.assert_allclose(terms[k], list(expected.values()), rtol=1e-12, atol=1e-12)
    assert terms_of(evidence[:0], priors[:0], wide[:0]).shape == (0, len(COEFFICIENTS))


@pytest.mark.parametrize(
    ("column", "better", "worse"),
    [(AGREEING, 9.0, 3.0), (WEAKEST, 3.0, 0.1), (MISFIT, 0.8, 3.0), (SEEN_THROUGH, 0.0, 1.0)],
)
def test_each_evidence_moves_the_confidence_the_way_it_should(column, better, worse):
    low, high = (support_of(poses({**GOOD, column: value}), []).probabilities()[0] for value in (worse, better))
    assert 0.0 < low < high < 1.0


def test_a_prior_speaks_for_a_pose():
    def confidence(**kwargs):
        return support_of(poses(GOOD, **kwargs), []).probabilities()[0]

    assert confidence(priors=[-3.0]) < confidence() < confidence(priors=[2.0])
    assert set(terms(poses(GOOD))) == set(COEFFICIENTS)


def test_the_log_odds_are_those_of_the_model():
    """As docs/design-notes/confidence.md has it, here by hand."""
    evidence = {EXCESS: 0.9, AGREEING: 9.9, WEAKEST: 0.9, MISFIT: 0.9, SEEN_THROUGH: 9.0}
    found = poses(evidence, priors=[-1.5])
    expected = {
        "constant": 1.0,
        "log10_agreeing": 1.0,
        "log10_weakest": 0.0,
        "log10_misfit": 0.0,
        "log10_seen_through": 0.0,  # nine tenths of 10 m, and the 0.1
        "prior": -1.5,
        "few_prior": -0.75,  # of 2 m that are enough there are 0.9, and the 0.1 added to all
    }
    assert terms(found) == pytest.approx(expected, abs=1e-12)
    total = sum(COEFFICIENTS[name] * value for name, value in expected.items())
    assert found.log_odds(0) == pytest.approx(total)
    # three tenths of what the prior weighs are left where poses are compared
    assert found.rank(0) == pytest.approx(total + 0.7 * (1.5 + 0.75 * COEFFICIENTS["few_prior"]))
    told = terms(poses(evidence, priors=[2.0]))
    assert told["prior"] == 2.0
    assert told["few_prior"] == 0.0  # few walls are none the better for being expected
    assert terms(poses({**evidence, EXCESS: 3.0}, priors=[-4.0]))["few_prior"] == 0.0
    nothing = terms(poses({}, priors=[-4.0]))
    assert nothing["log10_seen_through"] == pytest.approx(-1.0)
    assert nothing["few_prior"] == pytest.approx(-4.0 * 0.95)


def test_each_pose_has_its_share_of_the_odds():
    found = poses(GOOD, {**GOOD, MISFIT: 2.0}, {**GOOD, SEEN_THROUGH: 0.4}, priors=[-1.0, -1.5, 0.0])
    support = support_of(found, [1, 2])
    odds = np.exp([found.log_odds(k) for k in range(3)])
    odds[2] *= np.exp(-1.0)  # to be expected more alone makes no rival
    accept, unsupported = support.probabilities()
    assert accept == pytest.approx(odds[0] / (1.0 + odds.sum()))
    assert 1.0 - accept - unsupported == pytest.approx(odds[1:].sum() / (1.0 + odds.sum()))
    assert unsupported == pytest.approx(1.0 / (1.0 + odds.sum()))
    # what the covariance holds is right as well
    assert support.probabilities([2])[0] == pytest.approx(odds[[0, 2]].sum() / (1.0 + odds.sum()))


def test_a_repetition_is_the_mean_of_two_shares_less_what_contradicts():
    """The excess 0.75 of 2 m with half a metre more each is half, the weakest 0.25 of 2.5 a quarter."""
    best = {**GOOD, EXCESS: 2.0, WEAKEST: 2.5}
    other = {**best, EXCESS: 0.75, WEAKEST: 0.25}
    share = np.sqrt(0.5 * 0.25)
    assert poses(best, other).repetition(1) == pytest.approx(share)
    # 15 % of the 8 m that agree there is what explains nothing any more; half of it leaves half
    for column in (SEEN_THROUGH, SMALL):
        assert poses(best, {**other, column: 0.6}).repetition(1) == pytest.approx(0.5 * share)
        # what contradicts the best as well says nothing
        both = poses({**best, column: 0.3}, {**other, column: 0.9})
        assert both.repetition(1) == pytest.approx(0.5 * share)


def test_a_rival_fades_where_the_prior_has_it_less_and_on_two_walls_faster():
    many, two = {**GOOD, EXCESS: 2.0}, {**GOOD, EXCESS: 0.9}
    for evidence, weight in ((many, 1.0), (two, 1.0 + 0.5 * COEFFICIENTS["few_prior"])):
        found = poses(evidence, evidence, priors=[0.0, -2.0])
        assert found.fading(1) == pytest.approx(np.exp(-0.3 * 2.0 * weight))
        assert poses(evidence, evidence, priors=[-2.0, 0.0]).fading(1) == 1.0
    far = support_of(poses(many, many, priors=[2.0, -4.0]), [1])
    assert far.repeated == []
    assert far.is_by_prior
    assert not support_of(poses(many, many), [1]).is_by_prior


def test_a_pose_that_explains_as_much_repeats_and_one_that_is_contradicted_does_not():
    as_good, less = dict(GOOD), {**GOOD, EXCESS: 0.0, WEAKEST: 0.1}
    seen_through = {**GOOD, SEEN_THROUGH: 1.5}
    found = poses(GOOD, as_good, less, seen_through)
    assert found.repetition(1) == pytest.approx(1.0)
    assert found.repetition(2) < MAX_REPETITION
    assert found.repetition(3) == 0.0
    support = support_of(found, [1, 2, 3])
    assert support.repeated == [1]
    alone = support_of(found, [])
    assert support.probabilities()[0] < alone.probabilities()[0]
    # rows that the covariance holds speak for the first
    first, one, all_held = (support.probabilities(held)[0] for held in ((), (1,), (1, 2, 3)))
    assert first < one < all_held


def test_a_contradicted_pose_rules_out_none_that_explains_more():
    wrong = {**GOOD, SEEN_THROUGH: 1.0}
    more = {**GOOD, AGREEING: 9.0, MISFIT: 0.6, SEEN_THROUGH: 3.0}
    found = replace(poses(wrong, more), scores=np.array([0.4, 0.5]))
    assert found.repetition(1) == 1.0
    # not where it is contradicted alone, nor where less agrees, or worse, or in fewer readings
    assert poses(wrong, more).repetition(1) == 0.0
    for best, other in ((GOOD, more), (wrong, {**more, AGREEING: 7.0}), (wrong, {**more, MISFIT: 0.9})):
        assert replace(poses(best, other), scores=np.array([0.4, 0.5])).repetition(1) == 0.0


def test_a_bare_room_may_be_turned_where_the_motion_is_large_or_a_wall_contradicts():
    assert not poses({**GOOD, BEYOND: 0.0}).may_be_turned
    assert poses({**GOOD, BEYOND: 0.0}, priors=[-0.3]).may_be_turned
    walls = {**GOOD, BEYOND: 0.0, EXCESS: 1.9}
    assert poses({**walls, SEEN_THROUGH: 1.0}).may_be_turned
    assert not poses({**GOOD, BEYOND: 1.0, SEEN_THROUGH: 1.0}, priors=[-0.3]).may_be_turned
    # log odds of -0.25 by the prior, a tenth of what agrees, 0.2 m beyond four walls
    assert not poses({**GOOD, BEYOND: 0.0}, priors=[-0.24]).may_be_turned
    assert poses({**GOOD, BEYOND: 0.19}, priors=[-0.26]).may_be_turned
    assert not poses({**GOOD, BEYOND: 0.21}, priors=[-0.26]).may_be_turned
    assert not poses({**walls, SEEN_THROUGH: 0.79}).may_be_turned
    assert poses({**walls, SEEN_THROUGH: 0.81}).may_be_turned
    # a guess decides
    assert not poses({**walls, SEEN_THROUGH: 1.0}, priors=[2.1]).may_be_turned
    # a long third wall, and something that changed
    assert not poses({**GOOD, BEYOND: 0.0, EXCESS: 2.1, SEEN_THROUGH: 1.0}).may_be_turned
    assert not poses().may_be_turned


def hopeless(*evidences):
    scored = poses(*evidences)
    return is_hopeless(scored.evidence, scored.priors, scored.wide_priors)


def test_a_pair_is_hopeless_where_no_pose_comes_near():
    """Log odds of all poses below -2: not even one in seven is right, and no pair turned away so would match."""
    bad = {AGREEING: 2.0, MISFIT: 2.0, SEEN_THROUGH: 2.0}
    assert poses(bad).log_odds(0) < -2.0 < poses(GOOD).log_odds(0)
    assert hopeless(bad, bad)
    assert not hopeless(bad, GOOD)  # whichever stands first
    doubtful = {AGREEING: 6.0, MISFIT: 1.0, SEEN_THROUGH: 0.4}
    assert -2.0 < poses(doubtful).log_odds(0) < 0.0
    assert not hopeless(doubtful)


def test_surfaces_run_one_way_where_an_eighth_of_them_runs_across():
    corridor, room = {AGREEING: 10.0, WEAKEST: 1.1}, {AGREEING: 10.0, WEAKEST: 1.3}
    assert poses(corridor, room).is_along_walls  # that of the first
    assert not poses(room, corridor).is_along_walls
    assert not poses(corridor, priors=[2.1]).is_along_walls  # a guess says where along it


def test_a_room_with_pillars_is_explained_by_its_pose_alone():
    ref, cur = pair()
    turned = MOTION + np.array([0.0, 0.0, np.pi / 2])
    found = weigh(ref, cur, WIDE, np.array([turned, MOTION]), [0.1, 0.9])
    np.testing.assert_array_equal(found.poses, [MOTION, turned])  # the likeliest first
    np.testing.assert_array_equal(found.scores, [0.9, 0.1])
    support = support_of(found, [1])
    assert support.probabilities()[0] > 0.97
    assert not support.repeated
    assert found.repetition(1) < 0.2


def test_the_prior_weighs_by_its_covariance():
    ref, cur = pair()

    def scored(off, scale):
        prior = Prior.of(prior_of(None, MOTION + off)._replace(covariance=scale * prior_of(None, MOTION).covariance))
        return weigh(ref, cur, prior, MOTION[np.newaxis], [0.9])

    near = [scored(0.0, scale) for scale in (0.1, 1.0, 10.0)]
    assert near[0].log_odds(0) > near[1].log_odds(0) > near[2].log_odds(0)
    assert near[1].is_told(0)
    far = [scored(1.0, scale) for scale in (0.1, 1.0, 10.0)]
    assert far[0].log_odds(0) <= far[1].log_odds(0) < far[2].log_odds(0)
    assert not far[1].is_told(0)


def test_a_result_tells_how_sure_it_is():
    log = cs.simulate("office", n_scans=4, seed=2)
    result = cs.match(log[0], log[1])
    assert result.ok
    assert 0.9 < result.confidence <= 1.0
    assert not result.is_guess_decisive
    empty = cs.LaserScan(np.full(361, np.inf), angle_min=-1.57, angle_increment=0.0087)
    assert cs.match(log[0], empty).confidence == 0.0
    assert np.isnan(cs.match(log[0], log[1], method="icp").confidence)


def regular_rows(poses, shares):
    n = len(poses)
    return rows_of(ScoredPoses(poses, np.zeros(n), np.zeros((n, N_EVIDENCE)), np.zeros(n), np.zeros(n)), shares)


def test_two_poses_to_either_side_make_a_row_of_equal_things():
    shares = {1: 0.4, 2: 0.4}
    row = np.array([[0.1, 0.2, 0.3], [1.3, 0.2, 0.3], [-1.0, 0.2, 0.3]])
    assert regular_rows(row, shares) == (1, 2)
    for k, change in ((2, [0.5, 0.0, 0.0]), (2, [0.0, 0.5, 0.0]), (1, [0.0, 0.0, 0.2])):
        other = row.copy()
        other[k] += change
        assert regular_rows(other, shares) == ()
    assert regular_rows(row * [0.3, 1.0, 1.0], shares) == ()  # too near to be another thing
    assert regular_rows(row, {1: 0.4, 2: 0.2}) == ()


def test_probabilities_are_shares_of_all_odds():
    support = Support(log_odds=1.0, competing={1: 0.0, 2: -1.0}, repeated=[])
    accept, unsupported = support.probabilities()
    assert unsupported == pytest.approx(accept * np.exp(-1.0))
    assert 1.0 - accept - unsupported == pytest.approx(accept * (np.exp(0.0) + np.exp(-1.0)))
    held, unsupported = support.probabilities([1, 2])
    assert held == pytest.approx(1.0 - unsupported)
