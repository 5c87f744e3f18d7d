"""MapMatcher: matches are within the gate, and several of one scan are worth no more than one."""

from __future__ import annotations

from copy import copy

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.matchers import find_matcher
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam.config import SlamConfig
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.localization.field import DistanceField, field_of
from curvescan.slam.localization.matching import Hit, MapMatcher, fused
from curvescan.slam.loops.closures import is_certain
from tests.slam.map_example import FILE, lap, scans


@pytest.fixture(scope="module")
def matching() -> MapMatcher:
    stored = cs.load_map(FILE)
    keyframes = Keyframes(find_matcher("curvescan"))
    for k, scan in enumerate(stored.scans):
        keyframes.add(scan, k)
    return MapMatcher(stored, keyframes, SlamConfig(), field_of(stored))


def _hit(x: float, sigma: tuple[float, float]) -> Hit:
    cov = np.diag([sigma[0] ** 2, sigma[1] ** 2, 0.01**2])
    return Hit(keyframe=0, here=UncertainPose(np.array([x, 0.0, 0.0]), cov), score=0.8)


def test_matches_of_one_scan_are_worth_no_more_than_one() -> None:
    both = fused([_hit(1.0, (0.01, 0.01)), _hit(1.02, (0.01, 0.01))])
    assert both.pose[0] == pytest.approx(1.01)
    assert np.sqrt(both.covariance[0, 0]) == pytest.approx(0.01)


def test_what_one_match_leaves_open_another_fixes() -> None:
    both = fused([_hit(0.3, (10.0, 0.01)), _hit(1.0, (0.01, 10.0))])
    assert both.pose[0] == pytest.approx(1.0, abs=1e-4)
    assert np.sqrt(both.covariance[[0, 1], [0, 1]]) == pytest.approx([0.01 * 2**0.5] * 2, rel=1e-3)


def test_a_scan_is_matched_where_it_is_expected_and_nowhere_else(matching: MapMatcher) -> None:
    pose = lap()[33]
    scan = scans(lap()[33:34], seed=8)[0]
    true = se2.between(lap()[0], pose)
    vague = np.diag(np.square([0.15, 0.15, 0.06]))
    guess = se2.compose(true, [0.1, -0.05, 0.03])
    hits, is_due = matching.around(scan, UncertainPose(guess, vague))
    assert hits
    assert is_due
    off = se2.between(true, fused(hits).pose)
    assert np.hypot(*off[:2]) < 0.03
    # within a centimetre of a place a metre away nothing matches
    sure = np.diag(np.square([0.01, 0.01, 0.01]))
    assert not matching.around(scan, UncertainPose(se2.compose(true, [1.0, 0, 0]), sure))[0]


def test_the_map_errs_as_if_edges_led_from_one_keyframe_to_the_other(matching: MapMatcher) -> None:
    here = UncertainPose(np.zeros(3), 1e-6 * np.eye(3))
    same, near, far = (_hit(0.0, (0.1, 0.1))._replace(keyframe=k) for k in (0, 1, 12))
    assert matching.seen_from(here, 0, same) is here
    assert matching.seen_from(here, -1, far) is here  # where no keyframe is known there is nothing to add
    added = [np.diagonal(matching.seen_from(here, 0, hit).covariance - here.covariance) for hit in (near, far)]
    assert (added[1] > added[0]).all()
    assert (added[0] > 0.0).all()


def test_the_map_s_own_error_is_added(matching: MapMatcher) -> None:
    here = UncertainPose(np.array([1.0, 2.0, 0.3]), np.diag([1e-6, 1e-6, 1e-8]))
    around, in_all = matching.in_map(here, 12)
    assert (np.diagonal(around.covariance) > np.diagonal(here.covariance)).all()
    assert (np.linalg.eigvalsh(in_all - around.covariance) > -1e-15).all()
    assert np.trace(in_all) > np.trace(around.covariance)


@pytest.mark.parametrize(("has_end", "is_held"), [(True, True), (False, False)])
def test_the_end_of_a_corridor_holds_what_a_match_leaves_open(
    matching: MapMatcher, has_end: bool, is_held: bool
) -> None:
    x, y = np.meshgrid(np.arange(-5.0, 5.0, 0.05) + 0.025, np.arange(-5.0, 5.0, 0.05) + 0.025)
    distance = np.abs(np.abs(y) - 1.0)
    points = np.array([[0.1 * k, side] for side in (-1.0, 1.0) for k in range(-20, 21)])
    if has_end:
        distance = np.minimum(distance, np.abs(x - 2.5))
        points = np.vstack((points, [[2.5, 0.2 * k] for k in range(-4, 5)]))
    corridor = DistanceField(
        distance=distance.astype(np.float32),
        is_free=distance > 0.05,
        is_solid=distance <= 0.05,
        origin=np.array([-5.0, -5.0]),
        resolution=0.05,
    )
    at = copy(matching)
    at.field = corridor
    place = UncertainPose(np.zeros(3), np.diag(np.square([0.15, 0.15, 0.06])))
    slid, fixed = _hit(0.6, (10.0, 0.01)), _hit(0.02, (0.01, 0.01))
    held, as_before = (at.held(points, place, hit) for hit in (slid, fixed))
    assert not is_certain(slid.here, SlamConfig())
    assert is_certain(held.here, SlamConfig()) is is_held
    assert as_before is fixed
    if is_held:
        assert abs(held.here.pose[0]) < 0.01
        assert 0.1 < np.sqrt(held.here.covariance[0, 0]) < 0.2  # no better than the search knows it
    else:
        assert held is slid
