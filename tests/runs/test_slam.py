"""The results folder of SLAM: a map that was continued shows what all of its sessions saw."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import curvescan as cs
from tests.slam.map_example import FILE, ROOM, lap


@pytest.mark.slow
def test_the_occupancy_of_a_continued_map_is_that_of_all_sessions(tmp_path: Path) -> None:
    stored = cs.load_map(FILE)
    # the second session sees a part of the room
    log = cs.simulate(ROOM, poses=lap()[:25], seed=2, odometry_noise=None)
    cs.run(log, "slam", map=FILE, out=tmp_path)
    both = cs.load_map(tmp_path / "map.csmap")
    assert both.n_sessions == 2
    assert both.grid is not None
    assert stored.grid is not None
    n_both = len(both.grid.occupied_centres)
    assert n_both > 0.9 * len(stored.grid.occupied_centres)
    low, high = both.grid.occupied_centres.min(axis=0), both.grid.occupied_centres.max(axis=0)
    before = stored.grid.occupied_centres
    assert np.allclose(low, before.min(axis=0), atol=0.2)
    assert np.allclose(high, before.max(axis=0), atol=0.2)
