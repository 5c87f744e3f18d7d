"""simulate_pairs(): places with room and view, motions as asked, people, seeds."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from curvescan import se2
from curvescan.errors import InvalidArgumentError
from curvescan.simulation import World, build_world, simulate_pairs

N = 6


@pytest.fixture(scope="module")
def pairs():
    return list(simulate_pairs(n_pairs=N, translation_max=0.6, rotation_max=0.7, seed=1))


def test_each_pair_is_free_and_sees_enough(pairs):
    for pair in pairs:
        current_pose = se2.compose(pair.reference_pose, pair.pose)
        places = np.array([pair.reference_pose[:2], current_pose[:2]])
        assert pair.world.is_free(places, 0.4).all()
        for scan in (pair.reference, pair.current):
            assert scan.valid.mean() > 0.55  # 0.6 before dropouts
        assert not pair.is_person_ref.any()
        assert not pair.is_person_cur.any()


def test_the_pose_brings_the_current_scan_onto_the_world(pairs):
    for pair in pairs:
        to_world = se2.compose(pair.reference_pose, pair.pose)
        points = se2.transform(to_world, pair.current.points[pair.current.valid])
        surfaces = World(walls=pair.world.segments, circles=np.empty((0, 3)), arcs=pair.world.arcs)
        gap = np.minimum(surfaces.distance(points), _to_circles(points, pair.world.circles))
        assert gap.max() < 0.06  # six sigma of an LMS200


def _to_circles(points, circles):
    if not len(circles):
        return np.full(len(points), np.inf)
    offset = points[:, np.newaxis] - circles[:, :2]
    return np.abs(np.hypot(offset[..., 0], offset[..., 1]) - circles[:, 2]).min(axis=1)


def test_pair_i_is_pair_i_whatever_is_asked(pairs):
    fewer = simulate_pairs(n_pairs=3, translation_max=0.6, rotation_max=0.7, seed=1)
    for pair, again in zip(pairs, [fewer[0], fewer[-2], *fewer[2:]], strict=False):
        assert np.array_equal(pair.pose, again.pose)
        assert np.array_equal(pair.reference.ranges, again.reference.ranges, equal_nan=True)
        assert np.array_equal(pair.current.ranges, again.current.ranges, equal_nan=True)
    with pytest.raises(IndexError, match="pair 3 of 3"):
        fewer[3]


def test_worlds_are_fresh_for_each_pair_or_given(pairs):
    assert len({len(pair.world.segments) + pair.world.bounds[2] for pair in pairs}) == N
    room = build_world("round-room")
    assert simulate_pairs(room, n_pairs=1)[0].world is room


def test_motions_fill_their_disc_and_interval():
    motions = simulate_pairs("room", n_pairs=800, translation_max=0.3, rotation_max=0.5).motions
    radius = np.hypot(motions[:, 0], motions[:, 1])
    assert radius.max() <= 0.3
    # uniform in a disc: half the area within 0.3 / sqrt 2; five standard errors of a share
    assert np.mean(radius < 0.3 / np.sqrt(2.0)) == pytest.approx(0.5, abs=2.5 / np.sqrt(800))
    assert np.abs(motions[:, 2]).max() <= 0.5
    assert np.mean(motions[:, 2]) == pytest.approx(0.0, abs=5.0 * 0.29 / np.sqrt(800))


def test_motions_may_be_given():
    given = [[0.1, 0.0, 0.2], [0.0, -0.1, -0.2]]
    pairs = simulate_pairs("room", motions=given)
    assert len(pairs) == 2
    np.testing.assert_allclose(pairs[1].pose, given[1], atol=1e-12)


def test_people_take_their_share_and_are_others_in_each_scan():
    pairs = list(replace(simulate_pairs("room", n_pairs=8, people_share=0.15, seed=2), clearance=1.0))
    shares = [[p.is_person_ref.mean(), p.is_person_cur.mean()] for p in pairs]
    assert np.mean(shares) == pytest.approx(0.15, abs=0.025)
    assert not any(np.array_equal(p.is_person_ref, p.is_person_cur) for p in pairs)
    alone = replace(simulate_pairs("room", n_pairs=1, seed=2), clearance=1.0)[0]
    assert np.array_equal(alone.pose, pairs[0].pose)
    is_seen = ~pairs[0].is_person_ref & pairs[0].reference.valid
    np.testing.assert_array_equal(alone.reference.ranges[is_seen], pairs[0].reference.ranges[is_seen])


def test_a_world_too_narrow_is_told():
    with pytest.raises(InvalidArgumentError, match=r"no place in 'room' is 5\.0 m clear"):
        replace(simulate_pairs("room", n_pairs=1), clearance=5.0)[0]


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"world": "ofice"}, "did you mean 'office'"),
        ({"sensor": "sick"}, "did you mean 'sick-lms200'"),
        ({"n_pairs": 0}, "n_pairs must be >= 1, got 0"),
        ({"people_share": 1.0}, r"people_share must lie in \[0, 0.9\], got 1.0"),
        ({"motions": np.zeros(3)}, r"motions must be finite, of shape \(n_pairs, 3\)"),
        ({"translation_max": -0.1}, "must be >= 0 and finite"),
        ({"rotation_max": np.nan}, "must be >= 0 and finite"),
    ],
)
def test_bad_arguments_are_refused(bad, message):
    with pytest.raises(InvalidArgumentError, match=message):
        simulate_pairs(**bad)


@pytest.mark.parametrize(
    ("bad", "message"),
    [({"clearance": -1.0}, "clearance must be >= 0"), ({"sight_share": 1.5}, r"sight_share must lie in \[0, 1\]")],
)
def test_bad_settings_are_refused(bad, message):
    with pytest.raises(InvalidArgumentError, match=message):
        replace(simulate_pairs(n_pairs=1), **bad)
