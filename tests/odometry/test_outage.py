"""Outages: what raises the doubt whether a sensor was carried away, and what ends it."""

from __future__ import annotations

import pytest

from curvescan.odometry.outage import Outage, evidence


def after(*confidences, is_broken=True, nearness=1.0):
    outage = Outage((), 5, is_broken=is_broken)
    for confidence in confidences:
        outage = outage.after(confidence, nearness)
    return outage


def test_scans_that_match_nothing_known_add_up_to_a_loss():
    assert after(0.0, 0.0, 0.0).log_odds < 0.0 < after(0.0, 0.0, 0.0, 0.0).log_odds


def test_a_sure_match_takes_back_what_a_failure_said():
    assert after(0.0, 0.99).is_over
    assert not after(0.0, 0.0, 0.99).is_over


def test_doubtful_matches_of_one_place_do_not_add_up():
    """They err together: any number of them says what one says."""
    assert after(*[0.6] * 50, is_broken=False).log_odds <= after(0.6, is_broken=False).log_odds


def test_what_is_far_from_the_place_need_not_see_it():
    assert after(*[0.0] * 50, nearness=0.0).log_odds <= after(0.0).log_odds


@pytest.mark.parametrize("is_new", [False, True])
def test_the_surer_a_match_the_less_it_speaks_for_a_loss(is_new):
    told = [evidence(confidence, is_new=is_new) for confidence in (0.0, 0.2, 0.6, 0.9, 0.99)]
    assert told == sorted(told, reverse=True)
    assert told[-1] < 0.0 < told[0]
