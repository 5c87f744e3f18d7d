"""Turns from the directions of surfaces, slides along a corridor."""

from __future__ import annotations

import math

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.features.landmarks import direction_histogram
from curvescan.matchers.curvescan.proposal.rotation_hypotheses import (
    degenerate_hypotheses,
    dominant_axis,
    rotation_hypotheses,
)
from tests.matchers.curvescan.scenes import features, pair, pillar_scan, turned
from tests.reference import curvescan as slow


def hall_scan(x, *, sigma=0.005, seed=0, width=2.0):
    """A half circle in a corridor along x, endless both ways, seen from its middle."""
    angles = np.linspace(-math.pi / 2, math.pi / 2, 361)
    with np.errstate(divide="ignore"):
        ranges = 0.5 * width / np.abs(np.sin(angles))
    noise = sigma * np.random.default_rng(seed).standard_normal(361)
    return cs.LaserScan(ranges + noise, angle_min=-math.pi / 2, angle_increment=math.pi / 360, range_max=8.0)


@pytest.mark.parametrize("angle", [0.0, 0.3, -1.2, 2.9])
def test_the_histogram_turns_with_the_sensor(angle):
    scan = pillar_scan(seed=1)
    ref, cur = features(scan), features(turned(scan, -angle))
    np.testing.assert_allclose(np.linalg.norm(ref.landmarks.directions), 1.0)
    poses = rotation_hypotheses(ref.landmarks.directions, cur.landmarks.directions, 4, np.array([0.3, 0.1, 0.2]))
    np.testing.assert_array_equal(poses[0], [0.3, 0.1, 0.2])
    np.testing.assert_array_equal(poses[1:, :2], np.tile([0.3, 0.1], (len(poses) - 1, 1)))
    # a tenth of a bin of 3 degrees
    assert np.abs(cs.se2.wrap(poses[1:, 2] - angle)).min() < math.radians(0.5)


def test_turns_are_peaks_of_the_correlation():
    ref, cur = pair()
    likeness = slow.turn_likeness(ref.landmarks.directions, cur.landmarks.directions)
    poses = rotation_hypotheses(ref.landmarks.directions, cur.landmarks.directions, 3, np.zeros(3))
    bins = np.round(np.mod(poses[1:, 2], 2 * math.pi) * 120 / (2 * math.pi)).astype(int) % 120
    assert bins[0] == np.argmax(likeness)
    for k in bins:
        assert likeness[k] >= max(likeness[k - 1], likeness[(k + 1) % 120]) - 1e-12
    assert (np.diff(likeness[bins]) <= 0).all()


def test_scans_without_lines_have_an_even_histogram():
    assert not direction_histogram(np.empty((0, 10))).any()


def test_the_axis_is_that_of_the_walls_however_the_sensor_is_turned():
    for turn in (-0.6, 0.0, 0.4):
        axis = dominant_axis(features(pillar_scan((0.0, 0.0, turn))).image.surfels)
        assert abs(math.remainder(axis + turn, math.pi / 2)) < 0.05


def test_slides_run_along_a_corridor_and_nowhere_else():
    ref, cur = features(hall_scan(0.0, seed=1)), features(hall_scan(0.4, seed=2))
    moved_along = degenerate_hypotheses(np.zeros((1, 3)), ref.image, cur.image, 0.2, 3, 0.1)
    assert len(moved_along) == 6
    np.testing.assert_allclose(np.abs(moved_along[:, 1]), 0.0, atol=0.02)
    np.testing.assert_allclose(np.sort(np.abs(moved_along[:, 0])), [0.2, 0.2, 0.4, 0.4, 0.6, 0.6], atol=0.01)
    assert not moved_along[:, 2].any()
    ref, cur = pair()
    assert len(degenerate_hypotheses(np.zeros((1, 3)), ref.image, cur.image, 0.2, 3, 0.1)) == 0
