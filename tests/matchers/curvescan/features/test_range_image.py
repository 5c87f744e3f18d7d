"""The range image: from a point to the reading in its direction, and samples spread over the surfaces."""

from __future__ import annotations

import math

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.features.range_image import azimuth_table, bearing, choose_samples, reading_at
from curvescan.matchers.curvescan.features.surfels import N_COLUMNS
from tests.matchers.curvescan.scenes import features, pillar_scan
from tests.reference import curvescan as slow


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
        assert reading_at(*point, one.image) == expected
        n_told += 1
    assert n_told > 100


def test_a_bearing_is_the_arc_tangent():
    angles = np.linspace(-math.pi, math.pi, 5001)
    for radius in (1e-9, 1.0, 1e9):
        found = [bearing(radius * math.cos(a), radius * math.sin(a)) for a in angles.tolist()]
        errors = np.abs(cs.se2.wrap(np.array(found) - angles))
        assert errors.max() < 1.5e-8
    assert bearing(0.0, 0.0) == 0.0


def test_a_full_circle_of_one_beam_too_many_or_too_few_closes():
    for n_beams in (359, 360, 361):
        one = features(ring(n_beams, math.radians(1.0), -math.pi))
        assert reading_at(-2.0, 1e-3, one.image) >= 0
        assert reading_at(-2.0, -1e-3, one.image) >= 0
        assert (one.image.table >= 0).all()


def test_a_half_circle_sees_nothing_behind():
    one = features(ring(181, math.radians(1.0), -math.pi / 2, missing=(90,)))
    assert reading_at(-1.0, 0.2, one.image) == -2
    assert reading_at(1.0, 0.0, one.image) == -1


def test_slots_run_counter_clockwise_whatever_way_the_sensor_turns():
    angles, third = np.array([0.5, 0.6, 0.7]), 2.0 * math.pi / 3.0
    assert azimuth_table(np.array([0, 2]), angles, 0.1, True, False, False)[0].tolist() == [0, -1, 1, -2]
    assert azimuth_table(np.array([2, 0]), angles[::-1], 0.1, True, True, False)[0].tolist() == [0, -1, 1, -2]
    assert azimuth_table(np.array([0, 1]), third * np.arange(2), third, True, False, True)[0].tolist() in [
        [0, 1, 0],
        [0, 1, 1],
    ]
    assert azimuth_table(np.array([0, 1, 2]), math.pi * np.arange(3), math.pi, True, False, True)[0].tolist() == [0, 1]


@pytest.mark.parametrize(("increment", "n_beams"), [(1e-9, 50), (1e-3, 50), (0.2, 50), (3.0, 5)])
def test_odd_increments_cost_no_memory_and_raise_nothing(increment, n_beams):
    scan = cs.LaserScan(np.ones(n_beams), angle_min=0.3, angle_increment=increment)
    one = features(scan)
    assert one.image.table.size <= 6300
    assert -2 <= reading_at(1.0, 1.0, one.image) < n_beams


def uneven(span_deg, seed, way, n_beams=240):
    """A ring seen by beams a half to one and a half steps apart, some of them without a reading."""
    rng = np.random.default_rng(seed)
    steps = rng.uniform(0.5, 1.5, n_beams - 1)
    angles = np.concatenate([[0.0], np.cumsum(steps / steps.sum())]) * math.radians(span_deg)
    angles = rng.uniform(-7.0, 7.0) + way * angles
    ranges = np.full(n_beams, 2.0)
    ranges[rng.choice(n_beams, 20, replace=False)] = np.nan
    return cs.LaserScan(ranges, angles=angles, range_max=9.0)


@pytest.mark.parametrize("span_deg", [150.0, 358.5, 360.0, 361.0])
@pytest.mark.parametrize("way", [1, -1])
def test_of_uneven_beams_the_reading_is_that_of_the_nearest(span_deg, way):
    scan = uneven(span_deg, int(span_deg), way)
    assert not scan.has_uniform_angles
    assert scan.is_full_circle is (span_deg > 300)
    one = features(scan)
    by_beam = np.full(len(scan), -1)
    by_beam[one.beam_idx] = np.arange(len(one.beam_idx))
    step = abs(scan.angle_increment)
    n_told = 0
    for angle in np.random.default_rng(1).uniform(-math.pi, math.pi, 400):
        off = np.sort(np.abs(cs.se2.wrap(angle - scan.angles)))
        if off[1] - off[0] < 0.26 * step or abs(off[0] - step) < 0.6 * step:
            continue  # about halfway between two beams, or at the sweep's end: either is right
        point = 3.0 * np.array([math.cos(angle), math.sin(angle)])
        expected = slow.reading_at(point, scan.angles, by_beam, 1.5 * step)
        assert reading_at(*point, one.image) == expected
        n_told += 1
    assert n_told > 150


def test_a_hole_between_uneven_beams_is_out_of_view():
    angles = np.radians([0.0, 1.0, 2.1, 3.0, 60.0, 61.0, 62.0])
    table, density = azimuth_table(np.arange(7), angles, math.radians(1.0), False, False, False)
    for bearing_deg, expected in [(0.2, 0), (2.0, 2), (4.0, 3), (30.0, -2), (59.0, 4), (63.0, 6)]:
        assert table[round(math.radians(bearing_deg) * density)] == expected
    assert table[-1] == -2


def test_probes_are_spread_over_the_lengths_of_the_surfaces():
    one = features(pillar_scan(sigma=0.0))
    surfels = one.image.surfels
    step = 1.0 / one.image.slots_a_radian
    samples = choose_samples(surfels, 200)
    assert samples.shape == (200, N_COLUMNS)
    facing = np.abs(np.sum(surfels[:, :2] * surfels[:, 5:7], axis=1)) / surfels[:, 2]
    length = np.clip(surfels[:, 2] * step / np.maximum(facing, 0.1), 0.03, 0.3)
    is_right = surfels[:, 1] < 0
    share = length[is_right].sum() / length.sum()
    assert abs(np.mean(samples[:, 1] < 0) - share) < 0.02
    # each is a surfel of the scan
    distance = np.abs(samples[:, None, :2] - surfels[None, :, :2]).sum(axis=2).min(axis=1)
    assert distance.max() == 0.0


def test_the_first_probes_are_spread_like_all():
    samples = features(pillar_scan(sigma=0.0)).image.samples
    bearing = np.arctan2(samples[:, 1], samples[:, 0])
    for n in (6, 12, 24):
        edges = np.quantile(bearing, [1 / 3, 2 / 3])
        thirds = np.bincount(np.digitize(bearing[:n], edges), minlength=3)
        assert thirds.min() >= n // 6


def test_surfaces_without_lines_have_no_probes():
    surfels = np.zeros((5, N_COLUMNS))
    surfels[:, 2], surfels[:, 7] = 1.0, -1.0
    for one in (surfels, surfels[:0]):
        assert choose_samples(one, 12).shape == (0, N_COLUMNS)
