"""Slam over simulated floors: loops close, the same input gives the same bits, maps are continued."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import curvescan as cs
from curvescan import se2
from curvescan.odometry.step import StepOutcome
from curvescan.runs.result import Run
from curvescan.slam import ClosureOutcome
from curvescan.slam.pose_graph.graph import EdgeKind

pytestmark = pytest.mark.slow


def _mean_error(poses: np.ndarray, truth: np.ndarray) -> float:
    true = se2.between(truth[0], truth)
    return float(np.hypot(*(poses[:, :2] - true[:, :2]).T).mean())


@pytest.fixture(scope="module")
def floor() -> tuple[list[cs.LaserScan], np.ndarray]:
    made = cs.simulate("office", seed=1, n_scans=320, odometry_noise=None)
    return list(made), made.truth.poses


@pytest.fixture(scope="module")
def run(floor: tuple[list[cs.LaserScan], np.ndarray]) -> Run:
    return cs.run(floor[0], "slam")


def test_loops_close_and_the_trajectory_is_no_worse_than_the_odometry(
    floor: tuple[list[cs.LaserScan], np.ndarray], run: Run
) -> None:
    _, truth = floor
    found = run.trajectory
    # matches err by millimetres; what is left is the bend of a map of 14 m
    assert _mean_error(found.poses, truth) < 0.05
    assert _mean_error(found.poses, truth) <= _mean_error(run.record.odometry.poses, truth) + 0.01
    assert np.count_nonzero(run.engine.map.kinds == EdgeKind.CLOSURE) > 20
    assert run.engine.n_fragments == 1


def test_loop_closures_and_matches_of_neighbours_are_counted_apart(run: Run) -> None:
    graph = run.engine.graph
    n_closures, n_neighbours = run.engine.count_matches()
    assert n_closures > 20
    assert n_neighbours > 20
    assert n_closures + n_neighbours == np.count_nonzero(graph.is_closure & (graph.weights > 0.5))
    assert f"{n_closures:,} loop closures, {n_neighbours:,} matches of neighbours" in repr(run.engine)


def test_every_accepted_closure_is_true(floor: tuple[list[cs.LaserScan], np.ndarray], run: Run) -> None:
    _, truth = floor
    slam_map = run.engine.map
    true = se2.between(truth[0], truth)
    closures = run.engine.closures
    assert len({(c.i, c.j) for c in closures}) == len(closures)  # each two keyframes once
    accepted = [c for c in closures if c.is_accepted]
    assert accepted
    for c in accepted:
        i, j = slam_map.indices[[c.i, c.j]]
        off = se2.between(se2.between(true[i], true[j]), c.pose)
        assert abs(off[2]) < 0.15
        if c.covariance[0, 0] < 0.1 and c.covariance[1, 1] < 0.1:
            assert np.hypot(off[0], off[1]) < 0.3


def test_every_pose_has_a_covariance_that_is_positive_definite(run: Run) -> None:
    covariances = run.trajectory.covariances
    assert covariances is not None
    # the first keyframe is known exactly
    assert np.linalg.eigvalsh(covariances[50:]).min() > 0.0
    assert np.isfinite(covariances).all()


def test_the_same_input_gives_the_same_bits(floor: tuple[list[cs.LaserScan], np.ndarray], run: Run) -> None:
    again = cs.run(floor[0], "slam")
    assert again.trajectory.poses.tobytes() == run.trajectory.poses.tobytes()
    assert again.record.online.poses.tobytes() == run.record.online.poses.tobytes()


def test_a_map_is_continued_from_anywhere(
    floor: tuple[list[cs.LaserScan], np.ndarray], run: Run, tmp_path: Path
) -> None:
    scans, truth = floor
    run.engine.map.save(tmp_path / "floor.csmap")
    start = len(scans) // 3
    slam = cs.Slam(map=cs.load_map(tmp_path / "floor.csmap"))
    for scan in scans[start : start + 120]:
        slam.add(scan)
    trajectory = slam.finish()
    assert slam.map.n_sessions == 2
    assert slam.n_fragments == 1
    true = se2.between(truth[0], truth[start : start + 120])
    assert np.hypot(*(trajectory.poses[-1, :2] - true[-1, :2])) < 0.1


def test_a_localizer_finds_and_follows_the_sensor(floor: tuple[list[cs.LaserScan], np.ndarray], run: Run) -> None:
    scans, truth = floor
    start = len(scans) // 2
    localizer = cs.Localizer(run.engine.map)
    steps = [localizer.add(scan) for scan in scans[start : start + 120]]
    known = [k for k, step in enumerate(steps) if step.ok]
    assert known
    true = se2.between(truth[0], truth[start : start + 120])
    errors = [np.hypot(*(steps[k].pose[:2] - true[k, :2])) for k in known]
    assert max(errors) < 0.3


def test_of_no_scan_there_is_an_empty_trajectory() -> None:
    slam = cs.Slam()
    assert len(slam.trajectory()) == 0
    assert len(slam.finish()) == 0


def test_scans_without_readings_are_outcomes_not_exceptions() -> None:
    slam = cs.Slam()
    nothing = cs.LaserScan(np.full(180, np.inf), angle_min=-1.5, angle_increment=0.017)
    for _ in range(30):
        step = slam.add(nothing)
    assert not step.closures
    assert len(slam.finish()) == 30
    assert all(c.outcome is not ClosureOutcome.ACCEPTED for c in slam.closures)


def test_after_a_loss_the_scans_of_the_gap_lie_in_the_track_that_began() -> None:
    """Three scans pass until a sensor that was carried away is lost; a later match ties where it was put down."""
    drive = cs.simulate("clutter", sensor="hokuyo-270", seed=7277, n_scans=300, n_people=1)
    kept = [*range(95), *range(195, 300)]
    run = cs.run([drive[i] for i in kept], "slam")
    assert run.record.outcomes.count(StepOutcome.LOST) == 1
    true = se2.between(drive.truth.poses[0], drive.truth.poses[kept])
    assert np.hypot(*(run.trajectory.poses - true)[:, :2].T).max() < 0.05
