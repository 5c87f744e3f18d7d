"""Disputes: how many places must ask for one correction of the chain."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan import se2
from curvescan.odometry import KeyframesConfig
from curvescan.odometry.disputes import Dispute, is_settled, remembered

CONFIG = KeyframesConfig()
DRIFT = np.array([0.9, -0.7, 0.08])


def dispute(x, drift=DRIFT):
    """A scan x metres along a straight way, and where earlier keyframes have it."""
    by_chain = np.array([x, 0.0, 0.0])
    return Dispute(by_chain, se2.compose(drift, by_chain))


def test_three_places_that_ask_for_one_correction_settle_it():
    assert CONFIG.min_disputes == 3
    one, two, three = (dispute(x) for x in (0.0, 1.0, 2.0))
    assert not is_settled(one, (), CONFIG)
    assert not is_settled(two, (one,), CONFIG)
    assert is_settled(three, (one, two), CONFIG)


@pytest.mark.parametrize("off", [(0.5, 0.0, 0.0), (0.0, 0.0, 0.1)])
def test_corrections_that_differ_do_not_add_up(off):
    other = dispute(0.0, DRIFT + off)
    assert not is_settled(dispute(2.0), (other, dispute(1.0)), CONFIG)


def test_one_place_counts_once_however_long_the_sensor_stands_there():
    held: tuple[Dispute, ...] = ()
    for k in range(10):
        assert not is_settled(dispute(0.01 * k), held, CONFIG)
        held = remembered(dispute(0.01 * k), held, CONFIG)
    assert len(held) == 1


def test_memory_is_bounded():
    held: tuple[Dispute, ...] = ()
    for k in range(100):
        held = remembered(dispute(1.0 * k), held, CONFIG)
    assert len(held) == 8
    np.testing.assert_array_equal(held[-1].by_chain, [99.0, 0.0, 0.0])


@pytest.mark.parametrize(
    ("off", "is_one"), [((0.25, 0, 0), True), ((0.35, 0, 0), False), ((0, 0, 0.05), True), ((0, 0, 0.07), False)]
)
def test_two_ask_for_one_correction_within_30_cm_and_3_deg(off, is_one):
    here = np.array([2.0, 0.0, 0.0])
    last = Dispute(here, se2.compose(se2.compose(DRIFT, here), np.array(off)))
    assert is_settled(last, (dispute(0.0), dispute(1.0)), CONFIG) == is_one


@pytest.mark.parametrize(("share", "is_elsewhere"), [(0.45, False), (0.55, True)])
def test_half_the_way_to_a_new_keyframe_is_another_place(share, is_elsewhere):
    config = KeyframesConfig(distance=2.0, turn=0.8)
    for moved in (np.array([share * 2.0, 0.0, 0.0]), np.array([0.0, 0.0, share * 0.8])):
        other = Dispute(moved, se2.compose(DRIFT, moved))
        assert len(remembered(other, (dispute(0.0),), config)) == 1 + is_elsewhere
