"""Localizer: it reads old maps, finds and follows the sensor, and notices when it is carried away."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.errors import LogFileError, LogFormatError
from curvescan.odometry import StepOutcome
from curvescan.se2.uncertain import UncertainPose
from curvescan.simulation import build_world
from curvescan.slam import SlamMap
from curvescan.slam.localization.matching import Hit
from localization_runs import false_elsewhere, first_fixes, tracked
from localization_tasks import in_frame_of, task_of_floor, with_closed_doors, with_moved_things
from tests.slam.map_example import FILE, ROOM, lap, scans


@pytest.fixture(scope="module")
def stored() -> SlamMap:
    return cs.load_map(FILE)


def _errors(steps: list[cs.Step], poses: np.ndarray) -> np.ndarray:
    """Return (n,) distances from the truth, NaN where no pose is given."""
    true = se2.between(lap()[0], poses)
    return np.array([np.hypot(*(s.pose[:2] - p[:2])) for s, p in zip(steps, true, strict=True)])


def test_a_map_of_version_1_is_read(stored: SlamMap) -> None:
    assert (len(stored), len(stored.ends), stored.n_sessions) == (21, 91, 1)
    assert np.allclose(stored.poses[7], [1.33783, 2.94077, 2.07473], atol=1e-5)
    assert np.allclose(stored.scans[7].ranges[[0, 90]], [1.62381482, 2.66648936], atol=1e-7)
    assert stored.grid is not None
    assert stored.grid.log_odds.shape == (182, 142)
    assert FILE.stat().st_size < 50_000


def test_what_is_read_is_written_again_alike(stored: SlamMap, tmp_path: Path) -> None:
    stored.save(tmp_path / "again.csmap")
    again = cs.load_map(tmp_path / "again.csmap")
    for name in ("poses", "covariances", "ends", "measured", "edge_covariances", "weights"):
        assert np.array_equal(getattr(again, name), getattr(stored, name)), name


def test_a_damaged_byte_is_refused_or_harmless(stored: SlamMap, tmp_path: Path) -> None:
    whole = FILE.read_bytes()
    rng = np.random.default_rng(5)
    refused: list[str] = []
    for at in rng.integers(0, len(whole), 60).tolist():
        damaged = bytearray(whole)
        damaged[at] ^= 0x5A
        path = tmp_path / "damaged.csmap"
        path.write_bytes(damaged)
        try:
            found = cs.load_map(path)
        except (LogFormatError, LogFileError) as error:
            refused.append(str(error))
        else:
            assert np.array_equal(found.poses, stored.poses)
    assert len(refused) > 50
    assert not any("\n" in sentence for sentence in refused)


@pytest.mark.slow
@pytest.mark.parametrize("start", [0.4, 2.0, 3.9, 5.5])
def test_the_sensor_is_found_in_a_stored_map_from_anywhere(stored: SlamMap, start: float) -> None:
    poses = lap(start=start)[:60]
    localizer = cs.Localizer(stored)
    steps = [localizer.add(s) for s in scans(poses, seed=9)]
    errors = _errors(steps, poses)
    known = np.isfinite(errors)
    # between keyframes the odometry leads, and no keyframe of the map is named
    keyframes = np.array([step.keyframe for step in steps])[known]
    assert (keyframes == -1).any()
    assert (keyframes >= 0).any()
    assert np.flatnonzero(known)[0] < 10
    assert known[10:].all()
    assert errors[known].max() < 0.05


@pytest.mark.slow
def test_one_scan_alone_is_located(stored: SlamMap) -> None:
    poses = lap()[20:21]
    step = cs.Localizer(stored).add(scans(poses, seed=3)[0])
    assert step.outcome is StepOutcome.FOUND
    true = se2.between(lap()[0], poses[0])
    assert np.hypot(*(step.pose[:2] - true[:2])) < 0.05


@pytest.mark.slow
def test_people_in_front_of_its_walls_hide_no_place(stored: SlamMap) -> None:
    poses, rng = lap(start=0.4)[:1], np.random.default_rng(7)
    places = rng.uniform((0.4, 0.4), (8.5, 6.5), (200, 2))
    apart = np.hypot(*(places - poses[0, :2]).T)
    people = np.column_stack((places, np.full(200, 0.2)))[(apart > 0.7) & (apart < 3.0)][:8]
    scan = scans(poses, world=replace(ROOM, circles=np.vstack((ROOM.circles, people))), seed=9)[0]
    localizer = cs.Localizer(stored)
    true = se2.between(lap()[0], poses[0])
    assert localizer._matching.field.agreement(scan.points[scan.valid], true) < 0.5
    step = localizer.add(scan)
    assert step.outcome is StepOutcome.FOUND
    assert np.hypot(*(step.pose[:2] - true[:2])) < 0.05


@pytest.mark.slow
def test_walls_hold_a_scan_along_what_its_matches_leave_open(stored: SlamMap, monkeypatch: pytest.MonkeyPatch) -> None:
    localizer = cs.Localizer(stored)
    around = localizer._matching.around

    def slid(*args: Any, **options: Any) -> tuple[list[Hit], bool]:
        hits, is_due = around(*args, **options)
        away, open_x = np.array([0.4, 0.0, 0.0]), np.diag([100.0, 0.0, 0.0])
        moved = [UncertainPose(hit.here.pose + away, hit.here.covariance + open_x) for hit in hits]
        return [hit._replace(here=here) for hit, here in zip(hits, moved, strict=True)], is_due

    monkeypatch.setattr(localizer._matching, "around", slid)
    step = localizer.add(scans(lap()[60:61], seed=3)[0])
    assert step.outcome is StepOutcome.FOUND
    true = se2.between(lap()[0], lap()[60])
    assert np.hypot(*(step.pose[:2] - true[:2])) < 0.1


@pytest.mark.slow
def test_a_map_that_has_changed_in_part_still_serves(stored: SlamMap) -> None:
    # two of six boxes a metre away, one gone
    boxes = ROOM.boxes[:5].copy()
    boxes[1, :2] += [1.0, 0.3]
    boxes[3, :2] += [0.2, 1.0]
    poses = lap(start=1.0)
    changed = scans(poses, world=replace(ROOM, boxes=boxes), seed=4)
    localizer = cs.Localizer(stored)
    errors = _errors([localizer.add(s) for s in changed], poses)
    known = np.isfinite(errors)
    # three of six pieces moved or gone: it takes half a lap to be sure, and is never wrong
    assert known[75:].all()
    assert errors[known].max() < 0.1


@pytest.mark.slow
def test_a_sensor_that_is_carried_away_is_noticed_and_found_again(stored: SlamMap) -> None:
    poses = np.concatenate((lap()[10:50], lap()[100:140]))
    localizer = cs.Localizer(stored)
    steps = [localizer.add(s) for s in scans(poses, seed=6)]
    errors = _errors(steps, poses)
    assert errors[39] < 0.05
    after = errors[40:]
    # at most a few scans are given a pose that is wrong, then none
    assert np.count_nonzero(after > 0.3) <= 8
    assert np.isfinite(after[20:]).all()
    assert after[20:].max() < 0.05
    assert any(s.outcome is StepOutcome.FOUND for s in steps[40:])


@pytest.mark.slow
def test_in_another_building_there_is_no_fix(stored: SlamMap) -> None:
    elsewhere = cs.simulate("office", seed=11, n_scans=80, odometry_noise=None)
    localizer = cs.Localizer(stored)
    assert not any(localizer.add(scan).ok for scan in elsewhere)


@pytest.mark.slow
def test_reset_forgets_where_the_sensor_is(stored: SlamMap) -> None:
    seen = scans(lap()[20:40], seed=3)
    localizer = cs.Localizer(stored)
    first = [localizer.add(s) for s in seen]
    localizer.reset()
    again = [localizer.add(s) for s in seen]
    assert [s.outcome for s in first] == [s.outcome for s in again]
    assert np.array_equal(first[-1].pose, again[-1].pose)


@pytest.mark.slow
def test_an_initial_pose_on_the_way_keeps_the_odometry(stored: SlamMap) -> None:
    poses = lap()[20:50]
    seen, true = scans(poses, seed=3), se2.between(lap()[0], poses)
    localizer = cs.Localizer(stored)
    steps = [localizer.add(scan) for scan in seen[:20]]
    localizer.reset(true[20] + (0.6, -0.5, 0.3), np.diag([0.5, 0.5, 0.1]), keeps_odometry=True)
    steps += [localizer.add(scan) for scan in seen[20:]]
    assert steps[20].outcome is StepOutcome.FOUND
    assert np.hypot(*(steps[20].pose - true[20])[:2]) < 0.05
    way = np.array([step.pose_odom for step in steps])
    assert np.hypot(*np.diff(way, axis=0)[:, :2].T).max() < 0.3


@pytest.mark.slow
def test_two_sessions_become_one_map(stored: SlamMap, tmp_path: Path) -> None:
    poses = lap(start=2.5)
    slam = cs.Slam(map=stored)
    for scan in scans(poses, seed=8):
        slam.add(scan)
    trajectory = slam.finish()
    assert slam.n_fragments == 1
    slam.map.save(tmp_path / "both.csmap")
    both = cs.load_map(tmp_path / "both.csmap")
    assert both.n_sessions == 2
    assert len(both) > len(stored)
    # the first session's keyframes stay where they were, the second's lie among them
    own = both.sessions == 0
    assert np.hypot(*(both.poses[own][:, :2] - stored.poses[: own.sum(), :2]).T).max() < 0.05
    true = se2.between(lap()[0], poses)
    assert np.hypot(*(trajectory.poses[:, :2] - true[:, :2]).T).max() < 0.05
    localizer = cs.Localizer(both)
    later = lap(start=4.0)[:30]
    errors = _errors([localizer.add(s) for s in scans(later, seed=10)], later)
    assert np.isfinite(errors[-1])
    assert np.nanmax(errors) < 0.05


@pytest.mark.slow
def test_fixes_on_a_simulated_floor_are_right_and_covariances_hold() -> None:
    task = task_of_floor(1, n_test=300)
    starts = np.arange(0, 300, 15)
    fixes = first_fixes(task, starts, n_most=40)
    found = [f for f in fixes if f.is_known[-1]]
    assert len(found) >= 18
    assert all(f.is_right[-1] for f in found)
    steps = tracked(task, 300)
    assert steps.is_matched.sum() > 20
    # chi-square of 3 degrees of freedom has a mean of 3: not more, whatever the map adds
    assert steps.nees[steps.is_matched].mean() < 3.6
    assert np.mean([o is StepOutcome.TRACKED for o in steps.outcomes]) > 0.9


@pytest.mark.slow
def test_on_another_floor_the_sensor_is_not_found() -> None:
    floor, other = task_of_floor(1, n_test=120), task_of_floor(2, n_test=120)
    assert false_elsewhere(floor, other, np.random.default_rng(0), n_trials=6) == (0, 6)


def test_references_are_carried_by_the_nearest_anchor() -> None:
    references = np.array([[0.0, 0.0, 0.0], [10.0, 0.0, 0.0]])
    anchors = np.array([[0.0, 0.0, 0.0], [0.0, 10.5, np.pi / 2.0]])  # turned, the far end bent
    found, distance = in_frame_of(anchors, references, np.array([[1.0, 0.0, 0.0], [9.0, 0.0, 0.5]]))
    assert np.allclose(found, [[1.0, 0.0, 0.0], [0.0, 9.5, np.pi / 2.0 + 0.5]])
    assert np.allclose(distance, [1.0, 1.0])


def test_things_that_move_are_the_share_that_is_asked_for() -> None:
    assert np.array_equal(with_moved_things(ROOM, 0.0, 3).boxes, ROOM.boxes)
    moved = with_moved_things(ROOM, 1.0, 3)
    way = np.hypot(*(moved.boxes[:, :2] - ROOM.boxes[:, :2]).T)
    assert ((way >= 0.4) & (way <= 1.0)).all()


def test_a_closed_door_is_a_wall_between_two_in_its_line() -> None:
    office = build_world("office", 60)
    assert np.array_equal(with_closed_doors(office, 0, 3).boxes, office.boxes)
    closed = with_closed_doors(office, 2, 3)
    assert np.array_equal(closed.boxes[:-2], office.boxes)
    for x, y, length, width, _ in closed.boxes[-2:]:
        assert min(length, width) == pytest.approx(0.12)
        assert 0.6 < max(length, width) < 1.5
        ends = np.array([0.5 * length + 0.01, 0.0] if length > width else [0.0, 0.5 * width + 0.01])
        for end in (ends, -ends):  # it meets a wall at both ends
            off = np.abs(office.boxes[:, :2] - (x, y) - end)
            assert (off <= 0.5 * office.boxes[:, 2:4]).all(axis=1).any()


@pytest.mark.slow
def test_behind_closed_doors_the_sensor_is_still_found_and_never_elsewhere() -> None:
    task = task_of_floor(60, n_test=60, n_closed=2)
    fixes = first_fixes(task, np.arange(0, 60, 6), n_most=12)
    assert min(f.shown[0] for f in fixes) < 0.9  # doors are seen
    assert sum(f.is_right[-1] for f in fixes) >= 4
    assert not any(f.is_known[-1] and not f.is_right[-1] for f in fixes)
