"""Closures: what a match must be like to be accepted."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.matchers import MatchResult, PreparedScan, find_matcher
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam import SlamConfig
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.loop_search import Candidate, choose_candidates, matched
from curvescan.slam.loops.closures import Closure, ClosureOutcome, closure_of, expectation_of
from curvescan.slam.loops.cycles import difference
from curvescan.slam.loops.overlap import range_profile
from curvescan.slam.open_direction import within_sight
from curvescan.types import Floats


@pytest.fixture(scope="module")
def result() -> MatchResult:
    scans = cs.simulate("office", seed=1, n_scans=3, odometry_noise=None)
    found = cs.match(scans[0], scans[2])
    assert found.ok
    assert found.degenerate_direction is None
    return dataclasses.replace(found, confidence=0.95)


@pytest.fixture(scope="module")
def hall() -> cs.Log:
    return cs.simulate("bare-corridor", sensor="spinning-360", seed=1, n_scans=2, odometry_noise=None)


def _tested(
    result: MatchResult,
    off_m: float = 0.0,
    sigma_m: float = 0.02,
    *,
    turn: float = 0.0,
    j: int = 20,
    reach: tuple[float, float] = (1000.0, 1000.0),
) -> Closure:
    """Test a match that lies off along x where the graph knows it to `sigma_m`, and 0.02 rad; reach: of both views."""
    views = (cs.LaserScan(np.full(360, r), angle_min=-np.pi, angle_increment=np.pi / 180.0) for r in reach)
    cov = np.diag(np.square([sigma_m, sigma_m, 0.02]))
    expected = UncertainPose(result.pose - [off_m, 0.0, turn], cov)
    return closure_of(result, expected, SlamConfig(), *views, scan=9, i=0, j=j)


def test_a_match_where_the_graph_surely_expects_it_is_accepted_alone(result: MatchResult) -> None:
    assert _tested(result).outcome is ClosureOutcome.ACCEPTED


@pytest.mark.parametrize(("off_m", "sigma_m"), [(0.0, 2.0), (0.5, 0.05), (3.7, 0.3)])
def test_where_the_graph_is_vague_or_contradicts_it_a_match_waits(
    result: MatchResult, off_m: float, sigma_m: float
) -> None:
    assert _tested(result, off_m, sigma_m).outcome is ClosureOutcome.WAITING


def test_the_farther_off_and_the_vaguer_the_less_the_graph_speaks_for_it(result: MatchResult) -> None:
    by_sigma = [_tested(result, 0.0, sigma).expectation for sigma in (0.02, 0.2, 2.0, 20.0)]
    by_offset = [_tested(result, off, 0.2).expectation for off in (0.0, 0.3, 0.6, 0.9)]
    assert by_sigma == sorted(by_sigma, reverse=True)
    assert by_offset == sorted(by_offset, reverse=True)


def test_a_slip_costs_the_same_however_far_and_more_where_it_turns(result: MatchResult) -> None:
    one, another = (_tested(result, off, 0.02).expectation for off in (1.0, 3.7))
    np.testing.assert_allclose([one, another], -7.3, atol=0.15)
    # a corridor seen from its other end
    assert _tested(result, 0.0, 0.02, turn=np.pi).expectation < -12.0


def test_a_match_says_what_its_confidence_does(result: MatchResult) -> None:
    assert _tested(result).log_odds == pytest.approx(np.log(19.0))


def test_a_view_from_afar_is_accepted_where_the_graph_expects_it_and_waits_elsewhere(result: MatchResult) -> None:
    far = dataclasses.replace(result, pose=np.array([5.0, 0.3, np.pi]))
    assert _tested(far).outcome is ClosureOutcome.ACCEPTED
    assert _tested(far, 2.0).outcome is ClosureOutcome.WAITING


def test_opposite_views_are_candidates_up_to_six_metres_where_the_graph_knows_them(hall: cs.Log) -> None:
    profiles = np.tile(range_profile(hall[0]), (20, 1, 1))
    for distance, sigma, is_chosen in ((5.0, 0.05, True), (7.0, 0.05, False), (5.0, 0.8, False)):
        assert _is_candidate(distance, sigma, profiles) is is_chosen


@pytest.mark.parametrize(("distance", "is_chosen"), [(12.0, True), (13.0, False)])
def test_what_looks_alike_is_a_candidate_up_to_five_standard_deviations_from_within_reach(
    hall: cs.Log, distance: float, is_chosen: bool
) -> None:
    profiles = np.tile(range_profile(hall[0]), (20, 1, 1))
    assert _is_candidate(distance, 2.0, profiles, np.ones(19)) is is_chosen
    assert not _is_candidate(distance, 2.0, profiles, np.zeros(19))
    # one of another part of the map, whose track was lost, may be anywhere
    assert _is_candidate(distance, 0.02, profiles, np.ones(19), is_apart=True)


def _is_candidate(
    distance: float, sigma: float, profiles: Floats, similarity: Floats | None = None, *, is_apart: bool = False
) -> bool:
    """Return whether one of 19 keyframes is asked, metres off by the graph, which knows it so well, metres."""
    relative = np.tile([60.0, 0.0, 0.0], (19, 1))
    relative[2] = distance, 0.0, np.pi
    covariances = np.tile(np.diag(np.square([sigma, sigma, 0.02])), (19, 1, 1))
    chosen = choose_candidates(19, np.arange(19), (relative, covariances), SlamConfig(), profiles, similarity, is_apart)
    return 2 in [c.i for c in chosen]


def test_of_a_matcher_without_a_confidence_the_graph_decides(result: MatchResult) -> None:
    silent = dataclasses.replace(result, confidence=float("nan"))
    assert _tested(silent).outcome is ClosureOutcome.ACCEPTED
    assert _tested(silent, 0.0, 2.0).outcome is ClosureOutcome.WAITING


def test_what_a_match_leaves_open_says_nothing_and_stays_open(result: MatchResult) -> None:
    along_x = dataclasses.replace(result, degenerate_direction=np.array([1.0, 0.0, 0.0]))
    near, far = _tested(along_x), _tested(along_x, 2.0, 1.0)  # of views that reach to the end of the corridor
    assert near.covariance[0, 0] > 1e3
    assert near.expectation < _tested(result).expectation
    # across nothing is known better, along it is not measured
    np.testing.assert_allclose(far.expectation, _tested(along_x, 0.0, 1.0).expectation, atol=0.01)
    # the edge stands where the graph has it: far off along a corridor the least turn would push across it
    np.testing.assert_allclose(far.pose, along_x.pose - [2.0, 0.0, 0.0])


def test_scans_that_see_no_one_place_where_the_graph_has_them_are_of_other_walls(result: MatchResult) -> None:
    """In a tunnel seen 4 m far: as much speaks for a place a metre off, and less for one of 8 m."""
    along_x = dataclasses.replace(result, degenerate_direction=np.array([1.0, 0.0, 0.0]))
    far_views = _tested(along_x, 0.0, 1.0).expectation
    here, near, far = (_tested(along_x, off, 1.0, reach=(4.0, 4.0)).expectation for off in (0.0, 1.0, 8.0))
    assert here == pytest.approx(far_views, abs=0.02)  # that they see one place does not speak for them
    assert near == pytest.approx(far_views, abs=0.02)
    variance = (4.0 * 4.0) ** 2 / 24.0 + 1.0
    gained = 0.5 * np.log((variance + 100.0) / variance)
    assert far == pytest.approx(far_views + gained - 0.5 * 8.0**2 / variance, rel=0.1)
    assert far < far_views - 1.0
    # what a long view shares with a short one on its way
    assert _tested(along_x, 8.0, 1.0, reach=(30.0, 4.0)).expectation == pytest.approx(far_views, abs=0.02)


def test_a_half_circle_that_looks_ahead_sees_what_one_from_ahead_does() -> None:
    """A view to x of 0 to 10 m, and one from ahead that looks back: they share most of it 10 m apart."""
    ranges = np.where(np.abs(np.linspace(-np.pi, np.pi, 361)) < np.pi / 2.0, 10.0, np.nan)
    view = cs.LaserScan(ranges, angle_min=-np.pi, angle_increment=np.pi / 180.0)
    found = UncertainPose(np.array([0.0, 0.0, np.pi]), np.diag([4000.0, 1e-4, 1e-4]))
    claimed = within_sight(found, np.array([1.0, 0.0, 0.0]), view, view)
    assert claimed.pose == pytest.approx([10.0, 0.0, np.pi], abs=0.2)
    assert claimed.covariance[0, 0] == pytest.approx(20.0**2 / 24.0, rel=0.05)
    np.testing.assert_allclose(claimed.covariance[1:, 1:], found.covariance[1:, 1:])


@pytest.mark.parametrize("turn", [1e-3, 0.3, 1.7, -3.0])
def test_what_lies_behind_a_turn_of_any_size_is_off_along_one_line(turn: float) -> None:
    hinge, behind = np.array([4.0, -2.0, 0.3]), np.array([6.0, 1.0, -1.0])
    expected, found = (se2.compose(hinge, se2.compose([0.0, 0.0, angle], behind)) for angle in (0.0, turn))
    off = difference(expected, found)
    lever = expected[:2] - hinge[:2]
    np.testing.assert_allclose(off, turn * np.array([-lever[1], lever[0], 1.0]), atol=1e-12)


def test_behind_a_turn_that_nobody_saw_the_heading_found_tells_the_place(result: MatchResult) -> None:
    """A round room: the place is unknown as the turn is, and the two together are known to decimetres."""
    lever, turned = np.array([-2.0, 1.0, 1.0]), 1.5
    cov = turned**2 * np.outer(lever, lever) + np.diag([0.04, 0.04, 0.01])
    for off, is_likely in ((np.zeros(3), True), (1.2 * lever, True), (1.2 * lever * [-1.0, -1.0, 1.0], False)):
        assert bool(expectation_of(off, cov, SlamConfig(), is_open=False) > 3.0) is is_likely
    # corridors run side by side, whatever their heading
    one, another = (expectation_of(np.zeros(3), cov, SlamConfig(), is_open=is_open) for is_open in (True, False))
    assert one < another - 1.0


def test_a_lost_sensor_went_on_or_was_carried_anywhere() -> None:
    """Where it went on it is as likely as without the loss; 8 m off it is no slip, and no one match shows it."""
    cov, config = np.diag([0.04, 0.04, 0.01]), SlamConfig()
    here, off = np.zeros(3), np.array([8.0, 0.0, 0.0])
    on, away, slipped = (
        expectation_of(where, cov, config, is_open=False, is_apart=is_apart)
        for where, is_apart in ((here, True), (off, True), (off, False))
    )
    assert on == expectation_of(here, cov, config, is_open=False) > 5.0
    assert slipped < away < 0.0
    farther = expectation_of(2.0 * off, cov, config, is_open=False, is_apart=True)
    assert farther == pytest.approx(away, abs=0.2)


def test_neighbours_are_not_tied_where_nothing_tells_how_they_lie(result: MatchResult) -> None:
    """A few rooms of a corridor apart all its rooms may look alike."""
    assert _tested(result, j=10).outcome is ClosureOutcome.ACCEPTED
    assert _tested(result, 0.0, 3.0, j=10).outcome is ClosureOutcome.UNEXPECTED
    assert _tested(result, 0.0, 3.0, j=11).outcome is ClosureOutcome.WAITING


def test_a_loop_closure_links_keyframes_far_apart_along_the_path(result: MatchResult) -> None:
    for j, is_loop in ((9, False), (10, False), (11, True), (500, True)):
        assert _tested(result, j=j).is_loop is is_loop


class Decided(Keyframes):
    """Keyframes whose matches a guess decides between several places."""

    def match(self, i: int, current: PreparedScan, prior: UncertainPose | None) -> MatchResult:
        return dataclasses.replace(super().match(i, current, prior), is_guess_decisive=True)


@pytest.mark.parametrize(("kind", "is_known"), [(Keyframes, True), (Decided, False)])
def test_the_way_between_places_that_a_guess_decides_between_is_open(kind: type[Keyframes], is_known: bool) -> None:
    scans = cs.simulate("office", seed=1, n_scans=3, odometry_noise=None)
    keyframes, poses = kind(find_matcher("curvescan")), np.zeros((13, 3))
    for scan in [scans[0]] * 12 + [scans[2]]:
        keyframes.add(scan, 0)
    poses[12] = se2.between(*scans.truth.poses[[0, 2]])
    [found] = matched(keyframes, poses, SlamConfig(), 0, [Candidate(0, 12, 1e-4 * np.eye(3))])
    assert found.is_accepted
    assert bool(np.linalg.eigvalsh(found.covariance[:2, :2])[1] < 1.0) is is_known
