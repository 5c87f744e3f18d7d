"""GrowingMap: how a keyframe is tied to the one before it."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers import find_matcher
from curvescan.odometry.gaps import LOST_COVARIANCE
from curvescan.odometry.step import StepOutcome
from curvescan.se2.uncertain import UncertainPose
from curvescan.simulation import World
from curvescan.slam import SlamConfig
from curvescan.slam.growing_map import GrowingMap, solve
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.loops.closures import Closure, ClosureOutcome
from curvescan.slam.loops.cycles import Chain
from curvescan.slam.pose_graph.graph import EdgeKind, PoseGraph, is_lost
from tests.slam.graphs import step_of


@pytest.fixture(scope="module")
def scans() -> list[cs.LaserScan]:
    return list(cs.simulate("office", seed=1, n_scans=3, odometry_noise=None))


def test_a_match_decides_where_it_measures_and_the_odometry_where_it_does_not() -> None:
    """Along a bare corridor the odometry tells the way; the walls tell the heading and the distance from them."""
    walls = World(walls=np.array([[-50.0, 1.0, 50.0, 1.0], [-50.0, -1.2, 50.0, -1.2]]))
    poses = np.array([[0.5 * k, 0.0, 0.0] for k in range(4)])
    # one of the drives whose matches do not leave the half turn open: a third do
    scans = list(cs.simulate(walls, sensor="spinning-360", poses=poses, odometry_noise=None, seed=6))
    growing = GrowingMap(Keyframes(find_matcher("curvescan")), SlamConfig())
    growing.start(scans[0], 0)
    for k in (1, 2, 3):
        growing.append(scans[k], step_of(k), UncertainPose(np.array([0.45, 0.05, 0.05]), np.diag([0.01, 0.01, 0.01])))
    graph = growing.graph
    assert (graph.kinds == EdgeKind.MOTION).all()
    np.testing.assert_allclose(graph.measured, [[0.45, 0.0, 0.0]] * 3, atol=0.03)
    sigma = np.sqrt(np.diagonal(graph.edge_covariances, axis1=1, axis2=2))
    assert sigma[:, 1].max() < 0.03
    assert sigma[:, 2].max() < 0.01
    # what the odometry may slip grows with the way
    assert (np.diff(sigma[:, 0]) > 0.0).all()


def test_where_wheels_drive_along_a_motion_may_slip_as_they_do() -> None:
    """After 10 m of a bare corridor a step of half a metre may have slipped by 0.05 or 0.01 of both together."""
    step, noise = UncertainPose(np.array([0.5, 0.0, 0.0]), np.zeros((3, 3))), SlamConfig().noise
    alone, driven = (noise.slipped(step, 10.0, 0, *slip).covariance[0, 0] for slip in ((), (0.01,)))
    assert alone - noise.floor_m**2 == pytest.approx(0.05**2 * (10.5**2 - 10.0**2))
    assert driven - noise.floor_m**2 == pytest.approx(0.01**2 * (10.5**2 - 10.0**2))


@pytest.mark.parametrize(("off", "least", "most"), [(0.3, 0.15, 0.35), (4.0, 0.0, 0.5)])
def test_a_motion_is_doubted_as_far_as_it_may_have_slipped(
    scans: list[cs.LaserScan], monkeypatch: pytest.MonkeyPatch, off: float, least: float, most: float
) -> None:
    """A match that is as likely as not tells of a slip where it is decimetres off, and of another room where one is."""
    growing = GrowingMap(Keyframes(find_matcher("curvescan")), SlamConfig())
    growing.start(scans[0], 0)
    seen = replace(growing.keyframes.match(0, growing.keyframes.prepare(scans[1]), None), confidence=0.52)
    monkeypatch.setattr(growing.keyframes, "match", lambda *_: seen)
    growing.append(
        scans[1], step_of(1), UncertainPose(seen.pose + np.array([off, 0.0, 0.0]), np.diag([0.0025, 0.0025, 1e-4]))
    )
    assert growing.graph.kinds[0] == EdgeKind.MOTION
    assert least < np.sqrt(growing.graph.edge_covariances[0, 0, 0]) < most


def test_cycles_are_closed_along_the_odometry_whatever_closures_moved(scans: list[cs.LaserScan]) -> None:
    """A closure moves the keyframes from its own on, which then come apart from those before."""
    growing = GrowingMap(Keyframes(find_matcher("curvescan")), SlamConfig())
    growing.start(scans[0], 0)
    for k in (1, 2, 1, 2):
        motion = UncertainPose(np.array([0.5, 0.0, 0.0]), np.diag([0.01, 0.01, 0.001]))
        growing.append(scans[k], step_of(k), motion)
    before = growing.graph.poses.copy()
    chain = growing.chain().poses
    closure = Closure(
        scan=5, i=0, j=3, pose=before[3] + [0.3, 0.1, 0.0], covariance=1e-6 * np.eye(3),
        score=0.9, distance=1.0, outcome=ClosureOutcome.ACCEPTED,
    )  # fmt: skip
    growing.close(closure)
    after = growing.graph.poses
    assert np.hypot(*(after[3] - before[3])[:2]) > 0.1
    np.testing.assert_allclose(growing.chain().poses, chain, atol=1e-12)


def test_the_chain_of_a_map_that_is_continued_is_that_of_its_edges(scans: list[cs.LaserScan]) -> None:
    made = GrowingMap(Keyframes(find_matcher("curvescan")), SlamConfig())
    made.start(scans[0], 0)
    for k in (1, 2, 1):
        motion = UncertainPose(np.array([0.5, 0.1, 0.2]), np.diag([0.01, 0.02, 0.001]))
        made.append(scans[k], step_of(k), motion)
    continued = GrowingMap(Keyframes(find_matcher("curvescan")), SlamConfig())
    continued.load(made.snapshot())
    k = continued.start(scans[0], 9)
    graph, chain = made.graph, continued.chain()
    steps = np.zeros((k, 3, 3))
    steps[graph.ends[:, 1]] = graph.edge_covariances  # the last edge to a keyframe counts
    np.testing.assert_allclose(chain.poses[:k], graph.poses, atol=1e-12)
    np.testing.assert_allclose(chain.gathered[:k], Chain.of(graph.poses, steps).gathered)
    # nothing says how the new session lies to it
    assert chain.gathered[k, 0, 0] - chain.gathered[k - 1, 0, 0] > 100.0


def test_a_false_closure_is_refused_though_it_bends_steps_more_than_itself() -> None:
    """Steps known to 0.15 m give way to it, and the one behind it slips: a cost of 50 for the 16 of leaving it out."""
    graph, soft = PoseGraph(), np.diag(np.square([0.15, 0.01, 0.002]))
    for k in range(9):
        graph.add_pose(np.array([0.64 * k, 0.0, 0.0]))
    for k in range(8):
        graph.add_edge(k, k + 1, np.array([0.64, 0.0, 0.0]), soft, EdgeKind.MOTION)
    for k, off in ((5, 1.28), (6, 0.0), (7, 0.0), (8, 0.0)):
        graph.add_edge(0, k, np.array([0.64 * k + off, 0.0, 0.0]), 1e-4 * np.eye(3), EdgeKind.CLOSURE)
    solved, _ = solve(graph, SlamConfig().noise, is_last=True)
    assert solved.weights.tolist() == [1.0] * 8 + [0.0] + [1.0] * 3


def test_a_turn_that_no_match_saw_is_the_less_known_the_more_scans_lie_between(scans: list[cs.LaserScan]) -> None:
    """In a round room the turn of a scan goes on with the next; a scan without readings does not match."""
    blind = cs.LaserScan(np.full(181, np.nan), angle_min=-np.pi / 2, angle_increment=np.pi / 180)
    motion = UncertainPose(np.zeros(3), np.diag([1e-4, 1e-4, 0.04]) + 1e-3 * np.eye(3)[[0, 2, 1]])
    found = []
    for index, scan in ((1, blind), (10, blind), (10, scans[0])):
        growing = GrowingMap(Keyframes(find_matcher("curvescan")), SlamConfig())
        growing.start(scans[0], 0)
        growing.append(scan, step_of(index), motion)
        found.append(growing.graph.edge_covariances[0])
    one, many, matched = found
    np.testing.assert_allclose(many[2, 2] / one[2, 2], 10.0, rtol=1e-3)
    # the sensor goes along with the turn, and no farther across it
    np.testing.assert_allclose(many[1, 2] / one[1, 2], 10.0, rtol=1e-3)
    np.testing.assert_allclose(many[0], one[0])
    assert matched[2, 2] < 1e-4  # one that did


def test_what_came_since_the_last_optimization_is_known_by_the_way_between(scans: list[cs.LaserScan]) -> None:
    growing = GrowingMap(Keyframes(find_matcher("curvescan")), SlamConfig())
    growing.start(scans[0], 0)
    for k in (1, 2, 1, 2):
        growing.append(scans[k], step_of(k), UncertainPose(np.array([0.5, 0.1, 0.3]), np.diag([0.01, 0.02, 0.001])))
    growing.adopt(*solve(growing.graph, growing.config.noise, is_last=False))
    for k in (1, 2):
        growing.append(scans[k], step_of(k), UncertainPose(np.array([0.5, 0.1, 0.3]), np.diag([0.01, 0.02, 0.001])))
    rows = np.array([0, 2, 4, 5])
    relative, covariances = growing.seen_from(rows)
    np.testing.assert_allclose(relative, cs.se2.between(growing.graph.poses[rows], growing.graph.poses[6]))
    np.testing.assert_allclose(covariances[3], growing.along(5)[0].covariance)
    # of those before, what is known of the last one comes first
    np.testing.assert_allclose(covariances[2], growing.since.covariance, atol=1e-12)
    assert np.trace(covariances[1]) > np.trace(covariances[2])
    # a closure moves them, and so does an optimization
    assert growing.is_revised
    growing.is_revised = False
    before, seen = growing.graph.poses.copy(), cs.se2.between(growing.graph.poses[0], growing.graph.poses[6])
    off = seen + np.array([0.3, 0.0, 0.0])
    closure = Closure(
        scan=6, i=0, j=6, pose=off, covariance=1e-4 * np.eye(3), score=0.7, distance=0.0,
        outcome=ClosureOutcome.ACCEPTED, confidence=0.99,
    )  # fmt: skip
    growing.close(closure)
    assert growing.is_revised
    assert np.hypot(*(growing.graph.poses[6] - before[6])[:2]) > 0.1


def test_where_a_track_was_lost_both_that_it_went_on_and_that_it_was_carried_away_are_kept(
    scans: list[cs.LaserScan],
) -> None:
    blind = cs.LaserScan(np.full(181, np.nan), angle_min=-np.pi / 2, angle_increment=np.pi / 180)
    motion = UncertainPose(np.array([0.5, 0.1, 0.3]), np.diag([0.01, 0.02, 0.001]))
    growing, tracked = (GrowingMap(Keyframes(find_matcher("curvescan")), SlamConfig()) for _ in range(2))
    for one, outcome in ((growing, StepOutcome.LOST), (tracked, StepOutcome.PREDICTED)):
        one.start(blind, 0)
        one.append(blind, step_of(1), motion)
        one.append(blind, step_of(2, outcome), motion)
    assert growing.fragments == [0, 0, 1]
    assert tracked.fragments == [0, 0, 0]
    # the map says that nothing is known of the way
    np.testing.assert_array_equal(is_lost(growing.graph.edge_covariances), [False, True])
    np.testing.assert_allclose(
        growing.current_in_map().covariance, tracked.current_in_map().covariance + LOST_COVARIANCE
    )
    # the search for closures has where it went on, before and after an optimization, and in a map that is loaded
    for _ in range(2):
        for found, wanted in zip(growing.seen_from(np.arange(2)), tracked.seen_from(np.arange(2)), strict=True):
            np.testing.assert_allclose(found, wanted, atol=1e-9)
        for one in (growing, tracked):
            one.adopt(*solve(deepcopy(one.graph), one.config.noise, is_last=False))
    assert is_lost(growing.graph.edge_covariances).any()
    continued = GrowingMap(Keyframes(find_matcher("curvescan")), SlamConfig())
    continued.load(growing.snapshot())
    assert continued.fragments == growing.fragments
    # a match ties it, as it ties any step
    growing.append(scans[0], step_of(3), motion)
    growing.append(scans[0], step_of(4, StepOutcome.LOST), UncertainPose(np.zeros(3), motion.covariance))
    assert growing.fragments == [0, 0, 1, 1, 1]
