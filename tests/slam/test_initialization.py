"""Chordal initialization: right from nothing but the edges."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan import se2
from curvescan.slam.pose_graph.initialization import chordal_poses
from curvescan.slam.pose_graph.optimization import optimize
from tests.slam.graphs import ladder, loop, measured_edges

_ANCHOR = np.array([0])


def test_without_noise_it_is_the_truth() -> None:
    truth = loop(30)
    edges = measured_edges(truth, ladder(30), seed=1)
    exact = edges._replace(measured=se2.between(truth[edges.ends[:, 0]], truth[edges.ends[:, 1]]))
    found = chordal_poses(np.zeros((30, 3)), exact, np.ones(len(edges.ends)), _ANCHOR)
    assert se2.between(truth, found) == pytest.approx(0.0, abs=1e-9)


def test_gauss_newton_reaches_the_optimum_from_it() -> None:
    truth = loop(60)
    edges = measured_edges(truth, ladder(60), seed=2)
    weights = np.ones(len(edges.ends))
    start = chordal_poses(np.zeros((60, 3)), edges, weights, _ANCHOR)
    near = optimize(truth, edges, weights, _ANCHOR)
    far = optimize(start, edges, weights, _ANCHOR)
    assert far.cost == pytest.approx(near.cost, rel=1e-6)
