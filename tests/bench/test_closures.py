"""SLAM on simulated floors: never worse than its odometry, no false closure on ordinary floors."""

from __future__ import annotations

import numpy as np
import pytest

from closures import floor_of, judge_floor

pytestmark = pytest.mark.slow


@pytest.mark.parametrize(("kind", "seed"), [("ordinary", 30), ("noisy", 3), ("noisy", 31)])
def test_on_an_ordinary_floor_slam_is_better_than_the_odometry_alone(kind: str, seed: int) -> None:
    found = judge_floor(kind, seed)
    assert found.n_false == 0
    assert found.n_revisits > 20
    assert found.n_missed < 0.1 * found.n_revisits
    assert found.slam[0] < found.odometry[0]


def test_where_places_deceive_the_map_is_no_worse_than_the_odometry() -> None:
    found = judge_floor("offices", 0)
    assert not found.is_worse


def test_the_second_lap_on_another_storey_sees_the_same_and_is_elsewhere() -> None:
    scans, truth = floor_of("storeys", 0)
    assert len(scans) == len(truth)
    nothing = [k for k, scan in enumerate(scans) if not scan.valid.any()]
    assert len(nothing) == 30
    below, above = truth[: nothing[0]], truth[nothing[-1] + 1 :]
    np.testing.assert_allclose(above[:, 0] - below[1:, 0], 1000.0)


def test_a_match_that_lies_is_followed_nowhere() -> None:
    found = judge_floor("ordinary", 30, forced=0.2)
    assert found.n_forced > 50
    assert found.n_false == 0
