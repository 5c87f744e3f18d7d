"""Known places: when an earlier keyframe is believed to show where a scan is."""

from __future__ import annotations

import math

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.odometry import KeyframesConfig
from curvescan.odometry.keyframes import KeyframeGraph, Localization
from curvescan.odometry.relocalization import Closure, Search, find_loop_closure, search_loop_closures
from curvescan.se2.uncertain import UncertainPose, identity

SURE = np.diag([1e-6, 1e-6, 1e-7])
VAGUE = np.diag([0.25, 0.25, 0.01])


@pytest.fixture(scope="module")
def office():
    """Scans of an office from places 0.3 m apart, and their true poses from the first."""
    start = cs.simulate("office", n_scans=1, seed=5).truth.poses[0]
    way = se2.compose(start, [[0.3 * k, 0.0, 0.1 * k] for k in range(3)] + [[0.15, 0.1, 0.05]])
    log = cs.simulate("office", poses=way, seed=5)
    return [cs.prepare(scan) for scan in log], se2.between(way[0], way)


def recovery_covariance(office, cov, off=(0.0, 0.0, 0.0)):
    """Keyframes at three places; and a chain from the last of them to the fourth, off and uncertain by so much."""
    scans, truth = office
    keyframes = KeyframeGraph(max_keyframes=10, variance_retained=1.0)
    keyframe = keyframes.add(scans[0], 0, None)
    for k in (1, 2):
        keyframes.add(scans[k], k, Localization(keyframe=keyframe, pose_keyframe_scan=UncertainPose(truth[k], SURE)))
    blank = cs.prepare(cs.LaserScan([], angle_min=0.0, angle_increment=0.1))
    far = keyframes.add(
        blank, 3, Localization(keyframe=keyframe, pose_keyframe_scan=UncertainPose(truth[3] + off, cov))
    )
    return scans[3], Localization(keyframe=far, pose_keyframe_scan=identity()), keyframes, truth[3]


def ask(current, localization, keyframes, is_lost=False, **config):
    return find_loop_closure(current, localization, keyframes, KeyframesConfig(**config), turn=math.pi, is_lost=is_lost)


def find(office, cov, off=(0.0, 0.0, 0.0), **config):
    current, localization, keyframes, truth = recovery_covariance(office, cov, off)
    return ask(current, localization, keyframes, **config), truth


@pytest.mark.parametrize("cov", [SURE, VAGUE])
def test_a_place_is_known_again(office, cov):
    known, truth = find(office, cov)
    assert known is not None
    localization, result = known
    assert result.ok
    np.testing.assert_allclose(localization.pose_map_scan.pose, truth, atol=0.01)
    assert localization.is_measured
    # as sure as the match is, however vague the chain had become
    assert np.trace(localization.pose_map_scan.cov) < 1e-4


def test_a_vague_chain_may_be_far_off(office):
    known, truth = find(office, VAGUE, off=(0.6, -0.5, 0.1))
    assert known is not None
    np.testing.assert_allclose(known[0].pose_map_scan.pose, truth, atol=0.01)


def test_a_match_where_the_chain_cannot_lie_is_not_believed(office):
    """The chain is sure to be elsewhere: what matches there must be another room of the same kind."""
    elsewhere, _ = find(office, np.diag([0.02, 0.02, 0.001]), off=(1.5, 1.0, 0.4))
    assert elsewhere is None


def test_where_the_chain_is_vague_one_key_scan_is_not_enough(office):
    current, localization, keyframes, _ = recovery_covariance(office, VAGUE)
    for keyframe in list(keyframes)[1:3]:
        keyframes.forget(keyframe)
    assert ask(current, localization, keyframes) is None
    # where it is certain, one is
    current, localization, keyframes, _ = recovery_covariance(office, SURE)
    for keyframe in list(keyframes)[1:3]:
        keyframes.forget(keyframe)
    assert ask(current, localization, keyframes) is not None


def test_where_the_chain_is_vague_two_must_put_the_scan_in_one_place(office):
    """Each matches; but by the map one of them stands half a metre beside where its match has the other."""
    current, localization, keyframes, _ = recovery_covariance(office, VAGUE)
    _, near, far, _ = keyframes
    keyframes.forget(far)
    assert ask(current, localization, keyframes) is not None
    moved = near.pose_map_keyframe.pose + np.array([0.4, -0.4, 0.0])
    near.pose_map_keyframe = UncertainPose(moved, near.pose_map_keyframe.cov)
    assert ask(current, localization, keyframes) is None


def test_no_more_than_so_many_are_tried(office):
    assert find(office, VAGUE, max_tries=1)[0] is None
    assert find(office, VAGUE, max_tries=0)[0] is None


def test_one_that_drifted_more_puts_nothing_right(office):
    current, localization, keyframes, _ = recovery_covariance(office, VAGUE)
    for keyframe in list(keyframes)[1:3]:
        keyframe.pose_map_keyframe = UncertainPose(keyframe.pose_map_keyframe.pose, 100.0 * VAGUE)
    assert ask(current, localization, keyframes) is None


def test_to_the_lost_two_that_agree_may_score_less_where_the_scan_is_expected(office):
    unsure = {"confident_score": 1.0, "least_score": 0.3}
    assert find(office, VAGUE, **unsure)[0] is None
    assert find(office, VAGUE, is_lost=True, **unsure)[0] is not None
    # 2.5 standard deviations off: one of twenty lies there, and other places of the same kind
    off = {"off": (2.5, 0.0, 0.0), "max_reach": 4.0}
    assert find(office, VAGUE, is_lost=True, **off)[0] is not None
    assert find(office, VAGUE, is_lost=True, agreeing_gate_chi2=4.0, **off, **unsure)[0] is None
    # one alone must be sure, lost or not
    assert find(office, SURE, is_lost=True, **unsure)[0] is None


def test_places_that_contradict_the_chain_are_disputed(office):
    """Two keyframes agree, five standard deviations from the chain: not believed at once, but told."""
    current, localization, keyframes, truth = recovery_covariance(
        office, np.diag([0.02, 0.02, 0.001]), off=(1.2, 0.8, 0.1)
    )
    search = search_loop_closures(current, localization, keyframes, KeyframesConfig(), turn=math.pi)
    assert search.found is None
    assert search.disputed is not None
    np.testing.assert_allclose(search.disputed.localization.pose_map_scan.pose, truth, atol=0.01)
    for config in ({"disputed_gate_chi2": 17.0}, {"disputed_confidence": 1.0}):
        strict = search_loop_closures(current, localization, keyframes, KeyframesConfig(**config), turn=math.pi)
        assert strict == Search()


def test_a_doubtful_match_counts_as_one_of_two(office):
    """It is the keyframe in use that it was made with; one earlier keyframe must agree."""
    current, localization, keyframes, truth = recovery_covariance(office, VAGUE)
    for keyframe in list(keyframes)[1:3]:
        keyframes.forget(keyframe)
    first = next(iter(keyframes))
    failed = current.matcher.match(first.scan.features, localization.keyframe.scan.features, None)
    assert not failed.ok
    for off, is_found in (((0.0, 0.0, 0.0), True), ((6.0, 0.0, 0.0), False)):
        chain = localization.relative_to(first).pose
        here = UncertainPose(se2.between(chain, truth) + off, SURE)
        doubtful = Closure(Localization(keyframe=localization.keyframe, pose_keyframe_scan=here), failed)
        known = find_loop_closure(current, localization, keyframes, KeyframesConfig(), turn=math.pi, doubtful=doubtful)
        assert (known is not None) == is_found
        if known is not None:
            assert known.result.ok  # the one that did not fail
