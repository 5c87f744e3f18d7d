"""Place index: signatures do not change with the place of the sensor, and the search finds the most alike."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan import se2
from curvescan.slam.loops.place_index import SIGNATURE_SIZE, PlaceIndex, signature


def _points(seed: int, n: int = 12) -> np.ndarray:
    rng = np.random.default_rng(seed)
    facing = rng.uniform(-3, 3, n)
    return np.column_stack((rng.uniform(-4, 4, (n, 2)), np.cos(facing), np.sin(facing)))


def test_a_signature_stays_as_it_is_when_the_sensor_moves_and_turns() -> None:
    before = _points(1)
    pose = np.array([1.3, -0.7, 0.9])
    after = before.copy()
    after[:, :2] = se2.transform(se2.inverse(pose), before[:, :2])
    after[:, 2:] = se2.transform([0.0, 0.0, -pose[2]], before[:, 2:])
    # float32 of unit length
    assert signature(after) == pytest.approx(signature(before), abs=1e-5)


def test_what_faces_another_way_is_another_place() -> None:
    before = _points(1)
    after = before.copy()
    after[::2, 2:] *= -1.0
    assert signature(after) @ signature(before) < 0.9


def test_a_scan_without_points_is_like_none() -> None:
    assert not signature(np.empty((0, 4))).any()


def test_the_most_similar_is_the_one_that_shares_most_points() -> None:
    index = PlaceIndex()
    for seed in range(50):
        index.append(signature(_points(seed)))
    partly = np.concatenate((_points(17)[:9], _points(1000)[:3]))
    assert index.most_similar(signature(partly), 5)[0] == 17
    slow = [float(signature(_points(k)) @ signature(partly)) for k in range(50)]
    assert index.similarity(signature(partly)) == pytest.approx(slow, abs=1e-6)


def test_of_an_empty_index_nothing_is_similar() -> None:
    assert len(PlaceIndex().most_similar(np.zeros(SIGNATURE_SIZE, dtype=np.float32), 5)) == 0
