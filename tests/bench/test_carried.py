"""Drives that are carried to another room: the rooms are as said, and odometry loses its track."""

from __future__ import annotations

import numpy as np
import pytest

from carried import HALF, KNOWN_M, drive, furnished, sigma_of_the_end

pytestmark = pytest.mark.slow


def test_rooms_and_their_boxes_are_as_said() -> None:
    for seed in range(50):
        world = furnished(np.random.default_rng(seed))
        x0, y0, x1, y1 = world.bounds.tolist()
        assert 6.0 <= x1 - x0 <= 14.0
        assert 5.0 <= y1 - y0 <= 12.0
        assert 5 <= len(world.boxes) <= 12


def test_a_sensor_that_is_carried_is_not_sure_of_the_wrong_room() -> None:
    """Four of these fourteen drives were, before the time bounded how far a sensor gets unseen."""
    seeds = range(7501830, 7501970, 10)
    before = [drive(seed, 12, HALF) for seed in seeds]
    ends = [
        sigma_of_the_end([*scans, *drive(seed + 1, 20, HALF)]).max() for seed, scans in zip(seeds, before, strict=True)
    ]
    assert max(sigma_of_the_end(scans).max() for scans in before) < 0.1  # a drive that goes on knows where it is
    assert np.sum(np.array(ends) < KNOWN_M) == 0
