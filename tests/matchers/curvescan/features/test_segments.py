"""Surfaces: readings in sweep order, and where they break."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.config import SegmentsConfig
from curvescan.matchers.curvescan.features.segments import MAX_GAP, Sweep, ordered_readings
from tests.matchers.curvescan.scenes import pillar_scan
from tests.reference import curvescan as slow

CONFIG = SegmentsConfig()


def run_sweep(scan, told_by_angles=False):
    return ordered_readings(
        Sweep(
            scan.ranges,
            scan.valid_range,
            scan.directions,
            scan.angles,
            abs(scan.angle_increment),
            not told_by_angles,
            scan.angle_increment < 0,
            scan.is_full_circle,
            0.0,
        ),
        CONFIG.incidence_limit,
        CONFIG.jump,
    )


@pytest.mark.parametrize("fov", [math.pi, 2 * math.pi])
@pytest.mark.parametrize("seed", range(4))
def test_surfaces_are_those_of_the_slow_twin(fov, seed):
    rng = np.random.default_rng(seed)
    scan = pillar_scan(rng.uniform(-0.4, 0.4, 3), sigma=0.01, seed=seed, fov=fov, n_beams=181)
    ranges = scan.ranges.copy()
    ranges[rng.choice(181, 25, replace=False)] = np.nan
    scan = cs.LaserScan(ranges, angle_min=scan.angle_min, angle_increment=scan.angle_increment, range_max=20.0)
    beam_idx, readings, bounds = run_sweep(scan)
    beams = np.flatnonzero(scan.valid)
    expected = slow.segments(
        scan.points[beams],
        scan.ranges[beams],
        beams,
        181,
        scan.is_full_circle,
        scan.angle_increment,
        CONFIG.incidence_limit,
        MAX_GAP,
        CONFIG.jump,
    )
    found = [beam_idx[a:b].tolist() for a, b in itertools.pairwise(bounds)]
    assert sorted(found) == sorted([beams[i] for i in group] for group in expected)
    np.testing.assert_allclose(readings[:, :2], scan.points[beam_idx])
    np.testing.assert_array_equal(readings[:, 2], scan.ranges[beam_idx])


def test_a_clockwise_sweep_is_its_mirror_image():
    scan = pillar_scan(seed=3)
    mirrored = cs.LaserScan(
        scan.ranges[::-1], angle_min=scan.angles[-1], angle_increment=-scan.angle_increment, range_max=20.0
    )
    beam_idx, readings, bounds = run_sweep(scan)
    beam_mirrored, readings_mirrored, bounds_mirrored = run_sweep(mirrored)
    np.testing.assert_array_equal(beam_mirrored, 360 - beam_idx)
    np.testing.assert_allclose(readings_mirrored, readings, atol=1e-12)
    np.testing.assert_array_equal(bounds_mirrored, bounds)


@pytest.mark.parametrize("fov", [math.pi, 2 * math.pi - math.radians(1.0)])
@pytest.mark.parametrize("way", [1, -1])
def test_beams_told_one_by_one_give_the_same_surfaces(fov, way):
    scan = pillar_scan(seed=4, fov=fov, n_beams=360)
    ranges = scan.ranges.copy()
    ranges[np.random.default_rng(4).choice(360, 40, replace=False)] = np.nan
    angles = scan.angles
    scan = cs.LaserScan(ranges[::way], angles=angles[::way], range_max=20.0)
    for grid, information in zip(run_sweep(scan), run_sweep(scan, told_by_angles=True), strict=True):
        np.testing.assert_array_equal(information, grid)


def corridor_scan(*, sigma=0.0, seed=0):
    """A wall 1 m to the left, seen at less and less of an angle, and nothing else."""
    angles = np.radians(np.arange(3.0, 100.0, 0.5))
    ranges = 1.0 / np.sin(angles) + sigma * np.random.default_rng(seed).standard_normal(angles.size)
    return cs.LaserScan(ranges, angle_min=angles[0], angle_increment=np.radians(0.5), range_max=30.0)


@pytest.mark.parametrize("seed", range(3))
def test_a_grazed_wall_is_one_surface(seed):
    scan = corridor_scan(sigma=0.005, seed=seed)
    _, readings, bounds = run_sweep(scan)
    # at 4 degrees neighbouring readings lie 1.7 m apart, at 5 degrees 1.1 m; up to 1 m they are one wall
    longest = int(np.diff(bounds).argmax())
    wall = readings[bounds[longest] : bounds[longest + 1]]
    assert wall[:, 2].max() > 9.0
    # the angle of incidence alone would end it where a reading is 1 / sin(10 degrees) = 5.8 m away


def test_steps_of_a_grazed_wall_still_break_it():
    scan = corridor_scan()
    shifted = np.where(scan.angles < np.radians(8.0), scan.ranges + 1.0, scan.ranges)
    stepped = cs.LaserScan(shifted, angle_min=scan.angle_min, angle_increment=scan.angle_increment, range_max=30.0)
    _, readings, bounds = run_sweep(stepped)
    assert len(bounds) > 2
    for a, b in itertools.pairwise(bounds):
        y = readings[a:b, 1]
        assert np.ptp(y) < 0.05  # 1 m of range at 8 degrees is 0.14 m off the wall


@pytest.mark.parametrize("wrong", [{"arm": 0.0}, {"incidence_limit": 2.0}, {"range_sigma_min": 0.0}])
def test_wrong_parameters_are_named(wrong):
    with pytest.raises(cs.InvalidArgumentError, match=next(iter(wrong))):
        SegmentsConfig(**wrong)
