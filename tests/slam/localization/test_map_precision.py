"""MapPrecision: between two keyframes the map errs by the edges of the best way between them."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan.slam import SlamMap
from curvescan.slam.localization.matching import MapPrecision


def _map(ends: list[tuple[int, int]], sigmas: list[tuple[float, float]], n: int = 5) -> SlamMap:
    """Return a map whose keyframes stand 2 m apart in a row; sigmas are those of position and rotation of each edge."""
    cov = np.array([np.diag([p**2, p**2, r**2]) for p, r in sigmas])
    return SlamMap(
        scans=(),
        poses=np.column_stack((2.0 * np.arange(n), np.zeros(n), np.zeros(n))),
        covariances=np.zeros((n, 3, 3)),
        indices=np.arange(n),
        sessions=np.zeros(n, dtype=np.int64),
        ends=np.array(ends, dtype=np.int64),
        measured=np.zeros((len(ends), 3)),
        edge_covariances=cov,
        kinds=np.zeros(len(ends), dtype=np.int64),
        weights=np.ones(len(ends)),
    )


def test_variances_along_the_way_add_up_with_the_lever_of_the_rotation() -> None:
    precision = MapPrecision(_map([(0, 1), (1, 2)], [(0.03, 0.01), (0.04, 0.02)], n=3))
    rotation = 0.01**2 + 0.02**2
    position = 0.03**2 + 0.04**2 + rotation * 4.0**2
    assert precision.between(0, 2) == pytest.approx(np.diag([position, position, rotation]))
    assert precision.between(2, 0) == pytest.approx(precision.between(0, 2))
    assert not precision.between(1, 1).any()


def test_the_better_of_two_ways_is_taken_and_of_two_edges() -> None:
    ends = [(0, 1), (1, 2), (0, 2), (0, 2)]
    precision = MapPrecision(_map(ends, [(0.3, 0.1), (0.3, 0.1), (0.5, 0.3), (0.02, 0.01)], n=3))
    assert precision.between(0, 2)[2, 2] == pytest.approx(0.01**2)
    assert precision.between(1, 2)[2, 2] == pytest.approx(0.1**2)


def test_of_parts_that_nothing_joins_nothing_is_known() -> None:
    precision = MapPrecision(_map([(0, 1), (2, 3)], [(0.01, 0.01)] * 2, n=4))
    assert precision.between(0, 3)[0, 0] >= 100.0
    assert precision.between(2, 3)[0, 0] < 0.01
    # where no keyframe is known there is nothing to add
    assert not precision.between(-1, 3).any()
