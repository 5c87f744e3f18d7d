"""Bare boxes: where two walls of an elevator fit any corner of it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.assessment.assessment import assess_pose
from curvescan.matchers.curvescan.assessment.evidence import BEYOND, SMALL, extent
from curvescan.matchers.curvescan.assessment.labels import INLIER
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.disambiguation import is_in_box
from curvescan.matchers.curvescan.features.features import extract_features
from curvescan.matchers.curvescan.features.surfels import N_COLUMNS, X, Y
from curvescan.matchers.curvescan.prior import WIDE, Prior
from curvescan.matchers.result import prior_of
from tests.matchers.curvescan.scenes import weigh

CONFIG = CurvescanConfig()


def box_scan(pose, size):
    """Return a scan of half a circle from inside a square box about the origin, without noise but a millimetre."""
    angles = np.radians(np.arange(-90.0, 90.5, 0.5))
    directions = np.stack([np.cos(angles + pose[2]), np.sin(angles + pose[2])], axis=1)
    walls = (np.sign(directions) * 0.5 * size - pose[:2]) / directions
    ranges = walls.min(axis=1) + np.random.default_rng(3).normal(0.0, 0.001, angles.size)
    return cs.LaserScan(ranges, angle_min=angles[0], angle_increment=np.radians(0.5), range_min=0.02, range_max=8.0)


def in_box(size, motion, guess=None, **evidence):
    """Return whether a pair in a square box, matched at the true pose, is taken for one in a bare box."""
    start = np.array([-0.1 * size, 0.05 * size, 0.4])
    end = cs.se2.compose(start, np.array(motion))
    ref, cur = (extract_features(box_scan(pose, size), CONFIG) for pose in (start, end))
    prior = WIDE if guess is None else Prior.of(prior_of(None, guess))
    poses = np.array([motion], dtype=np.float64)
    weighed = weigh(ref, cur, prior, poses, [0.8])
    columns = {"beyond": BEYOND, "small": SMALL}
    for name, value in evidence.items():
        weighed = replace(weighed, evidence=weighed.evidence.copy())
        weighed.evidence[0, columns[name]] = value
    return is_in_box(ref, cur, weighed, assess_pose(ref, cur, poses[0], CONFIG))


TURN = (0.1, -0.1, 0.5)


def test_a_small_bare_box_is_one_and_a_room_is_none():
    assert in_box(1.5, TURN)
    assert not in_box(4.0, TURN)


def test_standing_still_a_guess_or_anything_else_there_speaks_for_the_pose():
    assert not in_box(1.5, (0.05, 0.05, 0.15))
    assert not in_box(1.5, TURN, guess=TURN)
    assert in_box(1.5, TURN, guess=(0.5, 0.5, 0.5))  # a guess elsewhere says nothing for it
    assert not in_box(1.5, TURN, beyond=0.21)
    assert in_box(1.5, TURN, beyond=0.19)
    assert not in_box(1.5, TURN, small=0.21)  # people hide the rest
    assert in_box(1.5, TURN, small=0.19)


@pytest.mark.parametrize("n", [1, 3, 48, 49, 500])
def test_an_extent_is_that_of_the_readings_that_agree(n):
    surfels = np.zeros((n + 1, N_COLUMNS))
    surfels[:n, X], surfels[:n, Y] = np.linspace(0.0, 3.0, n), np.linspace(0.0, 4.0, n)
    surfels[n, X] = 50.0
    codes = np.full(n + 1, INLIER, dtype=np.uint8)
    codes[n] = 0
    # of many readings every tenth or so is taken
    assert extent(surfels, codes) == pytest.approx(5.0 if n > 1 else 0.0, rel=0.03)
    assert extent(surfels, np.zeros(n + 1, dtype=np.uint8)) == 0.0


def test_an_elevator_is_ambiguous_and_with_a_guess_matched():
    start, motion = np.array([-0.15, 0.1, 0.4]), np.array(TURN)
    ref, cur = box_scan(start, 1.5), box_scan(cs.se2.compose(start, motion), 1.5)
    assert cs.match(ref, cur).outcome is cs.Outcome.AMBIGUOUS
    guessed = cs.match(ref, cur, guess=motion + 0.02)
    assert guessed.ok
    np.testing.assert_allclose(guessed.pose, motion, atol=0.01)
