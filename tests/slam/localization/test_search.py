"""Search of a whole map: the right pose is among the likely ones; a place is sure where no other comes near."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.mapping.config import OccupancyConfig
from curvescan.mapping.occupancy import OccupancyGrid
from curvescan.matchers import find_matcher
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam import SlamMap
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.localization.correlative import contour_length, is_same, likely_poses, thinned
from curvescan.slam.localization.field import DistanceField, field_of, field_of_grid
from curvescan.slam.localization.search import MapSearch, Place, Said, Views, said
from tests.slam.map_example import FILE, lap, scans


@pytest.fixture(scope="module")
def stored() -> SlamMap:
    return cs.load_map(FILE)


@pytest.fixture(scope="module")
def field(stored: SlamMap) -> DistanceField:
    return field_of(stored)


def _points(scan: cs.LaserScan) -> np.ndarray:
    return np.ascontiguousarray(scan.points[scan.valid])


@pytest.mark.slow
def test_the_first_of_the_likely_poses_is_right_wherever_the_sensor_looks(field: DistanceField) -> None:
    rng = np.random.default_rng(4)
    poses = lap()[rng.integers(0, 150, 20)]
    poses[:, 2] = rng.uniform(-np.pi, np.pi, 20)  # the map was made looking ahead
    places = field.places(0.3, 0.15)
    for pose, scan in zip(se2.between(lap()[0], poses), scans(poses, seed=6), strict=True):
        found = likely_poses(field, places, thinned(_points(scan)), 3)
        off = se2.between(np.broadcast_to(pose, found.shape), found)
        right = (np.hypot(off[:, 0], off[:, 1]) < 0.15) & (np.abs(off[:, 2]) < 0.05)
        assert right[0]


def test_readings_are_thinned_along_the_contour() -> None:
    near = np.column_stack((np.full(100, 1.0), np.linspace(-1.0, 1.0, 100)))
    far = np.column_stack((np.linspace(-2.0, 2.0, 21), np.full(21, 3.0)))
    points = np.concatenate((near, far))
    few = thinned(points, 30)
    assert 25 <= len(few) <= 30
    assert np.count_nonzero(few[:, 1] == 3.0) > 15
    # two walls of 2 and 4 m, and the jump between them counted as 0.3 m
    assert contour_length(points) == pytest.approx(6.3)


def test_nothing_is_likely_without_readings(field: DistanceField) -> None:
    assert likely_poses(field, field.places(0.3, 0.15), np.zeros((3, 2)), 5).shape == (0, 3)
    assert likely_poses(field, np.empty((0, 2)), np.ones((30, 2)), 5).shape == (0, 3)


def _place(
    x: float, support: float, view: float | None = None, prior: float = 0.0, matches: tuple[float, float] = (0.0, 0.0)
) -> Place:
    view = support if view is None else view
    in_view, in_all = matches
    return Place(
        pose=np.array([x, 0.0, 0.0]),
        view=Said(view + in_view, view),
        support=Said(support + in_all, support),
        prior=prior,
    )


@pytest.mark.parametrize(
    ("views", "is_sure"),
    [
        ([0.3], True),  # no other place at all
        ([-0.05], False),  # alone, and the view is against it
        ([0.45, 0.4], False),  # another is nearly as good
        ([0.3, 0.15], False),  # what it says and how far it is ahead are not enough
        ([0.38, 0.08], True),
        ([0.2, -0.25], False),
        ([0.2, -0.5], True),  # the less another place agrees, the less needs to be said
        ([0.48, 0.39], False),  # the margin
        ([0.48, 0.37], True),
    ],
)
def test_a_place_is_sure_where_what_is_said_and_how_far_it_is_ahead_are_enough(
    views: list[float], is_sure: bool
) -> None:
    found = [_place(3.0 * k, view) for k, view in enumerate(views)]
    assert (Views(found=found).winner is not None) is is_sure


@pytest.mark.parametrize(
    ("best", "other", "is_sure"),
    [
        (_place(0.0, 1.4, 0.15), _place(3.0, 0.6, 0.1), True),
        (_place(0.0, 1.3, 0.15), _place(3.0, 1.0, 0.1), False),
        (_place(0.0, 2.5, 0.15), _place(3.0, 2.45, 0.1), False),  # views that say the same of both do not help
        (_place(0.0, 2.0, -0.02), _place(3.0, 0.3, -0.1), False),  # it has driven out of the map since
    ],
)
def test_several_views_together_need_more_than_one(best: Place, other: Place, is_sure: bool) -> None:
    assert (Views(found=[best, other]).winner is best) is is_sure


@pytest.mark.parametrize(
    ("support", "view", "prior", "is_sure"),
    [
        (1.9, 0.1, 0.0, True),
        (1.9, 0.1, -0.01, True),  # several views, where the sensor may as well be
        (3.6, 0.15, -0.1, False),  # many views along a corridor that repeats, and a track that nothing broke
        (0.5, 0.5, -0.1, True),  # one view that is clear
        (0.0, 0.0, 0.4, True),  # next to nothing, where it was expected
        (-0.15, -0.15, 0.2, False),
    ],
)
def test_a_prior_adds_to_what_the_views_say(support: float, view: float, prior: float, is_sure: bool) -> None:
    place, alike = _place(0.0, support, view, prior), _place(3.0, support, view, prior - 0.5)
    # of two places that look alike it chooses one
    assert (Views(found=[alike, place]).winner is place) is is_sure


@pytest.mark.parametrize(("n_nowhere", "is_sure"), [(0, True), (1, False)])
def test_several_views_must_say_more_after_views_that_fit_nowhere(n_nowhere: int, is_sure: bool) -> None:
    found = [_place(0.0, 1.4, 0.1), _place(3.0, 0.4, 0.1)]
    assert (Views(found=found, n_nowhere=n_nowhere).winner is found[0]) is is_sure


def test_one_view_does_not_overrule_those_before() -> None:
    assert Views(found=[_place(0.0, 0.6)]).winner is not None
    assert Views(found=[_place(0.0, -0.3, 0.6)]).winner is None


@pytest.mark.parametrize("by_walls", [0.05, 0.15])
@pytest.mark.parametrize("views", [(0.25, 0.25, (0.2, 0.2)), (1.2, 0.1, (0.0, 0.6))])
def test_matches_do_not_decide_between_places_whose_walls_look_alike(
    by_walls: float, views: tuple[float, float, tuple[float, float]]
) -> None:
    support, view, matches = views
    best, other = _place(0.0, support, view, matches=matches), _place(3.0, support - by_walls, view - by_walls)
    assert (Views(found=[other, best]).winner is best) is (by_walls > 0.1)
    assert Views(found=[other, _place(0.0, support, view)]).winner is None  # nor do walls without them


def test_a_place_is_best_by_the_margin() -> None:
    views = Views(found=[_place(0.0, 0.3), _place(3.0, 0.1, prior=0.05)])
    assert views.is_best(np.zeros(3), 0.26)
    assert not views.is_best(np.zeros(3), 0.24)


@pytest.mark.slow
def test_support_is_carried_on_by_the_motion(stored: SlamMap, field: DistanceField) -> None:
    poses = lap()[[10, 20, 30]]
    search = MapSearch(field, stored.poses, Keyframes(find_matcher("curvescan")))
    supports: list[Said] = []
    views = None
    for k, scan in enumerate(scans(poses, seed=2)):
        moved = UncertainPose(se2.between(poses[k - 1], poses[k]), np.zeros((3, 3)))
        views = search.look(scan, before=(views, moved) if views else None)
        best = views.found[0]
        assert is_same(best.pose, se2.between(lap()[0], poses[k]))
        supports.append(best.support)
    assert supports[0] < supports[1] < supports[2]
    # without the motion between them views do not add up
    first = search.look(scans(poses[:1], seed=2)[0]).found[0]
    assert first.support == first.view


@pytest.mark.slow
def test_a_view_of_little_says_little(stored: SlamMap, field: DistanceField) -> None:
    pose = se2.between(lap()[0], lap()[20])
    points = _points(scans(lap()[20:21], seed=2)[0])
    fit = field.agreement(points, pose)
    whole, part = contour_length(points), contour_length(points[:30])
    assert said(whole, fit).by_walls > 0.2
    assert said(part, fit).by_walls < 0.5 * said(whole, fit).by_walls


def test_places_along_a_corridor_move_on_with_the_sensor_and_pay_where_they_slide() -> None:
    log_odds = np.full((80, 400), -4.0, dtype=np.float32)
    log_odds[[20, 60]] = 4.0
    corridor = field_of_grid(OccupancyGrid(log_odds=log_odds, origin=np.array([-10.0, -2.0]), config=OccupancyConfig()))
    search = MapSearch(corridor, np.zeros((1, 3)), Keyframes(find_matcher("curvescan")))
    x = np.repeat(np.linspace(-3.0, 3.0, 60), 2)
    walls = np.column_stack((x, np.tile((-1.0 + 0.025, 1.0 + 0.025), 60)))
    views = Views(found=[Place(pose=np.zeros(3), view=Said(0.2, 0.2), support=Said(1.0, 1.0))])
    sure = np.diag(np.square([0.01, 0.01, 0.01]))
    poses, supports = search._carried(views, UncertainPose(np.array([0.4, 0.0, 0.0]), sure), walls, thinned(walls))
    assert np.allclose(poses, [[0.4, 0.0, 0.0]])
    assert np.allclose(supports, 1.0)
    # across it the walls say more than a motion that is not known so well
    poses, supports = search._carried(views, UncertainPose(np.array([0.0, 0.3, 0.0]), sure), walls, thinned(walls))
    assert abs(poses[0, 1]) < 0.1
    assert 0.8 < supports.max() < 0.98
