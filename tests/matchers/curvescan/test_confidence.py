"""Confidence: what speaks for a pose and against it, and what another pose explains."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.curvescan.assessment import assess_pose
from curvescan.matchers.curvescan.confidence import (
    COEFFICIENTS,
    Support,
    excess_length,
    explained_share,
    support_lengths,
    support_of,
)
from curvescan.matchers.curvescan.config import CurvescanConfig
from curvescan.matchers.curvescan.features.surfels import CX, CY, LENGTH, N_COLUMNS, NX, NY, X, Y
from curvescan.matchers.curvescan.search import Problem
from tests.matchers.curvescan.scenes import MOTION, pair

CONFIG = CurvescanConfig()
GOOD = Support(
    agreeing=0.8,
    excess=2.0,
    contradicted=0.0,
    contradicted_small=0.0,
    motion=0.3,
    is_guessed=False,
    is_degenerate=False,
    repetition=0.0,
)


def wall(x0, y0, x1, y1, n=40):
    """Surfels of a straight wall that faces the origin."""
    surfels = np.zeros((n, N_COLUMNS))
    surfels[:, X] = surfels[:, CX] = np.linspace(x0, x1, n)
    surfels[:, Y] = surfels[:, CY] = np.linspace(y0, y1, n)
    along = np.array([x1 - x0, y1 - y0])
    normal = np.array([-along[1], along[0]]) / np.hypot(*along)
    normal *= -np.sign(normal @ [x0, y0])
    surfels[:, NX], surfels[:, NY] = normal
    surfels[:, LENGTH] = np.hypot(*along) / n
    return surfels


def test_what_agrees_besides_two_walls_is_excess():
    two = np.vstack([wall(3, -2, 3, 2), wall(-2, 2, 3, 2)])
    three = np.vstack([two, wall(-2, -2, 3, -2)])
    assert excess_length(two, np.ones(len(two), dtype=np.uint8)) < 0.2
    # both long walls run the same way: one of them, and the short one across it, do not count
    assert excess_length(three, np.ones(len(three), dtype=np.uint8)) == pytest.approx(5.0, abs=0.3)
    codes = np.ones(len(three), dtype=np.uint8)
    codes[80:] = 2  # what does not agree is no excess
    assert excess_length(three, codes) < 0.2
    assert excess_length(three, np.zeros(len(three), dtype=np.uint8)) == 0.0


def test_lengths_are_told_apart_by_code_and_by_run():
    surfels = wall(3, -2, 3, 2)  # 0.1 m a reading
    codes = np.ones(40, dtype=np.uint8)
    codes[4:6] = 2
    codes[30:] = 2
    bounds = np.array([0, 40])
    agreeing, contradicted, large, new, total = support_lengths(surfels, bounds, codes, codes)
    np.testing.assert_allclose([agreeing, contradicted, large, new, total], [2.8, 1.2, 1.0, 0, 4])
    nothing = np.zeros(40, dtype=np.uint8)
    assert support_lengths(surfels, bounds, codes, nothing)[3] == pytest.approx(1.2)
    # a run ends where a surface does
    cut = np.array([0, 35, 40])
    assert support_lengths(surfels, cut, codes, codes)[2] == pytest.approx(0.0)


@pytest.mark.parametrize(
    ("name", "better", "worse"),
    [
        ("agreeing", 0.9, 0.3),
        ("excess", 4.0, 0.0),
        ("contradicted", 0.0, 2.0),
        ("motion", 0.0, 3.0),
        ("is_guessed", True, False),
        ("is_degenerate", False, True),
        ("repetition", 0.0, 0.3),
    ],
)
def test_each_thing_moves_the_confidence_the_way_it_should(name, better, worse):
    low, high = (Support(**{**vars(GOOD), name: value}).confidence for value in (worse, better))
    assert 0.0 < low < high < 1.0
    assert set(GOOD.terms) == set(COEFFICIENTS)


def test_a_room_with_pillars_is_explained_by_its_pose_alone():
    ref, cur = pair()
    problem = Problem(ref, cur, None, CONFIG)
    assessment = assess_pose(ref, cur, MOTION, CONFIG)
    turned = MOTION + np.array([0.0, 0.0, np.pi / 2])
    support = support_of(problem, MOTION, assessment, [turned], False)
    assert support.confidence > 0.97
    assert not support.is_repeated
    assert explained_share(problem, MOTION, MOTION, assessment) == pytest.approx(1.0)
    assert explained_share(problem, turned, MOTION, assessment) < 0.2


def test_a_guess_is_where_motion_starts():
    ref, cur = pair()
    assessment = assess_pose(ref, cur, MOTION, CONFIG)
    far, near = (
        support_of(Problem(ref, cur, guess, CONFIG), MOTION, assessment, [], False)
        for guess in (MOTION + 1.0, MOTION + 0.05)
    )
    assert far.motion > 2.0 > 0.3 > near.motion
    assert near.is_guessed
    assert not far.is_guessed
    assert near.confidence > far.confidence


def test_a_result_tells_how_sure_it_is():
    log = cs.simulate("office", n_scans=4, seed=2)
    result = cs.match(log[0], log[1])
    assert result.ok
    assert 0.9 < result.confidence <= 1.0
    assert not result.is_guess_decisive
    empty = cs.LaserScan(np.full(361, np.inf), angle_min=-1.57, angle_increment=0.0087)
    assert cs.match(log[0], empty).confidence == 0.0
    assert np.isnan(cs.match(log[0], log[1], method="icp").confidence)
