"""Walls: what agrees besides the longest ones."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan.matchers.curvescan.assessment.evidence import excess_lengths
from curvescan.matchers.curvescan.features.surfels import LENGTH, NX, NY
from tests.matchers.curvescan.assessment.test_evidence import wall


def test_what_agrees_besides_two_walls_is_excess():
    two = np.vstack([wall(3, -2, 3, 2), wall(-2, 2, 3, 2)])
    three = np.vstack([two, wall(-2, -2, 3, -2)])
    assert excess_lengths(two, np.ones(len(two), dtype=np.uint8))[0] < 0.2
    # both long walls run the same way: one of them, and the short one across it, do not count
    excess, beyond = excess_lengths(three, np.ones(len(three), dtype=np.uint8))
    assert excess == pytest.approx(5.0, abs=0.3)
    assert beyond < 0.2
    codes = np.ones(len(three), dtype=np.uint8)
    codes[80:] = 2  # what does not agree is no excess
    assert excess_lengths(three, codes)[0] < 0.2
    assert excess_lengths(three, np.zeros(len(three), dtype=np.uint8)) == (0.0, 0.0)


def test_nothing_of_a_bare_room_lies_beyond_its_four_walls():
    room = np.vstack([wall(3, -2, 3, 2), wall(-2, 2, 3, 2), wall(-2, -2, 3, -2), wall(-2, -2, -2, 2)])
    assert excess_lengths(room, np.ones(len(room), dtype=np.uint8))[1] < 0.3
    # a second wall that faces the same way, and one across a corner, are no sides of a rectangle
    for more in (wall(1.5, 0.5, 1.5, 1.5), wall(2.2, 2.0, 3.0, 1.2)):
        furnished = np.vstack([room, more])
        beyond = excess_lengths(furnished, np.ones(len(furnished), dtype=np.uint8))[1]
        assert beyond == pytest.approx(np.sum(more[:, LENGTH]), abs=0.4)


@pytest.mark.parametrize(("turn", "excess"), [(5.0, 0.0), (15.0, 0.5)])
def test_what_faces_another_way_than_its_wall_is_excess(turn, excess):
    """Readings within 0.12 m of a wall's line are of the wall where they face as it does, to 11 degrees."""
    walls = np.vstack([wall(3, -2, 3, 2), wall(-2, 2, 3, 2)])
    corner = wall(3.02, -1, 3.02, -0.5, n=10)
    angle = np.radians(180.0 + turn)
    corner[:, NX], corner[:, NY] = np.cos(angle), np.sin(angle)
    surfels = np.vstack([walls, corner])
    found = excess_lengths(surfels, np.ones(len(surfels), dtype=np.uint8))[0]
    plain = excess_lengths(walls, np.ones(len(walls), dtype=np.uint8))[0]
    assert found - plain == pytest.approx(excess, abs=0.15)
