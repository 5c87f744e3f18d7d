"""GrowingMap: how a keyframe is tied to the one before it."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers import MatchResult
from curvescan.se2.uncertain import UncertainPose
from curvescan.slam import SlamConfig
from curvescan.slam.growing_map import GrowingMap
from curvescan.slam.keyframes import Keyframes
from curvescan.slam.pose_graph.graph import EdgeKind

SIGMA_ALONG, SIGMA_ACROSS = 0.4, 0.05
"""Of the odometry, metres."""


@pytest.fixture(scope="module")
def scans() -> list[cs.LaserScan]:
    return list(cs.simulate("office", seed=1, n_scans=3, odometry_noise=None))


def _way(
    scans: list[cs.LaserScan], monkeypatch: pytest.MonkeyPatch, *, is_open: bool, off: float = 0.0
) -> tuple[GrowingMap, MatchResult]:
    """Return a map of two keyframes whose match leaves x open or nothing, and the match."""
    keyframes = Keyframes("curvescan", None, 10)
    growing = GrowingMap(keyframes, SlamConfig())
    growing.start(scans[0], 0, np.zeros(3), 0)
    found = cs.match(scans[0], scans[2])
    direction = np.array([1.0, 0.0, 0.0]) if is_open else None
    found = dataclasses.replace(found, degenerate_direction=direction, confidence=0.95)
    monkeypatch.setattr(keyframes, "match", lambda i, j, guess: found)
    cov = np.diag(np.square([SIGMA_ALONG, SIGMA_ACROSS, 0.02]))
    motion = UncertainPose(found.pose + np.array([0.2, off, 0.0]), cov)
    growing.append(scans[2], 2, motion, is_measured=True)
    return growing, found


def test_a_match_that_leaves_the_way_along_open_holds_it_across(
    scans: list[cs.LaserScan], monkeypatch: pytest.MonkeyPatch
) -> None:
    growing, found = _way(scans, monkeypatch, is_open=True, off=0.03)
    graph = growing.graph
    assert graph.kinds.tolist() == [EdgeKind.MOTION, EdgeKind.MATCH]
    measured, sigmas = graph.measured[1], np.sqrt(np.diagonal(graph.covariances[1]))
    # along as the odometry has it, across and in rotation as the match has it
    assert measured[0] == pytest.approx(found.pose[0] + 0.2, abs=0.01)
    assert measured[1] == pytest.approx(found.pose[1], abs=0.003)
    assert sigmas[0] > SIGMA_ALONG
    assert (sigmas[1:] < [0.008, 0.004]).all()


def test_one_that_contradicts_the_odometry_across_is_not_followed(
    scans: list[cs.LaserScan], monkeypatch: pytest.MonkeyPatch
) -> None:
    graph = _way(scans, monkeypatch, is_open=True, off=0.6)[0].graph
    assert np.sqrt(graph.covariances[1][1, 1]) > SIGMA_ACROSS


def test_a_motion_of_which_nothing_is_known_leaves_the_matrix_its_digits(
    scans: list[cs.LaserScan],
) -> None:
    growing = GrowingMap(Keyframes("curvescan", None, 10), SlamConfig())
    growing.start(scans[0], 0, np.zeros(3), 0)
    lost = UncertainPose(np.zeros(3), np.diag([1e6, 1e6, 10.0]))
    growing.append(scans[2], 2, lost, is_measured=False)
    is_motion = growing.graph.kinds == EdgeKind.MOTION
    assert np.linalg.eigvalsh(growing.graph.covariances[is_motion][0]).max() < 1e3
