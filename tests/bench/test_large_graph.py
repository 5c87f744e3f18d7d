"""The large pose graph: its edges join poses of neighbouring laps, and err by what they say."""

from __future__ import annotations

import numpy as np

from curvescan.slam.pose_graph.optimization import squared_distances
from large_graph import large_graph


def test_its_edges_err_by_what_they_say_and_join_what_is_near() -> None:
    truth, edges = large_graph(3000)
    assert len(truth) == 3000
    assert len(edges.ends) > 1.3 * len(truth)
    # chi-square of 3 degrees of freedom
    assert 2.8 < squared_distances(truth, edges).mean() < 3.2
    i, j = edges.ends.T
    assert np.hypot(*(truth[i] - truth[j])[:, :2].T).max() < 2.0
