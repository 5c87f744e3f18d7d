"""Thinning: a place that is seen over and over keeps few keyframes, and every scan still has its pose."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.slam.config import PlacesConfig, SlamConfig
from curvescan.slam.thinning import crowded_places

pytestmark = pytest.mark.slow


def test_memory_follows_the_area_and_not_the_time() -> None:
    made = cs.simulate("room", seed=2, n_scans=260, odometry_noise=None)
    out = list(made)
    there, truth = [*out, *out[::-1]], np.concatenate((made.truth.poses, made.truth.poses[::-1]))
    n_laps, counts, edges = 4, [], []
    slam = cs.Slam(config=SlamConfig(places=PlacesConfig(n_keyframes=2)))
    for _ in range(n_laps):
        for scan in there:
            slam.add(scan)
        counts.append(len(slam.backend.keyframes))
        edges.append(slam.backend.graph.n_edges)
    trajectory = slam.finish()
    assert len(slam.backend.heirs) > 0
    # what comes after the second lap adds next to nothing: the newest thirty stay in any case
    assert counts[-1] < 1.15 * counts[1] + 10
    assert edges[-1] < 1.4 * edges[1]
    assert len(slam.map) == slam.backend.graph.n_poses == len(slam.backend.keyframes.index)
    true = se2.between(truth[0], np.concatenate([truth] * n_laps))
    assert len(trajectory) == len(true)
    assert np.hypot(*(trajectory.poses - true)[:, :2].T).max() < 0.1
    assert trajectory.covariances is not None
    assert np.isfinite(trajectory.covariances).all()


def test_without_a_place_seen_often_nothing_goes() -> None:
    made = cs.simulate("office", seed=1, n_scans=200, odometry_noise=None)
    slam = cs.run(list(made), "slam").engine
    assert len(slam.backend.heirs) == 0


def test_crowded_places_are_those_with_so_many_later_ones_near() -> None:
    rng = np.random.default_rng(4)
    poses = rng.uniform(-1.5, 1.5, (120, 3)) * (1.0, 1.0, 3.0)
    poses[:, 2] = se2.wrap(poses[:, 2])
    fragments = rng.integers(0, 2, 120)
    found = crowded_places(poses, fragments, 90, 0.6, 0.8, 3)
    expected = np.zeros(90, dtype=bool)
    for v in range(1, 90):
        off = poses[v + 1 :] - poses[v]
        near = (np.hypot(off[:, 0], off[:, 1]) < 0.6) & (np.abs(se2.wrap(off[:, 2])) < 0.8)
        expected[v] = np.count_nonzero(near & (fragments[v + 1 :] == fragments[v])) >= 3
    np.testing.assert_array_equal(found, expected)
    assert 5 < np.count_nonzero(found) < 80
    assert not len(crowded_places(poses, fragments, 0, 0.6, 0.8, 3))
