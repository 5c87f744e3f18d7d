"""The polar view: from a point to the reading in its direction."""

from __future__ import annotations

import math

import numpy as np
import pytest

import curvescan as cs
from curvescan.consensus.polar import polar_lookup, reading_at
from tests.consensus_scenes import features
from tests.reference import consensus as slow


def ring(n_beams, increment, angle_min, missing=()):
    ranges = np.full(n_beams, 2.0)
    ranges[list(missing)] = np.nan
    return cs.LaserScan(ranges, angle_min=angle_min, angle_increment=increment, range_max=9.0)


@pytest.mark.parametrize("angle_min", [-math.pi / 2, -math.pi, 0.0, 2.5, 7.0])
@pytest.mark.parametrize("increment_deg", [1.0, -1.0, 0.5])
@pytest.mark.parametrize("n_beams", [181, 359, 360])
def test_the_reading_is_that_of_the_nearest_beam(angle_min, increment_deg, n_beams):
    scan = ring(n_beams, math.radians(increment_deg), angle_min, missing=(5, 6, 90))
    one = features(scan)
    by_beam = np.full(n_beams, -1)
    by_beam[one.beam_idx] = np.arange(len(one.beam_idx))
    rng = np.random.default_rng(0)
    n_told = 0
    for _ in range(300):
        angle = rng.uniform(-math.pi, math.pi)
        point = 3.0 * np.array([math.cos(angle), math.sin(angle)])
        off = np.abs(cs.se2.wrap(angle - scan.angles))
        edge = abs(off.min() - 0.5 * abs(scan.angle_increment)) < 1e-4
        if edge or (n_beams == 359 and off.min() > 0.008):
            continue  # halfway between two beams: either is right
        expected = slow.reading_at(point, scan.angles, by_beam)
        assert reading_at(*point, one.view) == expected
        n_told += 1
    assert n_told > 100


def test_a_full_circle_of_one_beam_too_many_or_too_few_closes():
    for n_beams in (359, 360, 361):
        one = features(ring(n_beams, math.radians(1.0), -math.pi))
        assert reading_at(-2.0, 1e-3, one.view) >= 0
        assert reading_at(-2.0, -1e-3, one.view) >= 0
        assert (one.view.lookup >= 0).all()


def test_a_half_circle_sees_nothing_behind():
    one = features(ring(181, math.radians(1.0), -math.pi / 2, missing=(90,)))
    assert reading_at(-1.0, 0.2, one.view) == -2
    assert reading_at(1.0, 0.0, one.view) == -1


def test_slots_run_counter_clockwise_whatever_way_the_sensor_turns():
    assert polar_lookup(np.array([0, 2]), 3, 4, False, False).tolist() == [0, -1, 1, -2]
    assert polar_lookup(np.array([2, 0]), 3, 4, True, False).tolist() == [0, -1, 1, -2]
    assert polar_lookup(np.array([0, 1]), 2, 3, False, True).tolist() == [0, 1, 0]
    assert polar_lookup(np.array([0, 1, 2]), 3, 2, False, True).tolist() == [0, 1]


@pytest.mark.parametrize("increment", [1e-9, 1e-3, 3.0, 30.0])
def test_odd_increments_cost_no_memory_and_raise_nothing(increment):
    scan = cs.LaserScan(np.ones(50), angle_min=0.3, angle_increment=increment)
    one = features(scan)
    assert one.view.lookup.size <= 6300
    assert reading_at(1.0, 1.0, one.view) >= -2
