"""Readings joined into surfaces, and the direction of these, against singular values."""

from __future__ import annotations

import math

import numpy as np
import pytest

from curvescan import LaserScan
from curvescan.matchers.baselines.points import ARM, sweep_of
from tests.reference import baselines as twin
from tests.scenes import room_scan


def test_tangents_agree_with_the_slow_twin():
    points = sweep_of(room_scan(sigma=0.01, seed=4, n_beams=91))
    for start, stop in zip(points.starts, points.stops, strict=True):
        rows = points.order[start:stop]
        for i, row in enumerate(rows):
            expected = twin.local_line(points.points[rows], i, ARM)
            np.testing.assert_allclose(points.tangents[row], expected, atol=1e-9)


def test_tangents_run_counter_clockwise_and_normals_look_inwards():
    points = sweep_of(room_scan())
    outwards = np.sum(points.normals * points.points, axis=1)
    assert (outwards < 0).all()
    np.testing.assert_allclose(np.linalg.norm(points.tangents, axis=1), 1.0)


def test_a_turned_scan_has_turned_tangents():
    scan = room_scan(sigma=0.005, seed=1)
    turned = LaserScan(
        scan.ranges, angle_min=scan.angle_min + 0.3, angle_increment=scan.angle_increment, range_max=scan.range_max
    )
    here, there = sweep_of(scan).tangents, sweep_of(turned).tangents
    angle = np.arctan2(there[:, 1], there[:, 0]) - np.arctan2(here[:, 1], here[:, 0])
    np.testing.assert_allclose(np.remainder(angle, 2 * math.pi), 0.3, atol=1e-9)


def test_surfaces_end_at_gaps_and_isolated_readings_have_no_tangent():
    ranges = np.full(60, 2.0)
    ranges[30:] = 5.0
    ranges[45] = 1.0
    points = sweep_of(LaserScan(ranges, angle_min=0.0, angle_increment=0.01, range_max=8.0))
    assert not points.is_joined[[29, 44, 45, 59]].any()
    assert np.count_nonzero(points.is_joined) == 56
    assert np.isnan(points.tangents[45]).all()
    assert np.isfinite(np.delete(points.tangents, 45, axis=0)).all()


@pytest.mark.parametrize("n_beams", [360, 361])
def test_a_full_circle_joins_at_the_seam(n_beams):
    scan = LaserScan(np.full(n_beams, 2.0), angle_min=-math.pi, angle_increment=math.radians(1.0))
    points = sweep_of(scan)
    # a round room is one surface, opened where the sweep starts
    assert np.count_nonzero(~points.is_joined) == 1
    assert len(points.starts) == 1


def test_no_readings_make_an_empty_sweep():
    points = sweep_of(LaserScan([], angle_min=0.0, angle_increment=0.1))
    assert len(points) == 0
    assert points.tangents.shape == points.normals.shape == (0, 2)
