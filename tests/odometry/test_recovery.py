"""Recovery: what the odometry keeps, and what it forgets, when scans find no match and when one does again."""

from __future__ import annotations

import numpy as np
import pytest

from curvescan.odometry import StepOutcome
from curvescan.odometry.measurement import Matching
from tests.odometry.scripted import run


def straight(n, step=0.3):
    return np.array([(step * k, 0.0, 0.0) for k in range(n)])


def test_the_script_is_followed(monkeypatch):
    poses = straight(8)
    _, steps = run(monkeypatch, poses, hidden=())
    np.testing.assert_allclose([step.pose for step in steps], poses, atol=1e-3)
    assert {step.outcome for step in steps[1:]} == {StepOutcome.MATCHED}


def test_after_a_recovery_the_old_velocity_does_not_go_on(monkeypatch):
    poses = straight(10)
    poses[7:] = poses[5] - np.array([0.1, 0.0, 0.0])  # it was stopped and pushed back meanwhile
    _, steps = run(monkeypatch, poses, hidden={6, 8, 9})
    outcomes = [step.outcome for step in steps[5:9]]
    assert outcomes == [StepOutcome.MATCHED, StepOutcome.PREDICTED, StepOutcome.RELOCALIZED, StepOutcome.PREDICTED]
    assert steps[6].pose[0] == pytest.approx(1.8, abs=0.01)  # the velocity goes on, once
    np.testing.assert_allclose(steps[7].pose, poses[7], atol=0.01)
    np.testing.assert_allclose(steps[8].pose, steps[7].pose, atol=1e-9)
    np.testing.assert_allclose(steps[9].pose, steps[7].pose, atol=1e-9)


def test_what_begins_at_once_is_found_from_farther_around(monkeypatch):
    poses = straight(9)
    poses[6:, 2] = 0.4  # it begins to turn, from one scan to the next
    outcomes = {}
    for is_wide in (True, False):
        if not is_wide:
            monkeypatch.setattr(Matching, "match_around", Matching.match)
        _, steps = run(monkeypatch, poses, sudden={6})
        outcomes[is_wide] = steps[6].outcome
        if is_wide:
            np.testing.assert_allclose(steps[6].pose, poses[6], atol=0.01)
    assert outcomes == {True: StepOutcome.CHAINED, False: StepOutcome.PREDICTED}


def another_room(n, first, link, bridge):
    """Return pairs of a drive of n scans that is in another room from one scan on.

    What the scan before it shows by chance, and what
    the later scans there show of that one."""
    links = {(i, j): (0.0, 0.0) for i in range(first) for j in range(first, n)}
    links[first - 1, first] = link
    links |= {(first - 1, j): bridge for j in range(first + 1, n)}
    return links


@pytest.mark.parametrize(("bridge", "is_lost"), [((0.0, 0.0), True), ((0.45, 0.6), False)])
def test_a_doubtful_match_with_the_scan_before_is_questioned(monkeypatch, bridge, is_lost):
    """Where nothing agrees the sensor was carried away; with 0.6 three times, and 0.7 before, it hardly was."""
    links = another_room(14, 7, (0.4, 0.7), bridge)
    _, steps = run(monkeypatch, straight(14, 0.1), links=links)
    assert steps[7].outcome is StepOutcome.CHAINED
    assert (StepOutcome.LOST in [step.outcome for step in steps]) is is_lost
    assert bool(steps[-1].covariance[0, 0] > 1.0) is is_lost


@pytest.mark.parametrize("link", [pytest.param((0.4, 0.98), id="sure"), pytest.param((0.6, 0.7), id="explains much")])
def test_other_links_are_not_questioned(monkeypatch, link):
    links = another_room(14, 7, link, (0.0, 0.0))
    _, steps = run(monkeypatch, straight(14, 0.1), links=links)
    assert StepOutcome.LOST not in [step.outcome for step in steps]
    assert steps[-1].covariance[0, 0] < 1.0


def test_a_missed_update_of_the_wheels_where_nothing_matches_costs_that_scan_alone(monkeypatch):
    steps = np.full(30, 0.8)
    steps[20] = 0.3  # the last motion is expected again, 0.5 m too far
    poses = np.column_stack([np.cumsum(steps), np.zeros(30), np.zeros(30)])
    poses[:, 0] -= poses[0, 0]
    wheels = poses.copy()
    wheels[20] = wheels[19]
    # what comes after scan 20 sees nothing from before, and scan 20 only what comes after it
    unseen = {(i, j): (0.0, 0.0) for i in range(20) for j in range(20, 30)}
    _, found = run(monkeypatch, poses, links=unseen, wheels=wheels)
    off = np.abs(np.array([step.pose for step in found]) - poses)[:, 0]
    assert found[20].outcome is StepOutcome.PREDICTED
    assert off[20] == pytest.approx(0.5, abs=0.01)
    assert np.delete(off, 20).max() < 0.02


def test_a_scan_that_nothing_after_it_matches_hides_nothing_of_the_keyframe_before_it(monkeypatch):
    """A bad sweep is hardly shown by the keyframe, becomes one, and shows nothing: the one before it bridges."""
    links = {(i, 7): (0.3, 0.9) for i in range(7)} | {(7, j): (0.0, 0.0) for j in range(8, 14)}
    _, steps = run(monkeypatch, straight(14, 0.1), links=links)
    assert StepOutcome.RELOCALIZED in [step.outcome for step in steps[8:10]]
    np.testing.assert_allclose([step.pose for step in steps], straight(14, 0.1), atol=1e-3)
    assert max(step.covariance[0, 0] for step in steps[10:]) < 0.01


def test_a_sudden_turn_in_a_gap_is_no_reason_to_be_lost(monkeypatch):
    """What was in use before a gap is looked for as far around as a sensor moves unseen, not near the last motion."""
    poses = straight(14, 0.1)
    poses[7:, 2] = 0.5
    _, steps = run(monkeypatch, poses, hidden={7})
    assert [step.outcome for step in steps[7:9]] == [StepOutcome.PREDICTED, StepOutcome.RELOCALIZED]
    np.testing.assert_allclose(steps[-1].pose, poses[-1], atol=0.01)
