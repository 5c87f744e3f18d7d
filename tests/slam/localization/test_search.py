"""Search of a whole map: the right pose is among the likely ones; a place is sure where no other comes near."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam import SlamMap
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.localization.correlative import contour_length, is_same, likely_poses, thinned
from curvescan.slam.localization.field import DistanceField, field_of
from curvescan.slam.localization.prior import Prior
from curvescan.slam.localization.search import MapSearch, Place, Views, said
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


def _views(*found: Place, contour: float = 0.0) -> Views:
    return Views(found=found, contour=contour)


def _place(x: float, support: float, view: float | None = None) -> Place:
    view = support if view is None else view
    return Place(pose=np.array([x, 0.0, 0.0]), fit=0.6 + view, view=view, support=support)


@pytest.mark.parametrize(
    ("found", "is_sure"),
    [
        ([(0.0, 0.3)], True),
        ([(0.0, 0.1)], False),  # too little
        ([(0.0, 0.3), (3.0, 0.25)], False),  # another is nearly as good
        ([(0.0, 0.3), (3.0, 0.1)], True),
        ([(0.0, 2.0), (3.0, 1.7)], False),  # many views say nearly the same of both
        ([(0.0, 2.0), (3.0, 1.4)], True),
    ],
)
def test_a_place_is_sure_where_no_other_comes_near(found: list[tuple[float, float]], is_sure: bool) -> None:
    views = _views(*[_place(x, support) for x, support in found])
    assert (views.winner is not None) is is_sure


def test_several_views_together_need_more_than_one() -> None:
    assert _views(_place(0.0, 0.3, 0.3)).winner is not None
    assert _views(_place(0.0, 0.3, 0.15)).winner is None
    assert _views(_place(0.0, 1.1, 0.15)).winner is not None
    # a sensor that drives out of the map is not where the views before it left
    assert _views(_place(0.0, 1.4, -0.02)).winner is None


@pytest.mark.parametrize(
    ("fit", "rival", "contour", "is_sure"),
    [
        (0.8, 0.3, 12.0, True),
        (0.8, 0.52, 12.0, False),  # places that the map does not show are ahead by 0.28
        (0.95, 0.7, 12.0, True),  # the less is left open the less it needs to be ahead
        (0.8, 0.3, 6.0, False),  # three sides of a booth
        (0.58, -0.4, 12.0, False),  # alone, and the map says too little
    ],
)
def test_a_view_that_agrees_with_one_place_far_better_than_with_any_other_is_enough(
    fit: float, rival: float, contour: float, is_sure: bool
) -> None:
    # what the views say does not tell a rival of 0.3 from one of 0.45
    said_of = [max(f - 0.6, -0.15) for f in (fit, rival)]
    # the view alone is not enough by the other rules
    said_of[0] = min(said_of[0], 0.25)
    found = [
        Place(pose=np.array([x, 0.0, 0.0]), fit=f, view=v, support=v)
        for x, f, v in zip((0.0, 3.0), (fit, rival), said_of, strict=True)
    ]
    assert (_views(*found, contour=contour).winner is not None) is is_sure


@pytest.mark.parametrize(("begins_at", "is_sure"), [(1.3, True), (60.0, False)])
def test_what_the_views_decide_alone_stands_where_it_was_likely_before(
    stored: SlamMap, field: DistanceField, begins_at: float, is_sure: bool
) -> None:
    # a corridor: 0.7 m on the view agrees less, and an initial pose beyond makes that place the likelier one
    views = _views(_place(0.0, 0.39), _place(0.7, 0.28))
    assert views.winner is not None
    prior = Prior.of((begins_at, 0.0, 0.0), np.diag([0.5, 0.5, 0.07]))
    likely = MapSearch(field, stored.poses, Keyframes("curvescan", None, 1), 5).known(
        prior, np.array([[0.0, 0.0, 0.0], [0.7, 0.0, 0.0]])
    )
    found = [replace(place, prior=float(k)) for place, k in zip(views.found, likely, strict=True)]
    assert (likely[0] > 0.0) == is_sure
    assert (replace(views, found=found).winner is not None) is is_sure


@pytest.mark.parametrize(("rival_view", "is_sure"), [(-0.15, False), (-0.4, True)])
def test_what_was_known_before_does_not_choose_between_places_that_the_view_is_against(
    rival_view: float, is_sure: bool
) -> None:
    # a corridor without a mark: the odometry has the sensor at 0, and perhaps 1.2 m on; no place stands out by itself
    here, there = _place(0.0, -0.15), _place(1.2, rival_view)
    views = _views(replace(here, prior=0.5), replace(there, prior=0.16))
    assert (views.winner is not None) is is_sure


@pytest.mark.parametrize(
    ("support", "view", "prior", "is_sure"),
    [
        (1.3, 0.15, 0.0, True),
        (1.3, 0.15, -0.01, True),  # several views, where the sensor may as well be
        (3.6, 0.15, -0.1, False),  # many views along a corridor that repeats, and a track that nothing broke
        (0.4, 0.4, -0.1, True),  # one view that is clear
        (0.0, 0.0, 0.4, True),  # next to nothing, where it was expected
        (-0.15, -0.15, 0.4, False),
    ],
)
def test_a_prior_adds_to_what_the_views_say(support: float, view: float, prior: float, is_sure: bool) -> None:
    place = replace(_place(0.0, support, view), prior=prior)
    assert (_views(place).winner is not None) is is_sure
    # of two places that look alike it chooses one
    alike = replace(_place(3.0, support, view), prior=prior - 0.5)
    assert (_views(alike, place).winner is place) is is_sure


def test_one_view_does_not_overrule_those_before() -> None:
    assert _views(_place(0.0, -0.3, 0.3)).winner is None


@pytest.mark.slow
def test_support_is_carried_on_by_the_motion(stored: SlamMap, field: DistanceField) -> None:
    poses = lap()[[10, 20, 30]]
    search = MapSearch(field, stored.poses, Keyframes("curvescan", None, 1), 5)
    supports: list[float] = []
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
    fit = field.agreement(points, pose).score
    whole, part = contour_length(points), contour_length(points[:30])
    assert said(whole, fit) > 0.2
    assert said(part, fit) < 0.5 * said(whole, fit)
