"""Place index: signatures do not change with the place of the sensor, and the search finds the most alike."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan import se2
from curvescan.slam.loops.place_index import SIGNATURE_SIZE, PlaceIndex, signature


def _keypoints(seed: int, n: int = 12) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.column_stack((rng.uniform(-4, 4, (n, 2)), rng.uniform(-3, 3, n), rng.choice([-1.0, 0.0, 1.0], n)))


def test_a_signature_stays_as_it_is_when_the_sensor_moves_and_turns() -> None:
    before = _keypoints(1)
    pose = np.array([1.3, -0.7, 0.9])
    after = before.copy()
    after[:, :2] = se2.transform(se2.inverse(pose), before[:, :2])
    after[:, 2] = se2.wrap(before[:, 2] - pose[2])
    # float32 of unit length
    assert signature(after) == pytest.approx(signature(before), abs=1e-5)


def test_a_scan_without_keypoints_is_like_none() -> None:
    assert not signature(np.empty((0, 5))).any()


def test_the_most_similar_is_the_one_that_shares_most_keypoints() -> None:
    index = PlaceIndex()
    for seed in range(50):
        index.append(signature(_keypoints(seed)))
    partly = np.concatenate((_keypoints(17)[:9], _keypoints(1000)[:3]))
    assert index.most_similar(signature(partly), 5)[0] == 17
    slow = [float(signature(_keypoints(k)) @ signature(partly)) for k in range(50)]
    assert index.similarity(signature(partly)) == pytest.approx(slow, abs=1e-6)


def test_of_an_empty_index_nothing_is_similar() -> None:
    assert len(PlaceIndex().most_similar(np.zeros(SIGNATURE_SIZE, dtype=np.float32), 5)) == 0
