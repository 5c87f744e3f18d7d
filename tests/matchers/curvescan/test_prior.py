"""The prior: how its covariance decides, and what of a match does not depend on it."""

from __future__ import annotations

import math

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.prior import TOLD, WIDE, Prior, log_odds
from curvescan.matchers.result import GUESS_SIGMA, WIDE_PRIOR, WIDE_SIGMA, prior_of
from tests.matchers.curvescan.scenes import MOTION, pillar_scan

PITCH = 2.4
"""Metres from door to door."""


def corridor_scan(x, seed):
    """A full circle in a corridor 2 m wide, with niches 1.2 m wide and 0.6 m deep on both sides, 8 m in sight."""
    angles = np.radians(np.arange(-179.75, 180.0, 0.5))
    c, s = np.cos(angles), np.sin(angles)
    wall = 1.0 / np.abs(s)
    at = np.mod(x + wall * c, PITCH)
    back, side = 1.6 * wall, wall + np.where(c > 0.0, 1.2 - at, at) / np.abs(c)
    ranges = np.where(at < 1.2, np.minimum(back, side), wall)
    ranges = ranges + np.random.default_rng(seed).normal(0.0, 0.005, angles.size)
    ranges[ranges > 8.0] = np.nan
    return cs.LaserScan(ranges, angle_min=angles[0], angle_increment=math.radians(0.5), range_max=8.0)


def prior(pose, scale=1.0, sigma=GUESS_SIGMA):
    return cs.UncertainPose(np.array(pose, dtype=np.float64), scale * np.diag(np.square(sigma)))


def doors():
    return cs.prepare(corridor_scan(0.3, 1)), cs.prepare(corridor_scan(0.6, 2)), np.array([0.3, 0.0, 0.0])


def test_nothing_known_is_the_wide_prior_to_the_bit():
    ref, cur = cs.prepare(pillar_scan(seed=1)), cs.prepare(pillar_scan(MOTION, seed=2))
    plain, wide = cs.match(ref, cur), cs.match(ref, cur, prior=WIDE_PRIOR)
    np.testing.assert_array_equal(plain.pose, wide.pose)
    assert plain.confidence == wide.confidence


def test_a_guess_is_the_prior_of_its_documented_width():
    ref, cur = cs.prepare(pillar_scan(seed=1)), cs.prepare(pillar_scan(MOTION, seed=2))
    guess = MOTION + 0.1
    short, long = cs.match(ref, cur, guess=guess), cs.match(ref, cur, prior=prior(guess))
    np.testing.assert_array_equal(short.pose, long.pose)
    assert short.confidence == long.confidence


def test_log_odds_are_those_of_the_densities():
    """By hand: 0 at the best of the wide prior; one prior in twenty is wrong, and gains by how narrow it is."""
    assert log_odds(np.zeros((1, 3)), WIDE)[0][0] == 0.0
    off = np.array([[1.0, -2.0, 0.5]])
    chi2 = float(np.sum((off / WIDE_SIGMA) ** 2))
    assert log_odds(off, WIDE)[0][0] == pytest.approx(-0.5 * chi2)
    turned = off + np.array([0.0, 0.0, 2.0 * math.pi])
    assert log_odds(turned, WIDE)[0][0] == pytest.approx(log_odds(off, WIDE)[0][0])
    guess = Prior.of(prior_of(None, [1.0, 2.0, 0.1]))
    variances = np.square(GUESS_SIGMA) + np.square([0.05, 0.05, 0.025])
    narrower = math.prod(WIDE_SIGMA) / math.sqrt(math.prod(variances))
    gain = 1.0 / (0.05 + 1.0 / (narrower - 1.0))
    assert log_odds(np.array([[1.0, 2.0, 0.1]]), guess)[0][0] == pytest.approx(math.log(gain + 1.0))
    beside = math.log(gain * math.exp(-0.5 * 0.09 / variances[0]) + math.exp(-0.5 * 0.09 / 4.0))
    assert log_odds(np.array([[1.3, 2.0, 0.1]]), guess)[0][0] == pytest.approx(beside)
    # it is wrong, and then the wide one holds, three standard deviations at most
    assert log_odds(np.array([[9.0, 9.0, 3.0]]), guess)[0][0] == pytest.approx(-4.5)


def test_a_prior_says_where_a_pose_is_if_it_is_narrow_and_about_there():
    assert not WIDE.is_told
    guess = Prior.of(prior_of(None, [1.0, 0.0, 0.0]))
    assert guess.is_told
    told = log_odds(np.array([[1.3, 0.0, 0.0], [1.6, 0.0, 0.0], [1.0, 0.0, 0.4]]), guess)[0] > TOLD
    assert told.tolist() == [True, False, False]


def test_repeated_doors_are_ambiguous_until_a_tight_prior_says_which():
    ref, cur, true = doors()
    assert cs.match(ref, cur).outcome is cs.Outcome.AMBIGUOUS
    for off in (0.0, 0.1):
        told = cs.match(ref, cur, prior=prior([0.3 + off, 0.0, 0.0]))
        assert told.ok
        assert told.confidence > 0.9
        np.testing.assert_allclose(told.pose, true, atol=0.03)
    other = true - np.array([PITCH, 0.0, 0.0])
    elsewhere = cs.match(ref, cur, prior=prior(other))
    assert not elsewhere.ok or np.abs(elsewhere.pose - other).max() < 0.05


def test_a_tight_wrong_prior_loses_against_strong_evidence_and_costs_confidence():
    ref, cur = cs.prepare(pillar_scan(seed=1)), cs.prepare(pillar_scan(MOTION, seed=2))
    plain = cs.match(ref, cur)
    wrong = cs.match(ref, cur, prior=prior(MOTION + np.array([1.0, -0.5, 0.3]), sigma=(0.05, 0.05, 0.02)))
    assert wrong.ok
    np.testing.assert_allclose(wrong.pose, plain.pose, atol=1e-3)
    assert wrong.confidence < plain.confidence


def test_a_right_prior_is_worth_the_more_the_narrower_it_is_and_a_wrong_one_costs():
    ref, cur = cs.prepare(pillar_scan(seed=1)), cs.prepare(pillar_scan(MOTION, seed=2))

    def said(off, widest):
        priors = (prior(MOTION + np.array([off, 0.0, 0.0]), scale) for scale in np.geomspace(0.02, widest, 9))
        return [cs.match(ref, cur, prior=one).confidence for one in priors]

    steps = np.diff(said(0.0, 30.0))
    assert (steps < 1e-9).all()
    assert steps.min() < -1e-4
    assert max(said(1.2, 0.5)) < cs.match(ref, cur).confidence - 0.001


def test_information_is_of_the_scans_alone():
    ref, cur = cs.prepare(pillar_scan(seed=1)), cs.prepare(pillar_scan(MOTION, seed=2))
    plain = cs.match(ref, cur)
    for scale in (0.01, 1.0, 40.0):
        told = cs.match(ref, cur, prior=prior(MOTION + 0.02, scale))
        np.testing.assert_allclose(told.information, plain.information, rtol=0.02, atol=1e-3 * plain.information.max())
