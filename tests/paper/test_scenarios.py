"""The paper's runs: what a matcher discards, the covariance for all, poses that were refused."""

from __future__ import annotations

import numpy as np
import pytest

import curvescan as cs
from curvescan.matchers.cfsma.covariance import pose_covariance
from curvescan.matchers.result import Label
from curvescan.paper.scenarios import DRIVES, lu_milios_covariance, run_scenario
from curvescan.simulation import simulate
from tests.scenes import room_scan


def test_the_papers_conditions_are_gentle_and_the_hard_ones_are_not():
    by_name = {one.name: one for one in DRIVES}
    assert list(by_name) == ["2", "2_hard", "3", "3_hard", "4", "4_hard"]
    turns = {}
    for name in ("3", "3_hard"):
        poses = by_name[name].simulate(share=0.3).truth.poses
        turns[name] = np.degrees(np.abs(cs.se2.between(poses[:-1], poses[1:])[:, 2])).max()
    assert turns["3"] < 4.1 < 10.0 < turns["3_hard"]
    assert by_name["4"].n_people <= 4 < by_name["4_hard"].n_people


def test_every_method_has_the_covariance_of_eq_16():
    scan = room_scan()
    for method in ("cfsma", "cox"):
        result = cs.match(scan, scan, method=method)
        matched = result.labels_current == Label.MATCHED
        # the scan with itself: each reading's nearest is itself, E_min the error of the pose alone
        moved = cs.se2.transform(result.pose, scan.points[matched])
        error = float(np.sum((moved - scan.points[matched]) ** 2))
        expected = pose_covariance(scan.points[matched], result.pose, error)
        np.testing.assert_allclose(lu_milios_covariance(scan, scan, result), expected, rtol=0.2)


def test_what_a_matcher_leaves_unmatched_is_counted():
    log = simulate("room", sensor="sick-lms200-5mm", n_scans=8, n_people=3, seed=2)
    result = run_scenario(log, "cfsma")
    steps = result.run.is_matched[1:]
    valid = np.array([scan.valid for scan in log])[1:][steps]
    people = log.is_person[1:][steps]
    assert result.people_matched.n_whole == np.count_nonzero(valid & people)
    assert result.people_matched.n_whole + result.static_matched.n_whole == np.count_nonzero(valid)
    discarded = result.is_discarded[1:][steps]
    assert result.people_matched.n_part == np.count_nonzero(valid & people & ~discarded)
    assert 0.0 < result.static_matched.value < 1.0
    assert result.lu_milios.shape == result.variances.shape == (np.count_nonzero(steps), 3)


def test_a_pose_that_was_refused_is_taken_where_refusals_are_left_out():
    # a round room: nothing fixes the heading, the pose the iteration had is still near
    log = simulate("round-room", n_scans=6, seed=1)
    result = run_scenario(log, "plicp")
    assert result.n_failed == 5
    assert result.errors.end_translation > 0.0
    assert result.end_unrefused < 0.1


@pytest.mark.parametrize("method", ["cfsma", "histogram"])
def test_without_failures_refusals_change_nothing(method):
    log = simulate("office", sensor="sick-lms200-5mm", n_scans=5, seed=3)
    result = run_scenario(log, method)
    if result.n_failed == 0:
        assert result.end_unrefused == pytest.approx(result.errors.end_translation, abs=1e-9)
    else:
        pytest.fail("choose a seed at which all match")
